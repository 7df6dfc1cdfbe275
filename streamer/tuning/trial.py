"""`try_out`: a robot with other numbers in its file follows one motion, in lockstep on the simulated robot."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from flexmotion.configs.errors import ConfigError, FlexMotionError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import load_stream
from flexmotion.configs.yaml_numbers import Place
from flexmotion.drivers.sim.options import standard_options
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Sampler
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.api import load_motion, open_driver, open_sampler, open_session, open_source
from flexmotion.streamer.motion.intents import Clip
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.sources import Performance
from flexmotion.streamer.outcome import outcome
from flexmotion.streamer.report.likeness import TURN_RAD, WAY_M
from flexmotion.streamer.tuning.clip_list import TuningClip
from flexmotion.streamer.tuning.figures import AskedWay, RunFigures
from flexmotion.streamer.tuning.variant import variant

Values = tuple[tuple[Place, float], ...]
"""Numbers of a robot file by place."""


@dataclass(frozen=True)
class Trial:
    """One run of a candidate.

    Attributes:
        file: the robot file as it is.
        values: the candidate's numbers.
        clip: what is followed.
        asked: its way, from `asked_way`.
        seed: of the simulation and of what the model draws.
    """

    file: Path
    values: Values
    clip: TuningClip
    asked: AskedWay
    seed: int


@dataclass(frozen=True)
class Question:
    """Asks for the way of a clip of a robot, whose model draws from the seed."""

    file: Path
    clip: TuningClip
    seed: int


def try_out(trial: Trial) -> RunFigures:
    """Run a trial; whatever a candidate's numbers break counts as a fall, with the reason."""
    clip = trial.clip
    try:
        with variant(trial.file, dict(trial.values)) as robot:
            source = source_of(clip, robot, trial.seed)
            driver = open_driver("sim", robot, **standard_options(clip.perturbed), seed=trial.seed)
            session = open_session(
                robot, driver, source, settings=load_stream(), seed=trial.seed, seconds=source.seconds
            )
            session.run()
            return RunFigures.of(clip.name, clip.kind, clip.perturbed, outcome(session), trial.asked)
    except Exception as error:  # numbers may break any formula; the file's own are measured first, and must run
        return died(trial, f"{type(error).__name__}: {error}")


def died(trial: Trial, reason: str = "its process died") -> RunFigures:
    """The figures of a trial that has none."""
    clip = trial.clip
    return RunFigures.failed(clip.name, clip.kind, clip.perturbed, " ".join(reason.split()))


def asked_way(question: Question) -> AskedWay | str:
    """The way of a clip's human at its own pace, or why the clip cannot be measured on."""
    try:
        return _asked(question)
    except FlexMotionError as error:
        return f"{question.clip.name}: {error}"


def source_of(clip: TuningClip, robot: Robot, seed: int, *, slowed: bool = True) -> Performance:
    """The source of a clip.

    Args:
        robot: that follows it.
        seed: of what a model draws.
        slowed: whether a model's human is slowed to the robot's pace.

    Raises:
        FlexMotionError: a file cannot be read, the project comes without a model, or the model does not understand.
    """
    first = clip.items[0].intent
    if isinstance(first, Clip):
        followed: Motion | tuple[Item, ...] = _motion(first.name) if clip.sort == "clip" else clip.items
        found = open_source(robot, followed, name=clip.name, seconds=clip.seconds)
        assert isinstance(found, Performance)
        return found
    sampler = _sampler()
    pace = human_pace(robot, sampler.body) if slowed else None
    source = ModelSource(sampler, clip.items, clip.name, seed, clip.seconds, pace)
    if source.is_measured or source.seconds is None:
        raise ConfigError("its end is not known before the run; give seconds, and words without amounts")
    if refused := [heard.failure for heard in source.heard_items if heard.failure is not None]:
        raise ConfigError(refused[0])
    return source


def _asked(question: Question) -> AskedWay:
    human = source_of(question.clip, Robot(question.file), question.seed, slowed=False).human()
    yaw = continuous_heading(human.root_quaternion)
    way = float(np.linalg.norm(human.root_position[-1, :2] - human.root_position[0, :2]))
    straight = float(np.abs(yaw - yaw[0]).max()) < TURN_RAD
    return AskedWay(way_m=way if straight and way >= WAY_M else None)


@lru_cache(maxsize=32)
def _motion(file: str) -> Motion:
    """The motion in a file, read once a process."""
    return load_motion(file)


@lru_cache(maxsize=1)
def _sampler() -> Sampler:
    """The shipped model, opened once a process."""
    return open_sampler()
