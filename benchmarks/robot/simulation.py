"""Runs of the live system on the simulated robot, in lockstep: the robot nominal or perturbed, and its report."""

from __future__ import annotations

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import Driver
from flexmotion.drivers.registry import create
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.retarget.human_steps import count_steps
from flexmotion.streamer.commands.driver_options import simulation_options
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures
from flexmotion.streamer.report.report import Report, RunInfo, build_report
from flexmotion.streamer.run.session import Session

HEAVY_KG = 3.5
"""Mass of the perturbed OP3 [kg]."""


def simulator(robot: Robot, perturbed: bool, seed: int, mass_kg: float = HEAVY_KG) -> Driver:
    """The simulated robot; perturbed: with the standard perturbations (see `drivers/sim/options.py`) and a given mass.

    Args:
        robot: to simulate.
        perturbed: whether torso mass, gains, latency, friction, slope and pushes are drawn from the seed.
        seed: of the simulation.
        mass_kg: of the whole perturbed robot [kg].
    """
    options = simulation_options(perturbed, [f"total_mass={mass_kg:.3f}"] if perturbed else [])
    return create("sim", robot, **options, seed=seed)


def report_of(session: Session, record: RunTrace, human: Motion | None, seed: int, body: Body) -> Report:
    """The report of a run; `human`: motion that was followed, None where it is not known. `body`: of the human."""
    robot = session.robot
    figures = RobotFigures.of(robot, body.leg)
    info = RunInfo(robot.name, "sim", session.source.name, seed, "lockstep")
    if human is None:
        return build_report(record, info, figures)
    record.human_steps = count_steps(human)
    return build_report(record, info, figures, human=HumanTrack.of(human))
