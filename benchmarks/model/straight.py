"""Does what is asked without a turn keep its heading and its place for minutes, and does a turn end where it is to?

Roll-outs of the live source from standing, of the delivered motion: with its course, and without (`--without`), as
logs of earlier versions replay. Headings are means over one second and over five, from that of the standing human at
the begin; a path is judged sideways of the line from there in the direction that was asked for. Standing and gestures
are judged from the fifth second on, in which the body takes its own stance. Turns of four seconds, on the spot and in a
walk, end in what was done before; judged is the heading in the two seconds at the end. Fails where a walk, a gesture or
the end of a turn is off by more than 5° (means over five seconds, or those two), a walk by more than 5 % of its way
sideways, or where a stand turns by more than 3° or moves by more than 5 cm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleArgument, CsvOption, StepsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.human.concatenate import concatenate
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Sampler
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.motion.intents import Intent, Text, Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item

Float = NDArray[np.float64]

AHEAD, ASIDE = (1.0, 0.0), (0.0, 1.0)
TRAVELS: tuple[tuple[Intent, tuple[float, float]], ...] = (
    (Text("walk"), AHEAD),
    (Text("go backward"), AHEAD),
    (Velocity(0.5, 0.0, 0.0), AHEAD),
    (Velocity(0.9, 0.0, 0.0), AHEAD),
    (Velocity(-0.4, 0.0, 0.0), AHEAD),
    (Velocity(0.0, 0.2, 0.0), ASIDE),
    (Velocity(0.0, -0.2, 0.0), ASIDE),
)
IN_PLACE: tuple[Intent, ...] = (
    Text("stand still"),
    Text("wave with the right hand"),
    Text("bow"),
    Text("look to the left"),
)
STAND, WALK = Velocity(0.0, 0.0, 0.0), Velocity(0.5, 0.0, 0.0)
TURNS: tuple[tuple[Velocity, Velocity], ...] = (
    (STAND, Velocity(0.0, 0.0, 0.5)),
    (STAND, Velocity(0.0, 0.0, -0.7)),
    (WALK, Velocity(0.5, 0.0, 0.4)),
    (WALK, Velocity(0.5, 0.0, -0.4)),
)
"""What is asked before and after a turn, and the turn."""
TURN_S, BEFORE_S, AFTER_S, JUDGED_S = 4.0, 2.0, 6.0, 2.0

HEADING, SIDEWAYS = 5.0, 0.05
STANDING_HEADING, STANDING_PLACE = 3.0, 0.05
"""Limits: of a walk [degrees, share of its way]; of a stand [degrees, m]."""

STANCE_S = 5.0
FAR = 1.0
"""A walk is judged sideways where its way is longer than this [m]."""


@dataclass(frozen=True)
class Row:
    """One roll-out.

    Attributes:
        asked: the request in words.
        heading, mean_heading: greatest difference of the heading, means over 1 s and over 5 s [degrees].
        aside: sideways of the line at the end [m]; in place: greatest distance from the place.
        way: [m].
    """

    asked: str
    seed: int
    heading: float
    mean_heading: float
    aside: float
    way: float


def sampled(sampler: Sampler, intent: Intent, seconds: float, seed: int, *, straight: bool) -> Motion:
    """Motion of the live source from standing."""
    source = ModelSource(sampler, [Item(0.0, intent)], "straight", seed, straight=straight)
    parts = []
    for first in range(0, round(seconds * sampler.fps), sampler.future):
        part = source.window(first, sampler.future)
        assert part is not None
        parts.append(part)
    return concatenate(parts)


def turn_end(sampler: Sampler, around: Velocity, turn: Velocity, seed: int) -> float:
    """How far a turn ends from where it was asked to [degrees], positive where it went too far."""
    items = [Item(0.0, around), Item(BEFORE_S, turn), Item(BEFORE_S + TURN_S, around)]
    source = ModelSource(sampler, items, "straight", seed)
    frames = round((BEFORE_S + TURN_S + AFTER_S) * sampler.fps)
    parts = [source.window(first, sampler.future) for first in range(0, frames, sampler.future)]
    yaw = continuous_heading(concatenate([part for part in parts if part is not None]).root_quaternion)
    ends = float(np.degrees(yaw[-round(JUDGED_S * sampler.fps) :].mean()))
    return float(np.sign(turn.turning) * (ends - np.degrees(turn.turning * TURN_S)))


def measured(motion: Motion, asked: str, seed: int, axis: tuple[float, float] | None) -> Row:
    """Figures of a roll-out; `axis`: the direction that was asked for, of the standing human; None: in place."""
    first = 0 if axis is not None else round(STANCE_S * motion.fps)
    yaw = np.degrees(continuous_heading(motion.root_quaternion))[first:]
    second = round(motion.fps)
    begin = float(yaw[:second].mean())
    heading, mean = (
        float(np.abs(np.convolve(yaw - begin, np.ones(count) / count, "valid")).max()) for count in (second, 5 * second)
    )
    place = motion.root_position[first:, :2]
    way = float(np.linalg.norm(np.diff(place[::second], axis=0), axis=1).sum())
    away = place - place[0]
    if axis is not None:
        aside = float(abs(axis[0] * away[-1, 1] - axis[1] * away[-1, 0]))
    else:
        aside = float(np.linalg.norm(away, axis=1).max())
    return Row(asked, seed, heading, mean, aside, way)


def in_words(intent: Intent) -> str:
    """The request for the table."""
    if isinstance(intent, Text):
        return intent.text
    assert isinstance(intent, Velocity)
    return f"{intent.forward:g} {intent.left:g} m/s"


def table(rows: Sequence[Row], title: str) -> Table:
    """Worst and mean figures of each request."""
    out = Table(title=title)
    for name in ("asked", "heading, 1 s, worst", "heading, 5 s, worst", "median", "sideways, worst", "of a way of"):
        out.add_column(name, justify="right")
    for asked in dict.fromkeys(row.asked for row in rows):
        own = [row for row in rows if row.asked == asked]
        out.add_row(
            asked,
            f"{max(row.heading for row in own):.1f}°",
            f"{max(row.mean_heading for row in own):.1f}°",
            f"{np.median([row.mean_heading for row in own]):.1f}°",
            f"{max(row.aside for row in own):.2f} m",
            f"{np.mean([row.way for row in own]):.1f} m",
        )
    return out


def main(
    bundle: BundleArgument = None,
    seeds: Annotated[int, typer.Option(min=1, help="Roll-outs of each request.")] = 5,
    first: Annotated[int, typer.Option(min=0, help="First seed.")] = 100,
    walk: Annotated[float, typer.Option(min=10.0, help="Length of a walk [s].")] = 60.0,
    stand: Annotated[float, typer.Option(min=20.0, help="Length of a stand [s].")] = 600.0,
    without: Annotated[bool, typer.Option("--without", help="Without the course.")] = False,
    steps: StepsOption = None,
    csv_out: CsvOption = None,
) -> Outcome:
    """Walk and stand for minutes, and measure what was not asked for."""
    sampler = open_sampler(bundle, steps)
    console = Console(width=160)
    found: dict[bool, list[Row]] = {True: [], False: []}
    cases = [*TRAVELS, *((intent, None) for intent in IN_PLACE)]
    for intent, axis in track(cases, "requests", console=Console(stderr=True)):
        seconds = stand if intent == IN_PLACE[0] else walk
        for seed in range(first, first + seeds):
            motion = sampled(sampler, intent, seconds, seed, straight=not without)
            found[axis is not None].append(measured(motion, in_words(intent), seed, axis))
    turns = (
        [
            (f"{in_words(turn)}, {turn.turning:g} rad/s", turn_end(sampler, around, turn, seed))
            for around, turn in TURNS
            for seed in range(first, first + seeds)
        ]
        if not without
        else []
    )
    console.print(table(found[True], f"Walks of {walk:g} s"))
    console.print(table(found[False], f"Standing {stand:g} s, gestures {walk:g} s"))
    for name in dict.fromkeys(name for name, _ in turns):
        console.print(
            f"turn of {TURN_S:g} s, {name}: beyond by {', '.join(f'{off:.1f}°' for own, off in turns if own == name)}"
        )
    if csv_out is not None:
        write_csv(csv_out, [vars(row) for rows in found.values() for row in rows])
    walks, stands = found[True], [row for row in found[False] if row.asked == in_words(IN_PLACE[0])]
    heading, turned = (max(row.mean_heading for row in rows) for rows in (walks, stands))
    far = [row for row in walks if row.way > FAR]
    sideways = max((row.aside / row.way for row in far), default=0.0)
    moved = max(row.aside for row in stands)
    gestures = max(row.mean_heading for row in found[False] if row.asked != in_words(IN_PLACE[0]))
    beyond = max((abs(off) for _, off in turns), default=0.0)
    return Outcome(
        [
            Verdict(f"worst heading of a walk: {heading:.1f}° (<= {HEADING:g}°)", heading <= HEADING),
            Verdict(f"worst way sideways: {100 * sideways:.1f} % (<= {100 * SIDEWAYS:g} %)", sideways <= SIDEWAYS),
            Verdict(f"worst heading of a stand: {turned:.1f}° (<= {STANDING_HEADING:g}°)", turned <= STANDING_HEADING),
            Verdict(f"farthest from a stand: {100 * moved:.1f} cm (<= 5)", moved <= STANDING_PLACE),
            Verdict(f"worst heading of a gesture: {gestures:.1f}° (<= {HEADING:g}°)", gestures <= HEADING),
            *([Verdict(f"worst end of a turn: {beyond:.1f}° (<= {HEADING:g}°)", beyond <= HEADING)] if turns else []),
        ],
        {
            "walk_heading": heading,
            "walk_heading_median": float(np.median([row.mean_heading for row in walks])),
            "walk_sideways": sideways,
            "stand_heading": turned,
            "stand_place": moved,
            "gesture_heading": gestures,
            "turn_end": beyond if turns else None,
        },
    )
