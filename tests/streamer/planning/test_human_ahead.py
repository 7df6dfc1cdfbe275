"""What the human of the sampled frames still does, in its own heading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.planning.human_ahead import HumanAhead

FPS = 30.0


class Sampled:
    """A source that has sampled a motion whose first frame is `first`."""

    def __init__(self, motion: Motion, first: int = 0) -> None:
        self.motion, self.first, self.fps = motion, first, motion.fps

    def sampled(self, first: int) -> Motion | None:
        """See `ModelSource.sampled`."""
        return self.motion[first - self.first :] if first >= self.first else None


def circle(speed: float, turning: float, seconds: float = 6.0, sway: float = 0.0) -> Motion:
    """A human that goes ahead [m/s] and turns [rad/s], whose pelvis sways once a gait cycle [rad]."""
    clip = default_clip()
    time = np.arange(round(seconds * FPS)) / FPS
    yaw = turning * time
    x, y = speed / turning * np.sin(yaw), speed / turning * (1.0 - np.cos(yaw))
    looks = yaw + sway * np.sin(2 * np.pi * time * FPS / 32)
    return replace(
        clip[: len(time)],
        fps=FPS,
        root_position=np.column_stack([x, y, np.full(len(time), 0.9)]),
        root_quaternion=Rotation.from_euler("z", looks[:, None]).as_quat(scalar_first=True),
        joints=np.tile(clip.joints[0], (len(time), 1)),
    )


@pytest.mark.parametrize("second", [1.5, 2.5])
def test_it_is_what_it_does_between_now_and_the_last_frame(second: float) -> None:
    motion = circle(0.5, 0.4)
    found = HumanAhead(Sampled(motion), second).coming()
    assert found is not None
    seconds, way = found
    assert seconds == pytest.approx(6.0 - second, abs=0.05)
    np.testing.assert_allclose(way, seconds * np.array([0.5, 0.0, 0.4]), atol=0.01)


def test_a_pelvis_that_sways_once_a_gait_cycle_counts_for_nothing() -> None:
    swaying = HumanAhead(Sampled(circle(0.5, 0.4, sway=0.1)), 2.0)
    seconds, way = swaying.coming() or (0.0, np.zeros(3))
    assert way[2] == pytest.approx(0.4 * seconds, abs=0.01)
    assert swaying.heading(0.6) == pytest.approx(0.4 * 2.6, abs=0.02)


def test_frames_that_were_dropped_or_are_not_sampled_are_not_known() -> None:
    motion = circle(0.5, 0.4)
    assert HumanAhead(Sampled(motion, first=60), 2.5).coming() is None
    assert HumanAhead(Sampled(motion), 5.5).coming() is None
    assert HumanAhead(Sampled(motion, first=60), 1.5).heading(0.6) is None
    assert HumanAhead(Sampled(motion), 5.5).heading(0.6) is None
