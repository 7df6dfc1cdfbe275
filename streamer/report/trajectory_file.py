"""Files of a retargeted motion for other tools."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.streamer.planning.offline import Trajectory

BASE_COLUMNS = ("base_x", "base_y", "base_z", "base_qw", "base_qx", "base_qy", "base_qz")
CONTACT_COLUMNS = ("contact_left", "contact_right")


def write_trajectory(file: Path, trajectory: Trajectory, robot: Robot) -> None:
    """Write `file` in the format of its suffix, one of `WRITERS`; its folder must exist."""
    WRITERS[file.suffix.lower()](file, trajectory, robot)


def model_order(robot: Robot) -> NDArray[np.intp]:
    """Joint indices in the order of the robot's MJCF."""
    return np.argsort(robot.qpos_address)


def _write_csv(file: Path, trajectory: Trajectory, robot: Robot) -> None:
    order = model_order(robot)
    header = ["time_s", *(robot.joint_names[i] for i in order), *BASE_COLUMNS, *CONTACT_COLUMNS]
    t = np.arange(len(trajectory)) / trajectory.rate_hz
    table = np.column_stack([t, trajectory.q[:, order], trajectory.base, trajectory.contacts])
    formats = ["%.6f"] * (table.shape[1] - 2) + ["%d"] * 2
    np.savetxt(file, table, fmt=formats, delimiter=",", header=",".join(header), comments="")


def _write_npz(file: Path, trajectory: Trajectory, robot: Robot) -> None:
    order = model_order(robot)
    arrays: dict[str, Any] = {
        "robot": robot.name,
        "rate_hz": trajectory.rate_hz,
        "joint_names": np.array([robot.joint_names[i] for i in order]),
        "joint_position": trajectory.q[:, order],
        "joint_velocity": trajectory.qd[:, order],
        "joint_torque": trajectory.torque[:, order],
        "base_position": trajectory.base[:, :3],
        "base_quaternion": trajectory.base[:, 3:],
        "contact": trajectory.contacts,
        "foot": trajectory.feet,
        "com": trajectory.com,
        "zmp": trajectory.zmp,
        "dcm": trajectory.dcm,
        "source_s": trajectory.source_s,
    }
    with file.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **arrays)


WRITERS: dict[str, Callable[[Path, Trajectory, Robot], None]] = {".csv": _write_csv, ".npz": _write_npz}
