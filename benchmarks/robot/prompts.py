"""Does the robot do what a prompt asks, through the whole live system?

Every prompt of `prompts.yaml` runs once a seed, its wordings in turn, nominal and perturbed (torso mass, gains,
latency, friction, slope, pushes, 3.5 kg), in lockstep; so does the default script. "did" is judged at the robot: a wave
is measured at its hand, walking moves it by at least .4 of the human's scaled path in the right direction, a turn turns
it by half of what the human turned; a request with an amount ("a few paces") ends as done, by the robot's progress.
Results go to --out, one line of JSON each; runs whose results are there are not made again, so a changed program needs
another file. --zero-forces sets the predicted ground forces to 0, which the
retargeter rejects: the results must be those of --no-forces, which takes the forces away and leaves contacts to heights
and speeds of the feet.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.robot.achieved import Achieved, achieved
from benchmarks.robot.model_run import NONE, PREDICTED, ZERO, follow, sampler_of
from benchmarks.robot.simulation import HEAVY_KG
from benchmarks.shared.cells import cell, middle, percent, share
from benchmarks.shared.judges import SIDES
from benchmarks.shared.options import BundleOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict
from benchmarks.shared.processes import in_processes
from benchmarks.shared.prompts import PromptKind, prompt_kinds
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import load_robot
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.commands.choice import choose_source
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item

SCRIPT = "default script"
GESTURE_S, LOCOMOTION_S = 5.0, 8.0
"""Length of a run: of a gesture, and of locomotion, which begins and ends with a stand."""
NET_PATH, TURNED = 0.4, 0.5
"""Shares of the human's walk and turn that the robot must reach."""
STANDING_UP, WALKING_UP, SCRIPT_OK = 0.9, 0.8, 0.9


@dataclass(frozen=True)
class Task:
    """One run.

    Attributes:
        kind: of prompt, or the default script.
        text: the wording; empty of the script.
        seed: of model and simulation.
        perturbed: whether the simulation is.
        forces: see `benchmarks.robot.model_run.PREDICTED`.
        bundle: hash of the model's bundle.
        seconds: length of the run [s]; 0 of the script, which has its own.
    """

    kind: str
    text: str
    seed: int
    perturbed: bool
    forces: str
    bundle: str
    seconds: float

    @property
    def key(self) -> str:
        """Tells runs apart."""
        return json.dumps(asdict(self), sort_keys=True)

    def source(self, folder: Path | None) -> ModelSource:
        """What the robot follows; `folder` is that of the bundle, None for the shipped one."""
        robot = load_robot("op3")
        if self.kind == SCRIPT:
            chosen = choose_source(robot, bundle=folder, seed=self.seed)
            if not isinstance(chosen, ModelSource):
                raise ConfigError("the default script needs a model bundle; give --bundle DIR")
            return chosen
        sampler = sampler_of(folder)
        pace = human_pace(robot, sampler.body)
        return ModelSource(sampler, [Item(0.0, Text(self.text))], f"prompt:{self.text}", self.seed, self.seconds, pace)


def run(task: Task, folder: Path | None) -> dict[str, Any]:
    """One run, judged; its task and its figures by name."""
    robot = load_robot("op3")
    found = follow(robot, task.source(folder), task.perturbed, task.seed, HEAVY_KG, task.forces)
    motion = found.report.motion
    yaw = None if found.human is None else continuous_heading(found.human.root_quaternion)
    turned = 0.0 if yaw is None else float(np.degrees(np.ptp(yaw[[0, -1]])))
    return {
        **asdict(task),
        "ok": found.report.ok,
        "upright": not motion.fell,
        "net_path": motion.net_path_ratio,
        "heading_rms_rad": motion.heading_rms_rad,
        "human_steps": motion.human_steps,
        "steps_planned": motion.steps_planned,
        "steps_inserted": motion.steps_inserted,
        "violations": found.report.limits.violations_sent,
        "faults": found.report.safety.faults,
        "human_turned": turned,
        "measured": found.human is None and any(": done, " in event.message for event in found.record.events),
        **asdict(achieved(robot, found.record)),
    }


