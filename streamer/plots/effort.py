"""`effort.png`: the human's relative effort beside the robot's, joint by joint."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flexmotion.configs.robot import Robot
from flexmotion.streamer.plots.palette import HUMAN, MUTED
from flexmotion.streamer.plots.panels import joint_columns, joint_panels
from flexmotion.streamer.plots.style import empty, new_figure, side_colour
from flexmotion.streamer.report.torque_profile import TorqueProfile


def draw_effort(profile: TorqueProfile, robot: Robot) -> Figure:
    """Torque over weight times leg length of human (purple) and robot (coloured by side), with their correlation.

    Each has its own scale, so that shapes are compared.
    """
    rows = max(map(len, joint_columns(robot)))
    overall = "-" if profile.correlation is None else f"{profile.correlation:.2f}"
    figure = new_figure(
        11,
        1.0 + 1.35 * rows,
        "Relative effort, human and robot",
        "torque over weight times leg length, mean over 0.16 s; purple: human; right corner: greatest of each, then "
        f"their correlation; all joints together: {overall}",
        layout=False,
    )
    panels = joint_panels(figure, robot, above=0.75, sharex=False, sharey=False)
    for joint, axes in panels.items():
        found = profile.joints.get(robot.joint_names[joint])
        if found is None:
            empty(axes, "not compared")
            continue
        beside = axes.twinx()
        beside.grid(visible=False)
        axes.plot(profile.t, found.human, color=HUMAN, linewidth=1.1)
        beside.plot(profile.t, found.robot, color=side_colour(robot.joint_names[joint]), linewidth=0.9)
        for one, values in ((axes, found.human), (beside, found.robot)):
            one.set_ylim(0, 1.15 * max(float(np.max(values)), 1e-3))
            one.set_yticks([])
        correlation = "-" if found.correlation is None else f"{found.correlation:.2f}"
        scales = f"to {np.max(found.human):.3f} and {np.max(found.robot):.3f}; {correlation}"
        axes.text(0.99, 1.03, scales, transform=axes.transAxes, ha="right", va="bottom", fontsize=7.5, color=MUTED)
        axes.set_xlim(profile.t[0], profile.t[-1])
    return figure
