"""How well does motion keep what is asked of single frames, and what does that cost?

Windows after histories of held-out clips are sampled with the clips' own values as constraints, of one kind at a time,
and measured as they leave the sampler: without constraints, with 0 to N corrections, with and without the control
branch where the bundle has one, and with asked features overwritten at every step where its training is named. In all
of them arms keep what is asked of elbows and hands. "5 s" is a path over five windows, each after the model's own.
Times are of the processor, in samples without constraints. Fails where the hand is 2 cm off over a whole window, or 20
cm at 2 % of its frames, the path over 5 s 10 cm, a torque limit is kept in less than 95 % of the frames, the ground
forces are more than half as far off as without constraints, or where a sample takes 1.6 times as long.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table
from threadpoolctl import threadpool_limits

from benchmarks.shared.constraint_cases import KINDS, Case, Kind, asked, cases
from benchmarks.shared.model import open_bundle
from benchmarks.shared.options import BundleArgument, CsvOption, SetOption, StepsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.bundles.bundle import CONTROL, Bundle
from flexmotion.dataset.compact_set import open_set
from flexmotion.evaluation.motions import jerk
from flexmotion.features.constraints import Constraints
from flexmotion.features.decode import Anchor
from flexmotion.human.concatenate import concatenate
from flexmotion.human.motion import Motion
from flexmotion.sampling.constraint_solver import CORRECTIONS
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.sampling.window_pose import motion_values
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.text.manners import NORMAL

Float = NDArray[np.float64]

HAND, PATH_5_S, FORCES = "right hand, whole window", "root path, 5 s", "ground forces with place"
LIMIT = "limit of the right knee"
FAR_CM = 20.0
WINDOWS = 5
LIMITS = {"hand": 2.0, "far": 0.02, "path": 10.0, "kept": 0.95, "forces": 0.5, "time": 1.6}


@dataclass(frozen=True)
class Row:
    """Errors of one kind of constraint, made in one way.

    Attributes:
        kind, unit: of constraint.
        way: of sampling.
        errors: of all asked entries.
        processor: time of a sample, in samples without constraints.
        jerk: mean of the motion's, over that without constraints.
        residual: mean force that no ground gives [% of body weight]; balanced windows.
    """

    kind: str
    unit: str
    way: str
    errors: Float
    processor: float = np.nan
    jerk: float = np.nan
    residual: float = np.nan

    @property
    def figures(self) -> dict[str, float]:
        """Mean error, 95th percentile, share beyond `FAR_CM` (of places), and time."""
        far = {"beyond_20_cm": float(np.mean(self.errors > FAR_CM))} if self.unit == "cm" else {}
        kept = {"kept": float(np.mean(self.errors <= 0))} if self.kind == LIMIT else {}
        mean, most = float(self.errors.mean()), float(np.quantile(self.errors, 0.95))
        rest = {"times": self.processor, "jerk": self.jerk, "residual": self.residual}
        return {"mean": mean, "p95": most, **far, **kept} | {k: v for k, v in rest.items() if not np.isnan(v)}


class Ways:
    """Samplers with and without corrections and branch, and the time of a sample without constraints."""

    def __init__(
        self,
        bundle: Bundle,
        steps: int | None,
        corrections: int,
        balanced: bool,
        training: Path | None,
        manner: str | None = None,
    ) -> None:
        self.manner, self.branch = manner, bundle.control(manner or NORMAL) is not None
        sampler = Sampler(bundle, steps, unjudged=True, balanced=balanced)
        self.plain = sampler
        self.all: dict[str, tuple[Sampler, int]] = {}
        for branch in (False, True) if self.branch else (False,):
            same = branch == self.branch
            own = sampler if same else Sampler(_without_branch(bundle), steps, unjudged=True, balanced=balanced)
            for count in range(corrections + 1):
                name = f"{count} corrections" + (", branch" if branch else "")
                self.all[name] = own, count
        if training is not None:
            from benchmarks.shared.overwriting import Overwriting
            from flexmotion.training.run import Run

            self.all["overwritten"] = Overwriting(_without_branch(bundle), Run(training), steps, balanced=balanced), 0

    def follows(self, way: str, kind: Kind) -> bool:
        """Whether a way follows a kind of constraint."""
        sampler = self.all[way][0]
        reached = sampler.balanced or not kind.balanced
        return sampler.bundle.control(self.manner or NORMAL) is not None or reached

    def sample(self, way: str, case: Case, constraints: Constraints, seed: int) -> tuple[Motion, float]:
        """A window, and the processor time that it took [s]."""
        sampler, corrections = self.all[way]
        sampler.corrections = corrections
        begin = time.process_time()
        window = sampler.sample(case.history, self.condition(case, constraints), seed)
        return window, time.process_time() - begin

    def condition(self, case: Case, constraints: Constraints | None = None) -> Condition:
        """What is asked of a case."""
        return Condition(case.text, manner=self.manner, constraints=constraints)


def _without_branch(bundle: Bundle) -> Bundle:
    found = Bundle(bundle.folder)
    files = {name: value for name, value in bundle.manifest.files.items() if not name.endswith(CONTROL)}
    found.manifest = bundle.manifest.model_copy(update={"files": files})
    return found


def rows(ways: Ways, kinds: Sequence[Kind], drawn: Sequence[Case], seed: int) -> list[Row]:
    """Errors of every kind without constraints and by every way."""
    sampler = ways.plain
    errors: dict[tuple[str, str], list[Float]] = defaultdict(list)
    took: dict[tuple[str, str], list[float]] = defaultdict(list)
    physics: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    for number, case in enumerate(track(drawn, "samples", transient=True)):
        begin = time.process_time()
        plain = sampler.sample(case.history, ways.condition(case), seed + number)
        base = time.process_time() - begin
        anchor = Anchor.after(case.history)
        for kind in kinds:
            constraints = asked(kind, case, sampler, plain)
            layout = constraints.layout
            for way in ("none", *(name for name in ways.all if ways.follows(name, kind))):
                window, spent = (plain, base) if way == "none" else ways.sample(way, case, constraints, seed + number)
                found = motion_values(window, anchor, layout)
                values = (constraints.values, found, constraints.mask)
                errors[kind.name, way].append(kind.error(*values, layout, sampler.body))
                took[kind.name, way].append(spent / base)
                physics[kind.name, way].append(_physics(case, window))
    units, made = {kind.name: kind.unit for kind in kinds}, []
    for (kind_name, way), found_errors in errors.items():
        (moved, beyond), (plainly, _) = (np.mean(physics[kind_name, name], axis=0) for name in (way, "none"))
        spent_on = float(np.median(took[kind_name, way]))
        all_of = np.concatenate(found_errors)
        made.append(Row(kind_name, units[kind_name], way, all_of, spent_on, float(moved / plainly), float(beyond)))
    return made


def _physics(case: Case, window: Motion) -> tuple[float, float]:
    """Mean jerk of the body's points [m/s³], and mean force that no ground gives [% of body weight]."""
    whole = concatenate([case.history.kinematics, window.kinematics])
    beyond = 0.0 if window.torques is None else float(np.linalg.norm(window.torques[:, :3], axis=1).mean())
    return float(jerk(whole).mean()), 100 * beyond / (window.body.mass * GRAVITY)


