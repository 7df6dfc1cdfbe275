"""`robot.png`: the human and the robot at a few moments of the run."""

from __future__ import annotations

import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.plots.palette import HUMAN, LEFT, MUTED, RIGHT
from flexmotion.streamer.plots.solid import Camera, draw_solid, shapes
from flexmotion.streamer.plots.style import empty, new_figure

Float = NDArray[np.float64]

FRAMES = 8
_AZIMUTH_DEG, _ELEVATION_DEG = -55.0, 12.0
_SPACING = 0.87
"""Distance between neighbouring frames, in robot heights."""
_REACHING, _ABOVE = 1.25, 1.3
"""Room for raised hands, and height of the human above the robot, in robot heights."""


def draw_filmstrip(record: RunTrace, robot: Robot, motion: Motion | None = None) -> Figure:
    """The robot as simulated, or as planned without a simulation; each frame is centred on itself.

    Above it the human at the same time, scaled to the robot's height and seen from the same side.
    """
    figure = new_figure(
        11,
        4.9 if motion is not None else 2.7,
        "Human and robot",
        "the same times seen from the same side; the human's left is blue, right orange",
    )
    axes = figure.subplots()
    axes.set_axis_off()
    base, ticks = shown_base(record), moments(record, known_poses(record))
    if not len(ticks):
        empty(axes, "no tick has a known pose")
        return figure
    camera, hulls = Camera.at(_AZIMUTH_DEG, _ELEVATION_DEG), shapes(robot.model)
    data = mujoco.MjData(robot.model)
    height = standing_height(robot)
    for place, tick in enumerate(ticks):
        data.qpos[:7] = base[tick]
        data.qpos[:2] = 0.0
        data.qpos[robot.qpos_address] = record.q[tick]
        mujoco.mj_kinematics(robot.model, data)
        offset = np.array([place * _SPACING * height, 0.0])
        for collection in draw_solid(robot.model, data, hulls, camera, offset):
            axes.add_collection(collection)
        label = f"{record.time_s[tick]:.1f} s"
        axes.text(offset[0], -0.2 * height, label, ha="center", va="top", color=MUTED, fontsize=8.5)
    top = _REACHING
    if motion is not None:
        top += _ABOVE
        _humans(axes, record, motion, ticks, camera, height)
    axes.set(xlim=(-0.55 * height, (len(ticks) * _SPACING - 0.32) * height), ylim=(-0.3 * height, top * height))
    axes.set_aspect("equal")
    return figure


def shown_base(record: RunTrace) -> Float:
    """Pose of the base, by the simulation's truth, else as planned, (ticks, 7)."""
    found: Float = np.where(np.isfinite(record.true_base), record.true_base, record.base_ref)[: record.used]
    return found


def known_poses(record: RunTrace) -> NDArray[np.bool_]:
    """Ticks of a run with a known pose, (ticks,)."""
    whole = np.concatenate([shown_base(record), record.q[: record.used]], axis=1)
    return np.asarray(np.isfinite(whole).all(axis=1))


def moments(record: RunTrace, known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Up to `FRAMES` ticks, evenly over the part in which the source plays, or over the whole run."""
    playing = np.flatnonzero(known & np.isfinite(record.source_s[: record.used]))
    candidates = playing if len(playing) else np.flatnonzero(known)
    if not len(candidates):
        return candidates
    return np.unique(candidates[np.linspace(0, max(len(candidates) - 1, 0), FRAMES).round().astype(int)])


def standing_height(robot: Robot) -> float:
    """Height of a robot in its standing pose, its geoms taken as balls [m]."""
    data = mujoco.MjData(robot.model)
    data.qpos[robot.qpos_address] = robot.stand_pose
    mujoco.mj_kinematics(robot.model, data)
    extent = robot.model.geom_rbound
    return float((data.geom_xpos[:, 2] + extent).max() - (data.geom_xpos[:, 2]).min())


def _humans(
    axes: Axes, record: RunTrace, motion: Motion, ticks: NDArray[np.int64], camera: Camera, height: float
) -> None:
    scale = height / motion.body.height
    for place, tick in enumerate(ticks):
        source_s = record.source_s[tick]
        if not np.isfinite(source_s):
            continue
        frame = int(np.clip(round(source_s * motion.fps), 0, len(motion) - 1))
        pose = forward(motion[frame : frame + 1])
        centre = np.array([*pose.pelvis_position[0, :2], 0.0])
        offset = np.array([place * _SPACING * height, _ABOVE * height])
        for points, colour in limbs(pose):
            line = camera.project((points - centre) * scale)[:, :2] + offset
            axes.add_collection(LineCollection([line], colors=colour, linewidths=2.6, capstyle="round", zorder=3))


def limbs(pose: HumanKinematics) -> list[tuple[Float, str]]:
    """Polylines of the first frame with their colours: trunk and head, then legs and arms a side; (K, 3) [m]."""
    hips, shoulders = pose.hip[0].mean(axis=0), pose.shoulder[0].mean(axis=0)
    lines: list[tuple[Float, str]] = [
        (np.stack([hips, shoulders, pose.vertex[0]]), HUMAN),
        (pose.shoulder[0], HUMAN),
        (pose.hip[0], HUMAN),
    ]
    for side, colour in enumerate((LEFT, RIGHT)):
        leg = (pose.hip, pose.knee, pose.ankle, pose.heel, pose.toe)
        arm = (pose.shoulder, pose.elbow, pose.wrist, pose.hand)
        lines += [(np.stack([joint[0, side] for joint in limb]), colour) for limb in (leg, arm)]
    return lines
