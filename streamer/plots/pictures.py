"""`write_plots`: every picture of a run; each has a module of its own."""

from __future__ import annotations

from pathlib import Path

from flexmotion.configs.robot import Robot
from flexmotion.human.motion import Motion
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.plots.effort import draw_effort
from flexmotion.streamer.plots.filmstrip import draw_filmstrip
from flexmotion.streamer.plots.footsteps import draw_footsteps
from flexmotion.streamer.plots.style import save, styled
from flexmotion.streamer.plots.timeline import draw_timeline
from flexmotion.streamer.plots.torque import draw_torque
from flexmotion.streamer.plots.tracking import draw_tracking
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures
from flexmotion.streamer.report.torque_profile import TorqueProfile


def write_plots(
    folder: Path,
    record: RunTrace,
    robot: Robot,
    figures: RobotFigures,
    motion: Motion | None = None,
    profile: TorqueProfile | None = None,
) -> list[Path]:
    """Draw every picture of a run into `folder`, which is made if missing; returns the PNGs, in order of the page.

    Args:
        motion: of the human; None if unknown.
        profile: the human's torques beside the robot's; None if unknown: no picture of them.
    """
    folder.mkdir(parents=True, exist_ok=True)
    human = HumanTrack.of(motion) if motion is not None else None
    with styled():
        drawn = {
            "robot.png": draw_filmstrip(record, robot, motion),
            "footsteps.png": draw_footsteps(record, robot, figures, human),
            "timeline.png": draw_timeline(record, figures, human),
            "tracking.png": draw_tracking(record, robot),
            "torque.png": draw_torque(record.torque, record.qd, robot, measured=record.torque_source == "servos"),
        }
        if profile is not None:
            drawn["effort.png"] = draw_effort(profile, robot)
        return [save(figure, folder / name) for name, figure in drawn.items()]