def long_paths(ways: Ways, drawn: Sequence[Case], seed: int) -> list[Row]:
    """Errors of the root's place over several windows, each after the model's own [cm]."""
    sampler, found = ways.plain, []
    for way in ("none", *ways.all):
        errors = []
        for number, case in enumerate(drawn):
            motion = case.history
            for window in range(WINDOWS):
                target = case.future[window * sampler.future : (window + 1) * sampler.future]
                none = Constraints.none(sampler.layout, sampler.body, sampler.future)
                place = Anchor.after(motion).local(target.root_position)[:, :2]
                asking = none if way == "none" else none.path(slice(None), place)
                own = replace(case, history=motion)
                made, _ = ways.sample(
                    next(iter(ways.all)) if way == "none" else way, own, asking, seed + number + window
                )
                motion = concatenate([motion, made])
                away = (made.root_position - target.root_position)[:, :2]
                errors.append(100 * np.linalg.norm(away, axis=1))
        found.append(Row(PATH_5_S, "cm", way, np.concatenate(errors)))
    return found


def table(found: Sequence[Row]) -> Table:
    """One line a kind and way."""
    made = Table("asked", "way", "mean", "p95", "> 20 cm", "times", "jerk", "residual")
    for row in found:
        figures = row.figures
        far = f"{figures['beyond_20_cm']:.1%}" if "beyond_20_cm" in figures else ""
        kept = f"kept {figures['kept']:.1%}" if "kept" in figures else far
        ratios = [f"{figures[name]:.2f}" if name in figures else "" for name in ("times", "jerk", "residual")]
        made.add_row(row.kind, row.way, f"{figures['mean']:.2f} {row.unit}", f"{figures['p95']:.2f}", kept, *ratios)
    return made


