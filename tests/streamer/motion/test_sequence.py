"""Clips joined to one motion, without jumps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.motion.sequence import sequence

FPS = 30.0


def walk(seconds: float, speed: float, yaw_deg: float, start: tuple[float, float] = (0, 0), **body: float) -> Motion:
    """Straight ahead with heading `yaw_deg`; all joints have a value that identifies the clip."""
    frames = round(seconds * FPS) + 1
    yaw = np.radians(yaw_deg)
    along = speed * np.arange(frames) / FPS
    path = np.stack([start[0] + along * np.cos(yaw), start[1] + along * np.sin(yaw), np.full(frames, 0.9)], axis=1)
    turn = Rotation.from_euler("z", np.full((frames, 1), yaw)).as_quat(scalar_first=True)
    return Motion(FPS, path, turn, np.full((frames, len(JOINTS)), yaw / 10), Body(**body))


def test_one_clip_is_itself() -> None:
    clip = walk(1, 1, 0)
    assert sequence([(0.0, clip)], None, 8).root_position == pytest.approx(clip.root_position)


def test_the_next_clip_starts_at_the_position_and_heading_of_the_last() -> None:
    whole = sequence([(0.0, walk(2, 1.0, 0)), (1.0, walk(2, 1.0, 130, start=(7, 7)))], None, 8)
    assert whole.duration == pytest.approx(3.0)
    assert continuous_heading(whole.root_quaternion) == pytest.approx(np.zeros(len(whole)), abs=1e-9)
    assert whole.root_position[-1] == pytest.approx([3.0, 0.0, 0.9], abs=1e-6)
    steps = np.linalg.norm(np.diff(whole.root_position, axis=0), axis=1)
    assert steps.max() <= 1.05 / FPS
    assert np.abs(np.diff(whole.joints, axis=0)).max() < 1.2 * np.radians(13) / 9


def test_a_gap_holds_the_last_pose_and_the_end_cuts() -> None:
    clip = walk(1, 1.0, 0)
    whole = sequence([(0.0, clip), (3.0, walk(2, 1.0, 0))], 4.0, 8)
    assert whole.duration == pytest.approx(4.0)
    still = whole.root_position[round(1.5 * FPS) : round(2.9 * FPS)]
    assert np.ptp(still, axis=0) == pytest.approx(np.zeros(3))
    assert whole.root_position[-1, 0] == pytest.approx(2.0, abs=0.02)


def test_a_taller_human_is_scaled_to_the_first() -> None:
    tall = walk(2, 1.0, 0, height=2.0)
    whole = sequence([(0.0, walk(1, 0.0, 0, height=1.0)), (1.0, tall)], None, 4)
    assert whole.body.height == 1.0
    assert whole.root_position[-1, 0] == pytest.approx(1.0, rel=1e-6)


def test_quaternions_keep_their_sign() -> None:
    turned = walk(1, 0, 170)
    flipped = Motion(FPS, turned.root_position, -turned.root_quaternion, turned.joints)
    whole = sequence([(0.0, walk(1, 0, 0)), (1.0, flipped)], None, 8)
    assert (np.sum(whole.root_quaternion[1:] * whole.root_quaternion[:-1], axis=1) > 0.9).all()


def test_overlong_blend_of_a_short_clip() -> None:
    whole = sequence([(0.0, walk(1, 1, 0)), (1.0, walk(0.1, 1, 0))], None, 20)
    assert np.isfinite(whole.root_position).all()
    assert whole.duration == pytest.approx(1.1)
