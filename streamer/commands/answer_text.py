"""Answers and the status of a run as a person reads them in a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from flexmotion.spatial.heading import wrapped
from flexmotion.streamer.motion.intents import from_content, words_of

if TYPE_CHECKING:
    from flexmotion.streamer.gateway.connection import StopAnswer
    from flexmotion.streamer.gateway.messages import Answer, Ended

_NAME = 18
_STOPS = {
    "stop": "the robot comes to a stand, and refuses targets until: flexmotion clear",
    "estop": "the robot stops, parks, and its torque goes off; then: flexmotion clear, flexmotion arm",
}
_ENDS = {
    "done": "done",
    "time limit": "not done within its time limit",
    "expired": "its time is over",
    "superseded": "replaced by another target",
    "stopped": "stopped",
}
_MEANT = {"contact": "{} kept down", "foot": "a step of the {}"}
"""What a message means for a part of the body that others are for, too."""
_MIRRORS = {
    "a person": "the person who is seen",
    "nobody": "nobody: nobody is seen",
    "not yet": "nobody yet: a person is seen; if the robot goes on standing: flexmotion send mirror",
    "waits": "nobody, since it was stopped; it goes on with: flexmotion send mirror",
}
_SURE = 0.995
_IDLE = {
    "OFF": "its torque is off",
    "READY": "it stands up",
    "STREAMING": "it comes to a stand",
    "HOLD": "it stands",
    "PARK": "it lowers itself",
    "DAMPED": "it gives way",
    "GET_UP": "it gets up",
    "FAULT": "its torque is off",
}
"""What a robot that follows nothing does, by state."""


def answer_line(answer: Answer) -> str:
    """An answer in one line: its state, what was heard, what differs from what was asked, why."""
    parts: list[str] = []
    if answer.reason is not None and answer.state == "refused":
        parts.append(answer.reason)
    elif answer.heard_as is not None:
        sure = 1.0 if answer.certainty is None else answer.certainty
        heard = _MEANT.get(str(answer.asked), "{}" if answer.part and answer.asked != "text" else "heard as {}")
        parts.append(heard.format(answer.heard_as) + (f" ({100 * sure:.0f} % sure)" if sure < _SURE else ""))
    if answer.slowed is not None:
        parts.append(f"slowed to {answer.slowed}")
    if answer.moved is not None:
        parts.append(f"moved to {answer.moved}")
    if answer.dropped:
        parts.append(f"not done: {', '.join(answer.dropped)}")
    parts += answer.notes or ()
    if answer.tick is not None and answer.state != "refused":
        parts.append(f"from tick {answer.tick}")
    if answer.took_lease_from is not None:
        parts.append(f"took over from {answer.took_lease_from}")
    if answer.reason is not None and answer.state != "refused":
        parts.append(answer.reason)
    return f"{answer.state}: {'; '.join(parts)}" if parts else answer.state


def ended_line(ended: Ended) -> str:
    """The end of a target in one line."""
    return f"{_ENDS[ended.end]}: {ended.done}" if ended.done is not None else _ENDS[ended.end]


def stop_line(what: str, answer: StopAnswer) -> str:
    """The answer to a stop in one line; `what`: "stop" or "estop"."""
    if answer.tick is None:
        return f"{answer.state}: {answer.reason}"
    return f"{answer.state} before tick {answer.tick}: {_STOPS[what]}"


def status_lines(found: Mapping[str, Any]) -> list[str]:
    """A status (`flexmotion.streamer.gateway.status.Status`) by line; what is not known, or as ever, is left out."""
    state, counts = found["state"], dict(found["counts"])
    time_s, received = found["time_s"], counts.pop("received", 0)
    rows = {
        "robot": f"{found['robot']} on {found['driver']}" + ("" if time_s is None else f", for {time_s:.1f} s"),
        "state": state if found["loop"] == "ticks" else f"the loop does not run; it was {state or 'never started'}",
        "cause": found["cause"],
        "lies": _lies(found.get("gets_up_from")),
        "targets": "refused: a stop is in force (flexmotion clear)" if _stopped(found) else None,
        "limp joints": ", ".join(found["limp"]) or None,
        "follows": _follows(found["following"], "HOLD" if found.get("ready") else state),
        "mirrors": _MIRRORS.get(found.get("mirrors") or ""),
        **_held(found.get("holding", ())),
        "operator": found["operator"] or "nobody",
        "place": _place(found["odometry"]),
        "torso": _tilt(found["tilt"]),
        "hottest servo": _with_unit(found["hottest"], "°C"),
        "supply": _with_unit(found["supply"], "V"),
        "missed deadlines": None if found["missed_deadlines"] is None else str(found["missed_deadlines"]),
        "messages": ", ".join([str(received), *(f"{name} {number}" for name, number in counts.items())]),
        **found["ways"],
    }
    return [f"{name:{_NAME - 1}} {text}" for name, text in rows.items() if text is not None]


def _lies(side: str | None) -> str | None:
    return None if side is None else f"on its {side}; it gets up with: flexmotion clear --get-up"


def _stopped(found: Mapping[str, Any]) -> bool:
    return bool(found["must_stop"]) and not found["limp"] and found["state"] in ("OFF", "READY", "STREAMING", "HOLD")


def _follows(following: Mapping[str, Any] | None, state: str | None) -> str:
    """What the robot was told, by whom, and how it ended."""
    if following is None:
        return f"nothing: {_IDLE[state]}" if state in _IDLE else "nothing"
    asked = "; ".join(_said(name, value) for name, value in following["asked"].items())
    heard = "" if following["heard_as"] in (None, *following["asked"]) else f", heard as {following['heard_as']}"
    slowed = "" if following["slowed"] is None else f", slowed to {following['slowed']}"
    whole = f"{asked}{heard}{slowed}, of {following['source']}"
    if following["end"] is None:
        return whole
    now = f"nothing: {_IDLE[state]}" if state in _IDLE else "nothing"
    return f"{now}; over ({following['end']}): {whole}"


def _held(holding: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """A line for each part that is at a place of its own, and for each restriction."""
    lines = {}
    for one in holding:
        way = "on its way"
        if one["restricts"]:
            way = "restricts"
        elif one["there"] is not None:
            way = f"there, {one['there']}"
        elif one["missed"] is not None:
            way = f"not there: {one['missed']}"
        moved = "" if one["moved"] is None else f", moved to {one['moved']}"
        source = "" if one["source"] is None else f", of {one['source']}"
        lines[", ".join(one["parts"])] = f"{one['asked']}{moved}{source}: {way}"
    return lines


def _said(name: str, value: Any) -> str:
    if name == "text":
        return f'"{value}"'
    if name in ("heading", "waypoint"):
        return words_of(from_content({name: value}))
    return name if value is True else f"{name} {_plain(value)}"


def _plain(value: Any) -> str:
    """A value without the brackets and quotes of a program."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_plain(one)}" for name, one in value.items() if one is not None)
    if isinstance(value, list | tuple):
        return " ".join(map(_plain, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _place(odometry: list[float] | None) -> str | None:
    if odometry is None:
        return None
    x, y, heading = odometry
    turned = math.degrees(wrapped(heading))
    return f"{_to(x, 'ahead', 'back')}, {_to(y, 'left', 'right')}, turned {_to(turned, 'left', 'right', '°', 0)}"


def _tilt(tilt: list[float] | None) -> str | None:
    if tilt is None:
        return None
    roll, pitch = (math.degrees(value) for value in tilt)
    return f"tilted {_to(pitch, 'forward', 'back', '°')}, {_to(roll, 'right', 'left', '°')}"


def _to(value: float, positive: str, negative: str, unit: str = " m", digits: int = 2) -> str:
    return f"{abs(value):.{digits}f}{unit} {positive if value >= 0 else negative}"


def _with_unit(value: float | None, unit: str) -> str | None:
    return None if value is None else f"{value:g} {unit}"
