"""A run of the live system that follows a model, in lockstep on the simulated robot: `follow`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.robot.simulation import report_of, simulator
from benchmarks.shared.model import open_sampler
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import load_stream
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.sources import Source
from flexmotion.streamer.report.report import Report
from flexmotion.streamer.run.played_human import human_motion
from flexmotion.streamer.run.session import Session

PREDICTED, ZERO, NONE = "predicted", "zero", "none"
"""Ground forces that reach the retargeter: the model's own, zeros, none."""


@dataclass(frozen=True)
class ModelRun:
    """One run: what was recorded, the human motion as it was played, and the report.

    `human` is None of a request with an amount ("a few steps"): the robot's progress ended it.
    """

    record: RunTrace
    human: Motion | None
    report: Report


class AlteredForces:
    """A source whose predicted ground forces are set to zero, or taken away."""

    def __init__(self, source: Source, forces: str) -> None:
        self.source, self.forces = source, forces
        self.name, self.fps = source.name, source.fps

    def window(self, first_frame: int, frames: int) -> Motion | None:
        """See `Source.window`."""
        motion = self.source.window(first_frame, frames)
        if motion is None or motion.wrenches is None:
            return motion
        if self.forces == ZERO:
            return replace(motion, wrenches=np.zeros_like(motion.wrenches), contacts=np.zeros((len(motion), 2), bool))
        return replace(motion, wrenches=None, contacts=None)


@lru_cache
def sampler_of(bundle: Path | None) -> Sampler:
    """The model of a bundle, or the shipped one; opened once a process."""
    return open_sampler(bundle, balanced=False)


def follow(
    robot: Robot, source: ModelSource, perturbed: bool, seed: int, mass_kg: float, forces: str = PREDICTED
) -> ModelRun:
    """Follow a model to the end of its script.

    Args:
        robot: that follows.
        source: of human motion.
        perturbed: see `simulator`.
        seed: of the simulation.
        mass_kg: of the perturbed robot [kg].
        forces: see `PREDICTED`.
    """
    driver = simulator(robot, perturbed, seed, mass_kg)
    followed = source if forces == PREDICTED else AlteredForces(source, forces)
    session = Session(robot, driver, followed, load_stream(), source.seconds)
    record = session.run()
    human = human_motion(source, record)
    return ModelRun(record, human, report_of(session, record, human, seed, source.body))