def main(
    data: SetOption,
    bundle: BundleArgument = None,
    clips: Annotated[int, typer.Option(min=1, help="Held-out clips.")] = 30,
    long: Annotated[int, typer.Option(min=0, help="Held-out clips of 5 s.")] = 6,
    corrections: Annotated[int, typer.Option(min=1, help="Most corrections that are tried.")] = 3,
    only: Annotated[str, typer.Option(help="Kinds whose names contain this.")] = "",
    seed: Annotated[int, typer.Option(min=0, help="Of clips and noise; settings were chosen with 0 and 1.")] = 2,
    balanced: Annotated[bool, typer.Option(help="Balanced windows, or those that a robot follows.")] = True,
    training: Annotated[
        Path | None, typer.Option(help="Training of the bundle: overwriting is compared, which needs its encoder.")
    ] = None,
    manner: Annotated[
        str | None, typer.Option(help="In which everything is asked for; default: the normal one.")
    ] = None,
    steps: StepsOption = None,
    csv_out: CsvOption = None,
) -> Outcome:
    """Ask for what held-out clips do, and measure what leaves the sampler."""
    ways = Ways(open_bundle(bundle), steps, corrections, balanced, training, manner)
    motions = open_set(data)
    kinds = [kind for kind in KINDS if only in kind.name]
    with threadpool_limits(limits=1, user_api="blas"):
        drawn = list(cases(motions, ways.plain, clips, ways.plain.future, seed))
        ways.sample("1 corrections", drawn[0], asked(KINDS[0], drawn[0], ways.plain, drawn[0].future), 0)
        found = rows(ways, kinds, drawn, 1000 * (seed + 1))
        if long and only in PATH_5_S:
            drawn = list(cases(motions, ways.plain, long, WINDOWS * ways.plain.future, seed))
            found += long_paths(ways, drawn, 1000 * (seed + 1))
    Console(width=120).print(table(found))
    if csv_out is not None:
        columns = ("mean", "p95", "beyond_20_cm", "kept", "times", "jerk", "residual")
        lines = [
            {"kind": row.kind, "way": row.way} | {name: row.figures.get(name) for name in columns} for row in found
        ]
        write_csv(csv_out, lines)
    return Outcome(verdicts(found, ways.branch), {f"{r.kind}, {r.way}": r.figures for r in found})


def verdicts(found: Sequence[Row], branch: bool) -> list[Verdict]:
    """What must hold of the way that a sampler goes by itself."""
    way = f"{CORRECTIONS} corrections" + (", branch" if branch else "")
    own = {row.kind: row for row in found if row.way == way}
    none = {row.kind: row for row in found if row.way == "none"}
    made = []
    if HAND in own:
        mean, far = own[HAND].figures["mean"], own[HAND].figures["beyond_20_cm"]
        made.append(Verdict(f"hand over a whole window: {mean:.1f} cm (<= 2)", mean <= LIMITS["hand"]))
        made.append(Verdict(f"hand over 20 cm off: {far:.1%} of frames (<= 2)", far <= LIMITS["far"]))
        cost = own[HAND].processor
        made.append(Verdict(f"time: {cost:.2f} of a sample without constraints (<= 1.6)", cost <= LIMITS["time"]))
    if PATH_5_S in own:
        mean = own[PATH_5_S].figures["mean"]
        made.append(Verdict(f"path over 5 s: {mean:.1f} cm (<= 10)", mean <= LIMITS["path"]))
    if LIMIT in own:
        kept = own[LIMIT].figures["kept"]
        made.append(Verdict(f"torque limit kept in {kept:.1%} of frames (>= 95)", kept >= LIMITS["kept"]))
    if FORCES in own:
        share = own[FORCES].figures["mean"] / none[FORCES].figures["mean"]
        made.append(Verdict(f"ground forces: {share:.2f} of the error without (<= .5)", share <= LIMITS["forces"]))
    return made
