"""Does the robot stay up while it mirrors clips that come over a bad wire, and how soon do its feet follow?

Each clip is sent at 30 frames/s, with loss and jitter, to a run in lockstep. Beside it the error of what the model
foresees, against the speed that is held and dies away, both against the poses that came later.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.optimize import linear_sum_assignment

from benchmarks.shared.at_use import AtUse
from benchmarks.shared.outcome import Outcome, Verdict
from benchmarks.shared.wire import mirrored, over_the_wire
from flexmotion.configs.errors import ConfigError
from flexmotion.drivers.realtime.ring import Reader
from flexmotion.human.concatenate import concatenate
from flexmotion.human.contacts import ContactDetector
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.importers import read
from flexmotion.streamer import api
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.mirror.clip_frames import clip_frames
from flexmotion.streamer.mirror.intake import Intake
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.motion.person_channel import pose_of
from flexmotion.streamer.motion.prediction import HeldSpeed, ModelPrediction, Predictor
from flexmotion.streamer.outcome import outcome
from flexmotion.streamer.run.session import Session

Float = NDArray[np.float64]

BEGIN_S, END_S = 2.5, 2.0
"""The robot stands when the first frame comes; it comes to a stand after the last one [s]."""
AHEAD_S = (0.1, 0.2, 0.3, 0.5, 1.0)
EARLY_S, LATEST_S = 0.4, 1.2
"""A step of the robot belongs to one of the human that it is at most so much earlier (foreseen), or later than [s]."""
UNPAIRED_S = 1e3
"""What a step without a partner counts: more than all delays of a clip."""
LEAST_SWING_S = 0.2
"""Shorter swings are shuffles, which a robot leaves out [s]."""
BETTER, SOON_S = 0.8, 0.6


def held_out(folder: Path, count: int) -> list[Path]:
    """So many of a folder's BVH files whose hash keeps them from training, spread over their names.

    Raises:
        ConfigError: there are none.
    """
    files = [
        file
        for file in sorted(folder.rglob("*.bvh"))
        if 12 <= int(hashlib.sha256(file.name.encode()).hexdigest(), 16) % 100 <= 21
    ]
    if not files:
        raise ConfigError(f"--clips: {folder}: no held-out BVH file in it")
    places = np.linspace(0, len(files) - 1, min(count, len(files))).round().astype(int)
    return [files[place] for place in places]


def lifts(contacts: NDArray[np.bool_], rate_hz: float, least_s: float = 0.0) -> list[tuple[int, float]]:
    """Side and time [s] of each beginning of a swing of at least a duration, by flags (T, 2)."""
    found: list[tuple[int, float]] = []
    for side in (0, 1):
        free = np.concatenate([[False], ~contacts[:, side], [False]]).astype(int)
        begins, ends = np.flatnonzero(np.diff(free) == 1), np.flatnonzero(np.diff(free) == -1)
        found += [(side, float(b) / rate_hz) for b, e in zip(begins, ends, strict=True) if (e - b) / rate_hz >= least_s]
    return found


def feet_delays(motion: Motion, record: RunTrace, begin_s: float) -> tuple[list[float], int]:
    """How much later than the human the robot lifted each foot [s], and how many steps it left out.

    Steps count from the moment at which the person is followed. Those of a foot are paired one to one (`paired`): a
    robot that steps in its own cadence makes some that are of no step of the human.
    """
    contacts, _ = ContactDetector().detect(forward(motion), motion.fps)
    followed = np.flatnonzero(record.source_s >= 0.0)
    begins = followed[0] / record.rate_hz if len(followed) else np.inf
    robot, delays, dropped = lifts(record.contact_ref, record.rate_hz), [], 0
    for side in (0, 1):
        steps = [begin_s + at for foot, at in lifts(contacts, motion.fps, LEAST_SWING_S) if foot == side]
        human = [at for at in steps if at >= begins]
        found = paired(human, [when for foot, when in robot if foot == side])
        delays += found
        dropped += len(human) - len(found)
    return delays, dropped


def paired(human: Sequence[float], robot: Sequence[float]) -> list[float]:
    """Delays [s] of the robot's steps of a foot behind the human's: as many pairs as can be, then the nearest in time.

    As many as can be: a robot that is late by nearly a stride is not paired with the human's next step, for which the
    first one would be left without.
    """
    delays = np.subtract.outer(np.asarray(robot, float), np.asarray(human, float)).T
    far = (delays < -EARLY_S) | (delays >= LATEST_S)
    # The squares tell pairs apart that cross from those that do not, whose sum of delays is the same.
    rows, columns = linear_sum_assignment(np.where(far, UNPAIRED_S, np.abs(delays) + 1e-3 * delays**2))
    return [float(delays[row, column]) for row, column in zip(rows, columns, strict=True) if not far[row, column]]


def points(motion: Motion) -> Float:
    """Joint centres of trunk and limbs, (T, 14, 3) [m]."""
    human = forward(motion)
    sided = [getattr(human, name) for name in ("knee", "ankle", "toe", "shoulder", "elbow", "wrist")]
    return np.concatenate([*sided, human.vertex[:, None], human.pelvis_position[:, None]], axis=1)


def foreseen_errors(poses: Motion, predictor: Predictor, first: int = 0, every: int = 10) -> Float:
    """Mean distance of the joints from where they came to be, by moment and `AHEAD_S`, (M, 5) [m].

    Args:
        poses: of a person.
        predictor: which is judged.
        first: frame at which it may first be asked: predictors that are compared are asked at the same moments.
        every: frames between moments.
    """
    ahead = np.round(np.array(AHEAD_S) * poses.fps).astype(int)
    true, errors = points(poses), []
    for now in range(max(first, predictor.remembers), len(poses) - ahead[-1], every):
        known = poses[now + 1 - predictor.remembers : now + 1]
        found = points(predictor(known, int(ahead[-1])))
        errors.append(np.linalg.norm(found[ahead - 1] - true[now + ahead], axis=-1).mean(axis=1))
    return np.array(errors).reshape(-1, len(ahead))


class PosesKept:
    """All poses of a person in a run."""

    def __init__(self) -> None:
        self.poses: list[Motion] = []
        self._reader: Reader | None = None

    def watch(self, session: Session) -> None:
        """Take what is new; to be called before each tick."""
        assert isinstance(session.source, MirrorSource)
        self._reader = self._reader or session.source.channel.reader()
        self.poses.extend(pose_of(row).motion for row in self._reader.read())


def _mean_cm(metres: list[float]) -> float | None:
    return round(100.0 * float(np.mean(metres)), 2) if metres else None


def main(
    clips: Annotated[Path, typer.Option(help="Folder of BVH files; those held out from training are taken.")],
    count: Annotated[int, typer.Option(min=1, help="Number of clips.")] = 20,
    lost: Annotated[float, typer.Option(min=0.0, max=0.9, help="Share of frames that do not arrive.")] = 0.05,
    jitter_s: Annotated[float, typer.Option(min=0.0, max=0.2, help="Mean delay of a frame, exponential [s].")] = 0.005,
    seed: Annotated[int, typer.Option(min=0, help="Of wire and simulation.")] = 0,
) -> Outcome:
    """Mirror each clip."""
    sampler = api.open_sampler()
    predictors: dict[str, Predictor] = {"model": ModelPrediction(sampler), "held speed": HeldSpeed(sampler.fps)}
    first = max(predictor.remembers for predictor in predictors.values())
    errors: dict[str, list[Float]] = {name: [] for name in predictors}
    rows: list[dict[str, Any]] = []
    for number, file in enumerate(held_out(clips, count)):
        motion = read(file).motion
        frames = clip_frames(motion)
        arrivals = over_the_wire(frames, begin_s=BEGIN_S, lost=lost, jitter_s=jitter_s, seed=seed + number)
        kept, used = PosesKept(), AtUse(motion, BEGIN_S)

        def watch(session: Session, _intake: Intake, kept: PosesKept = kept, used: AtUse = used) -> None:
            kept.watch(session)
            used.watch(session)

        session, intake = mirrored(arrivals, BEGIN_S + frames[-1][0] + END_S, seed=seed + number, each_tick=watch)
        found = outcome(session)
        delays, dropped = feet_delays(motion, found.record, BEGIN_S)
        rows.append(
            {
                "clip": file.stem,
                "fell": found.report.motion.fell,
                "violations": found.report.limits.violations_sent,
                "delays_s": [round(delay, 3) for delay in delays],
                "dropped": dropped,
                "poses": len(kept.poses),
                "at_use_cm": {"hands": _mean_cm(used.hands), "feet": _mean_cm(used.feet)},
                "refused": sum(intake.person.refused.values()),
            }
        )
        if kept.poses:
            for name, predictor in predictors.items():
                errors[name].append(foreseen_errors(concatenate(kept.poses), predictor, first))
        typer.echo(f"{file.stem}: {rows[-1]}", err=True)
    return judged(rows, {name: np.concatenate(found) for name, found in errors.items()})


def judged(rows: list[dict[str, Any]], errors: dict[str, Float]) -> Outcome:
    """Figures and verdicts of all clips."""
    mean = {name: 100.0 * found.mean(axis=0) for name, found in errors.items()}
    table = Table("foreseen by", *(f"{ahead:g} s" for ahead in AHEAD_S), title="Error of the joints [cm]")
    for name, values in mean.items():
        table.add_row(name, *(f"{value:.1f}" for value in values))
    Console(width=120).print(table)
    delays = np.array([delay for row in rows for delay in row["delays_s"]])
    p50, p95 = np.percentile(delays, [50, 95]) if len(delays) else (np.nan, np.nan)
    dropped = sum(row["dropped"] for row in rows)
    upright = sum(not row["fell"] for row in rows)
    violations = sum(row["violations"] for row in rows)
    at = AHEAD_S.index(0.3)
    share = float(mean["model"][at] / mean["held speed"][at])
    verdicts = [
        Verdict(f"upright: {upright} of {len(rows)}", upright == len(rows)),
        Verdict(f"goals outside the envelope: {violations} (0)", violations == 0),
        Verdict(
            f"feet follow after p50 {p50:.2f} s, p95 {p95:.2f} s (<= {SOON_S}); {dropped} of {len(delays) + dropped} "
            "steps left out",
            bool(p95 <= SOON_S),
        ),
        Verdict(f"model's error at .3 s over that of held speed: {share:.2f} (<= {BETTER})", share <= BETTER),
    ]
    figures = {
        "clips": rows,
        "ahead_s": list(AHEAD_S),
        "error_cm": {name: [round(float(value), 2) for value in values] for name, values in mean.items()},
        "steps": len(delays),
        "feet_delay_s": {"p50": float(p50), "p95": float(p95)},
    }
    return Outcome(verdicts, figures)