def did(check: dict[str, Any], result: dict[str, Any]) -> bool:
    """Whether the robot did what a check asks of the human; true where the robot has no rule for any of it."""
    done = Achieved(**{name: result[name] for name in Achieved.__dataclass_fields__})
    return all(RULES[name](wanted, done, result) for name, wanted in check.items() if name in RULES)


def _walks(wanted: float, done: Achieved, result: dict[str, Any]) -> bool:
    return _went(result) and done.forward * wanted > 0


def _sideways(wanted: float, done: Achieved, result: dict[str, Any]) -> bool:
    return _went(result) and done.left * wanted > 0


def _went(result: dict[str, Any]) -> bool:
    """As far as the human, or the amount that was asked for."""
    return result["measured"] or (result["net_path"] or 0.0) >= NET_PATH


def _turns(wanted: float, done: Achieved, result: dict[str, Any]) -> bool:
    least: float = TURNED * max(abs(wanted), result["human_turned"])
    return done.turned * float(np.sign(wanted)) >= least


RULES: dict[str, Callable[[Any, Achieved, dict[str, Any]], bool]] = {
    "walks": _walks,
    "sideways": _sideways,
    "turns": _turns,
    "rises": lambda wanted, done, _: all(done.raised[side] for side in SIDES[wanted]),
    "swings": lambda wanted, done, _: (
        any(done.waved) if wanted == "any" else all(done.waved[side] for side in SIDES[wanted])
    ),
}
"""Checks of `prompts.yaml` at the robot. It cannot bow as deeply as a human; it stays where it is if it stays up."""


def done_as_asked(result: dict[str, Any], kinds: dict[str, PromptKind]) -> bool:
    """Whether a run did what was asked; the script, whether its report is ok."""
    return bool(result["ok"]) if result["kind"] == SCRIPT else did(kinds[result["kind"]].check, result)


def groups_of(results: Sequence[dict[str, Any]], kinds: dict[str, PromptKind]) -> dict[str, dict[str, Any]]:
    """Figures of each kind; medians over the runs that stayed upright."""
    found = {}
    for kind in dict.fromkeys(result["kind"] for result in results):
        own = [result for result in results if result["kind"] == kind]
        up = [result for result in own if result["upright"]]
        group: dict[str, Any] = {"runs": len(own)}
        for robot, perturbed in (("nominal", False), ("perturbed", True)):
            half = [r for r in own if r["perturbed"] is perturbed]
            group[f"upright_{robot}"] = share([r["upright"] for r in half])
            group[f"did_{robot}"] = share([r["upright"] and done_as_asked(r, kinds) for r in half])
        group["went_m"] = middle([float(np.hypot(r["forward"], r["left"])) for r in up])
        for name in ("net_path", "turned", "human_turned", "steps_planned", "human_steps"):
            group[name] = middle([r[name] for r in up])
        found[kind] = group
    return found


def table(groups: dict[str, dict[str, Any]]) -> Table:
    """One row a kind, nominal and perturbed side by side."""
    out = Table(title="At the robot: upright, did what was asked (nominal, perturbed); medians of those upright")
    for name in ("kind", "runs", "upright", "did", "net path", "went m", "turned °", "human °", "steps/human"):
        out.add_column(name)
    for kind, own in groups.items():
        out.add_row(
            kind,
            str(own["runs"]),
            *(", ".join(f"{100 * own[f'{name}_{robot}']:.0f} %" for robot in ROBOTS) for name in ("upright", "did")),
            *(cell(own[name]) for name in ("net_path", "went_m")),
            *(cell(own[name], ".0f") for name in ("turned", "human_turned")),
            f"{cell(own['steps_planned'], '.0f')}/{cell(own['human_steps'], '.0f')}",
        )
    return out


ROBOTS = ("nominal", "perturbed")


