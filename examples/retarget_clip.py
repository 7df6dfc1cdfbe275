"""Retarget a motion file to the joint angles of a robot, and print how far each joint moves.

python examples/retarget_clip.py walk.bvh op3
"""

from __future__ import annotations

import sys

import numpy as np

import flexmotion as fm


def main(file: str, name: str) -> None:
    robot = fm.open_robot(name)
    trajectory = fm.retarget_motion(fm.load_motion(file), robot)
    low, high = np.degrees(trajectory.q.min(axis=0)), np.degrees(trajectory.q.max(axis=0))
    print(f"{len(trajectory)} rows at {trajectory.rate_hz:g} Hz, {trajectory.steps} steps")
    for joint, least, most in zip(robot.joint_names, low, high, strict=True):
        print(f"{joint:14s} {least:7.1f}° to {most:6.1f}°")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2])
