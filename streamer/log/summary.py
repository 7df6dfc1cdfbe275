"""Summaries for `log show` and `log replay`, as JSON and for a terminal."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.log.reader import Log
from flexmotion.streamer.log.replay import Replay
from flexmotion.streamer.motion.intents import WORDS
from flexmotion.streamer.report.report import Latency

SHOW_SCHEMA, REPLAY_SCHEMA = "flexmotion.log-summary/1", "flexmotion.replay/1"
_EVENTS_SHOWN = 40


def describe(log: Log) -> dict[str, Any]:
    """The output of `log show` as JSON (see `docs/log.md`)."""
    header, rows, record = log.header, log.rows, log.record()
    played = np.unique(rows["plan"][rows["plan"] > 0])
    states = rows["state"]
    return {
        "schema": SHOW_SCHEMA,
        "file": str(log.path),
        "whole": log.whole,
        "parts": [part.name for part in log.parts],
        "missing_parts": list(log.missing),
        "software": header.software,
        "started": datetime.fromtimestamp(header.start_ns * 1e-9, UTC).isoformat(timespec="seconds"),
        "robot": header.robot,
        "driver": header.driver,
        "source": header.source,
        "seed": header.seed,
        "clock": header.clock,
        "options": header.driver_options,
        "feedback": header.feedback,
        "rate_hz": header.rate_hz,
        "ticks": len(rows),
        "missing_ticks": log.gaps,
        "duration_s": len(rows) / header.rate_hz,
        "states": [
            {
                "tick": int(rows["tick"][k]),
                "at_s": float(rows["tick"][k]) / header.rate_hz,
                "state": State(states[k]).name,
            }
            for k in range(len(rows))
            if not k or states[k] != states[k - 1]
        ],
        "plans": {
            "logged": len(log.plans),
            "made": max((plan["id"] for plan in log.plans), default=0),
            "played": len(played),
            "late": record.late_plans,
            "underruns": record.underruns,
        },
        "targets": [{"at_s": _place(log, target["stamp_ns"]), **target} for target in log.targets],
        "heard": [heard.model_dump(mode="json") for heard in log.heard],
        "events": [
            {"at_s": event.tick / header.rate_hz, "tick": event.tick, "kind": event.kind, "message": event.message}
            for event in log.events
        ],
        "loop": {
            "missed_deadlines": record.missed_deadlines,
            "wake_lateness_us": _latency(rows["lateness_s"]) if header.clock == "real" else None,
            "work_us": _latency(rows["work_s"]),
            "robot_lateness_us": _latency(rows["robot_lateness_s"]),
        },
        "limits": {"violations_sent": record.violations_sent, "repairs": record.repairs},
        "safety": {
            "final_state": State(states[-1]).name if len(rows) else None,
            "faults": [event.message for event in log.events if event.kind == "fault"],
            "hardware_failed": record.hardware_failed,
        },
        "topics": {
            name: {
                "messages": topic.messages,
                "schema": topic.schema,
                "encoding": topic.encoding,
                "bytes": topic.size_bytes,
            }
            for name, topic in sorted(log.topics.items())
        },
        "attachments": {name: len(content) for name, content in sorted(log.files.items())},
    }


def _last_state(content: dict[str, Any]) -> str:
    """The state in which the run ended, or, of a log that was cut off, the last one that it holds."""
    state = content["safety"]["final_state"]
    if state is None:
        return "unknown state: the log holds no tick"
    return f"ended {state}" if content["whole"] else f"last seen in {state}"


def render_log(content: dict[str, Any]) -> RenderableType:
    """`describe` for a terminal."""
    about = _table("", "")
    end = "" if content["whole"] else ", not closed: it ends where writing ended"
    about.add_row("log", f"{content['file']}, begun {content['started']}{end}")
    if len(content["parts"]) > 1:
        missing = ", ".join(map(str, content["missing_parts"]))
        removed = f"; parts {missing} were removed" if missing else ""
        about.add_row("parts", f"{len(content['parts'])}, the last {content['parts'][-1]}{removed}")
    about.add_row("run", "{robot} on {driver}, {source}, seed {seed}, clock {clock}".format(**content))
    length = f"{content['duration_s']:.2f} s, {content['ticks']} ticks at {content['rate_hz']:g} Hz"
    about.add_row("length", f"{length}, {content['missing_ticks']} missing")
    about.add_row("states", " → ".join(f"{s['state']} {s['at_s']:.2f} s" for s in content["states"]))
    about.add_row("plans", "{made} made, {logged} logged, {played} played, {late} late".format(**content["plans"]))
    loop = content["loop"]
    timing = [f"{loop['missed_deadlines']} deadlines missed"]
    for name, text in (("work_us", "work"), ("wake_lateness_us", "lateness"), ("robot_lateness_us", "robot late")):
        if loop[name] is not None:
            timing.append(
                f"{text} p50/p99/max {loop[name]['p50']:.0f}/{loop[name]['p99']:.0f}/{loop[name]['max']:.0f} us"
            )
    about.add_row("loop", ", ".join(timing))
    repairs = ", ".join(f"{kind} {count}" for kind, count in content["limits"]["repairs"].items())
    about.add_row("limits", f"{content['limits']['violations_sent']} violations sent; repairs: {repairs}")
    faults = "; ".join(content["safety"]["faults"]) or "no fault"
    about.add_row("safety", f"{_last_state(content)}, {faults}")
    topics = _table("topic", "messages", "schema", "encoding", "MB")
    for name, topic in content["topics"].items():
        topics.add_row(name, str(topic["messages"]), topic["schema"], topic["encoding"], f"{topic['bytes'] / 1e6:.2f}")
    events = _table("at", "kind", "what")
    lines = [(e["at_s"], e["kind"], e["message"]) for e in content["events"]]
    lines += [(t["at_s"], "target", _asked(t)) for t in content["targets"] if t["at_s"] is not None]
    for at, kind, message in sorted(lines)[:_EVENTS_SHOWN]:
        events.add_row(f"{at:.2f} s", kind, message)
    if len(lines) > _EVENTS_SHOWN:
        events.add_row("…", "", f"{len(lines) - _EVENTS_SHOWN} more, in --json")
    return Group(about, "", topics, "", events)


def _asked(target: dict[str, Any]) -> str:
    """The intent of a target as text."""
    return ", ".join(f"{word} {target[word]}" for word in WORDS if word in target)


def describe_replay(log: Log, result: Replay) -> dict[str, Any]:
    """The output of `log replay` as JSON."""
    return {
        "schema": REPLAY_SCHEMA,
        "file": str(log.path),
        "agrees": result.agrees,
        "equal": not result.differing,
        "differing": result.differing,
        "figures": {
            figure.name: {
                "logged": figure.logged,
                "replayed": figure.replayed,
                "difference": figure.difference,
                "tolerance": figure.tolerance,
                "agrees": figure.agrees,
            }
            for figure in result.figures
        },
    }


def render_replay(result: Replay) -> RenderableType:
    """The comparison for a terminal."""
    table = _table("figure", "logged", "replayed", "difference", "tolerance", "")
    for figure in result.figures:
        values = (figure.logged, figure.replayed, figure.difference, figure.tolerance)
        table.add_row(figure.name, *map(_number, values), "" if figure.agrees else "differs")
    verdict = "the runs agree" if result.agrees else "the runs do NOT agree"
    if not result.differing:
        verdict = "the runs are equal, bit for bit"
    return Group(table, "", verdict)


def _place(log: Log, stamp_ns: int) -> float | None:
    """Time of a `perf_counter` stamp in the run [s]; None after its end."""
    row = int(np.searchsorted(log.rows["stamp_ns"], stamp_ns))
    return float(log.rows["tick"][row]) / log.header.rate_hz if row < len(log.rows) else None


def _latency(seconds: np.ndarray[Any, Any]) -> dict[str, float] | None:
    latency = Latency.of(seconds, 1e-6)
    return None if latency is None else latency.model_dump()


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.6g}"


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim", show_header=any(columns))
    for column in columns:
        table.add_column(column)
    return table