def verdicts(results: Sequence[dict[str, Any]], kinds: dict[str, PromptKind]) -> list[Verdict]:
    """The criteria, over nominal and perturbed runs together."""
    prompts = [result for result in results if result["kind"] != SCRIPT]
    standing = [result for result in prompts if not kinds[result["kind"]].moves]
    moving = [result for result in prompts if kinds[result["kind"]].moves]
    script = [bool(result["ok"]) for result in results if result["kind"] == SCRIPT and not result["perturbed"]]
    found = []
    for name, values, least in (
        ("standing and gesture prompts upright", [r["upright"] for r in standing], STANDING_UP),
        ("walking and turning prompts upright", [r["upright"] for r in moving], WALKING_UP),
        (
            "standing and gesture prompts done",
            [r["upright"] and done_as_asked(r, kinds) for r in standing],
            STANDING_UP,
        ),
        ("walking and turning prompts done", [r["upright"] and done_as_asked(r, kinds) for r in moving], WALKING_UP),
        ("default script, unperturbed: ok", script, SCRIPT_OK),
    ):
        if values:
            found.append(Verdict(f"{name}: {percent(values)} (>= {100 * least:.0f} %)", share(values) >= least))
    sent = sum(result["violations"] for result in results)
    return [*found, Verdict(f"goals outside the envelope: {sent} (0)", sent == 0)]


def tasks(wanted: Sequence[str], seeds: int, forces: str, bundle: str) -> list[Task]:
    """All runs, seed by seed, so that an unfinished benchmark has runs of every kind.

    Raises:
        ConfigError: a wanted kind is unknown.
    """
    known = [*(entry.kind for entry in prompt_kinds()), SCRIPT]
    if unknown := set(wanted) - set(known):
        raise ConfigError(f"unknown kinds {', '.join(sorted(unknown))}, expected some of: {', '.join(known)}")
    found = []
    for seed in range(seeds):
        for entry in prompt_kinds():
            text, seconds = entry.wordings[seed % len(entry.wordings)], LOCOMOTION_S if entry.moves else GESTURE_S
            found += [Task(entry.kind, text, seed, hard, forces, bundle, seconds) for hard in (False, True)]
        found += [Task(SCRIPT, "", seed, hard, forces, bundle, 0.0) for hard in (False, True)]
    return [task for task in found if not wanted or task.kind in wanted]


def done_before(out: Path) -> list[dict[str, Any]]:
    """Results in a file of an earlier run; a last line that was cut short is removed."""
    if not out.is_file():
        return []
    text = out.read_text(encoding="utf-8")
    out.write_text(text[: text.rfind("\n") + 1], encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()[: text.count("\n")]]


def main(
    bundle: BundleOption = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each kind, nominal and perturbed each.")] = 20,
    jobs: JobsOption = 1,
    kind: Annotated[list[str] | None, typer.Option(help="Only this kind; may be given again.")] = None,
    zero_forces: Annotated[bool, typer.Option("--zero-forces", help="Set predicted ground forces to 0.")] = False,
    no_forces: Annotated[bool, typer.Option("--no-forces", help="Take predicted ground forces away.")] = False,
    out: Annotated[Path | None, typer.Option(help="File of results; runs in it are not made again.")] = None,
) -> Outcome:
    """Run all prompts and judge."""
    forces = ZERO if zero_forces else NONE if no_forces else PREDICTED
    work = tasks(kind or (), seeds, forces, sampler_of(bundle).bundle.hash)
    wanted = {task.key: task for task in work}
    before = [] if out is None else done_before(out)
    found = {Task(**{name: r[name] for name in Task.__dataclass_fields__}).key: r for r in before}
    results = {key: result for key, result in found.items() if key in wanted}
    missing = [task for key, task in wanted.items() if key not in results]
    for number, result in in_processes(partial(run, folder=bundle), missing, jobs, done=len(results)):
        results[missing[number].key] = result
        if out is not None:
            with out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(result) + "\n")
    ordered = [results[task.key] for task in work]
    kinds = {entry.kind: entry for entry in prompt_kinds()}
    groups = groups_of(ordered, kinds)
    Console(width=140).print(table(groups))
    return Outcome(verdicts(ordered, kinds), groups)
