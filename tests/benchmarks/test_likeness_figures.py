from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.shared.likeness_figures import LikenessFigures, pitch_range, spurious_swings
from flexmotion.configs.robot import load_robot
from flexmotion.human.kinematics import forward
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.arm_chain import ArmChain
from flexmotion.streamer.report.directions import angle, human_directions, pitch, robot_directions, trunk_of

RATE = 125.0


def segments(angle: np.ndarray) -> np.ndarray:
    """Segments of both arms hanging, but the right forearm raised forward by an angle (T,), (T, 2, 2, 3)."""
    out = np.tile([0.0, 0.0, -1.0], (len(angle), 2, 2, 1))
    out[:, 1, 1] = np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], axis=1)
    return out


def test_errors_are_angles_between_directions() -> None:
    turned = np.array([0.0, 1e-4, 0.5, np.pi / 2, np.pi])
    found = angle(segments(turned), segments(0 * turned))
    np.testing.assert_allclose(found[:, 1, 1], turned, atol=1e-9)
    assert found[:, 0].max() == found[:, 1, 0].max() == 0.0


def test_an_arm_that_swings_by_itself_is_counted_once_a_swing() -> None:
    t = np.arange(1000) / RATE
    swing = np.pi * (np.clip((t - 2.0) / 0.4, 0, 1) - np.clip((t - 5.0) / 0.4, 0, 1))
    assert spurious_swings(segments(swing), segments(0 * t), RATE) == 2
    assert spurious_swings(segments(0 * t), segments(swing), RATE) == 0


def test_a_swing_that_the_human_makes_is_none_even_late() -> None:
    t = np.arange(1000) / RATE
    human, late = (2.0 * (1 - np.cos(np.clip(6 * (t - lag), 0, 12 * np.pi))) / 2 for lag in (1.0, 1.2))
    assert spurious_swings(segments(late), segments(human), RATE) == 0


def test_a_forearm_that_moves_with_the_humans_upper_arm_is_no_swing() -> None:
    """The arm as a whole moves as the human's does; which of its segments is a matter of the joints."""
    t = np.arange(500) / RATE
    swing = 1.5 * np.clip((t - 2.0) / 0.4, 0, 1)
    human = segments(0 * t)
    human[:, 1, 0] = segments(swing)[:, 1, 1]
    assert spurious_swings(segments(swing), human, RATE) == 0


@pytest.mark.parametrize("yaw", [0.0, 2.0, -3.0])
@pytest.mark.parametrize("lean", [-0.4, 0.0, 0.7, 1.4, 1.8])
def test_pitch_is_the_tilt_forward_in_the_torsos_own_heading(lean: float, yaw: float) -> None:
    base = np.array([[0, 0, 0.3, *Rotation.from_euler("ZYX", [yaw, lean, 0.0]).as_quat(scalar_first=True)]])
    assert pitch(trunk_of(base, np.zeros((1, 2))))[0] == pytest.approx(lean)


def test_rare_extremes_do_not_decide_a_range() -> None:
    tilt = np.linspace(0.0, 1.0, 1001)
    tilt[[0, 500]] = -20.0, 20.0
    assert pitch_range(tilt) == pytest.approx(0.96, abs=0.01)


def test_directions_of_human_and_robot_are_seen_from_the_trunk() -> None:
    robot, human = load_robot("op3"), human_directions(forward(default_clip()))
    np.testing.assert_allclose(np.linalg.norm(human.segments, axis=-1), 1.0)
    base = np.array([[0, 0, 0.3, *Rotation.from_euler("ZYX", [1.0, 0.5, 0.0]).as_quat(scalar_first=True)]])
    own = robot_directions(ArmChain(robot), robot.stand_pose[None], trunk_of(base, np.zeros((1, 2))))
    # Arms hang along the torso, whatever its pose.
    assert (own.segments[..., 2] < -0.95).all() and pitch(own.trunk)[0] == pytest.approx(0.5)
    between = human.at(np.arange(len(human.trunk), dtype=float), np.array([-1.0, 10.0, 1e9]))
    np.testing.assert_allclose(between.segments, human.segments[[0, 10, -1]], atol=1e-12)


def test_a_human_who_hardly_bends_has_no_share_of_pitch() -> None:
    figures = LikenessFigures(10.0, 10.0, 0, 4.0, 5.0, 5.0)
    assert figures.pitch_share is None
    assert LikenessFigures(10.0, 10.0, 0, 30.0, 50.0, 40.0).pitch_share == pytest.approx(0.75)
