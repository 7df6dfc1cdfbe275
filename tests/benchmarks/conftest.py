"""Motion whose velocities are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS


@pytest.fixture
def circling() -> Callable[..., Motion]:
    """Function (frames, forward m/s, left m/s, turning rad/s) -> motion of a stiff body at these velocities, 30 fps."""

    def make(frames: int, forward: float = 0.0, left: float = 0.0, turning: float = 0.0) -> Motion:
        fps = 30.0
        yaw = np.arange(frames) * turning / fps
        middle = yaw[:-1] + 0.5 * turning / fps
        step = np.stack(
            [
                forward * np.cos(middle) - left * np.sin(middle),
                forward * np.sin(middle) + left * np.cos(middle),
                np.zeros(frames - 1),
            ],
            axis=1,
        )
        position = np.concatenate([np.zeros((1, 3)), np.cumsum(step / fps, axis=0)]) + [0.0, 0.0, 0.9]
        half = 0.5 * yaw
        return Motion(
            fps=fps,
            root_position=position,
            root_quaternion=np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1),
            joints=np.zeros((frames, len(JOINTS))),
        )

    return make
