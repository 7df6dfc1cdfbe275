from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flexmotion.human.motion import Motion
from flexmotion.retarget.footholds import Scaling
from flexmotion.retarget.human import HumanWindow
from flexmotion.retarget.posture import follower, human_trunk, quiet_share, trunk_targets
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.schedule import Schedule

ROWS = 125


@pytest.fixture
def standing(retargeter: Retargeter) -> Schedule:
    ticks = np.arange(ROWS, dtype=float)
    feet = retargeter.body.home_feet
    return Schedule.of(feet, -1e9, 0.0, [], ticks, np.full(ROWS, 0.5), 125.0, retargeter.swings)


@pytest.fixture
def trunk(retargeter: Retargeter, standing: Schedule, window: Callable[[Motion], HumanWindow]) -> Callable:
    """Function motion -> targets of the trunk of a robot that stands, (T, 4)."""

    def make(motion: Motion, schedule: Schedule | None = None, pitch: float = 0.0) -> np.ndarray:
        scaling = Scaling(retargeter.body.leg_length / motion.body.leg, 0.0, motion.body.segments.hip_width)
        seconds = np.arange(ROWS) / 125.0
        return human_trunk(
            retargeter.gait,
            retargeter.bend,
            schedule or standing,
            window(motion),
            scaling,
            seconds,
            retargeter.follower,
            (pitch, 0.0),
        )

    return make


def test_without_a_human_the_trunk_is_upright_over_the_feet(retargeter: Retargeter, standing: Schedule) -> None:
    targets = trunk_targets(retargeter.gait, standing)
    np.testing.assert_allclose(targets, np.tile([retargeter.gait.stand_hip_height, 0, 0, 0], (ROWS, 1)))


def test_a_standing_human_gives_a_standing_robot(
    retargeter: Retargeter, trunk: Callable, stand: Callable[..., Motion]
) -> None:
    targets = trunk(stand(40))
    assert (targets[:, 0] <= retargeter.gait.stand_hip_height + 1e-12).all()
    np.testing.assert_allclose(targets[:, 1:3], 0.0, atol=0.05)


def test_a_bow_tilts_the_trunk_within_its_bounds(
    retargeter: Retargeter, trunk: Callable, stand: Callable[..., Motion]
) -> None:
    assert trunk(stand(40, lumbar_extension=-0.4))[-1, 2] == pytest.approx(0.4, abs=0.03)
    deep = trunk(stand(40, lumbar_extension=-1.4))[-1]
    _, most = retargeter.bend.bounds(deep[0])
    assert deep[2] == pytest.approx(most) and 1.0 < most <= retargeter.robot.safety.most_tilt


def test_near_steps_the_trunk_bows_less_and_slowly(
    retargeter: Retargeter, standing: Schedule, trunk: Callable, stand: Callable[..., Motion]
) -> None:
    """A human bowed while its robot walked: the hip of the swinging leg lagged by 18°, its toes struck, it fell."""
    walking = replace(standing, walking=np.ones(ROWS, bool))
    pitch = trunk(stand(40, lumbar_extension=-1.4), walking)[:, 2]
    assert pitch.max() < 0.45 and np.diff(pitch, prepend=0.0).max() * 125.0 <= 0.5 + 1e-9
    assert trunk(stand(40, lumbar_extension=-1.4))[0, 2] > 1.0


def test_a_trunk_that_is_deep_in_a_bow_comes_up_for_steps_at_once(
    standing: Schedule, trunk: Callable, stand: Callable[..., Motion]
) -> None:
    """It came up by .5 rad/s, and the robot stepped bowed by 51°."""
    pitch = trunk(stand(40, lumbar_extension=-1.4), replace(standing, walking=np.ones(ROWS, bool)), 1.15)[:, 2]
    assert pitch.max() < 0.45


def test_a_squat_lowers_the_hips_to_the_lowest_height_at_most(
    retargeter: Retargeter, trunk: Callable, stand: Callable[..., Motion]
) -> None:
    bent = {f"{joint}_{side}": 2.2 for joint in ("knee_flexion", "hip_flexion") for side in "lr"}
    assert trunk(stand(40, **bent))[-1, 0] == pytest.approx(retargeter.gait.min_hip_height)


def test_load_share_follows_the_sway_then_fades_to_the_middle(
    window: Callable[[Motion], HumanWindow], stand: Callable[..., Motion]
) -> None:
    still = stand(31)
    shifted = still.root_position - [0.0, 0.5, 0.0]
    seen = window(still)
    assert quiet_share(seen, np.arange(50) / 125, np.ones(50), 100, 31.0)[0] == pytest.approx(0.5, abs=0.02)
    lean = Motion(
        fps=still.fps,
        root_position=shifted,
        root_quaternion=still.root_quaternion,
        joints=stand(31, lumbar_bending=0.6).joints,
        body=still.body,
    )
    share = quiet_share(window(lean), np.arange(50) / 125, np.ones(50), 100, 31.0)
    assert abs(share[0] - 0.5) > 0.05 and share.min() >= 0.3 and share.max() <= 0.7
    assert share[-1] == 0.5
    assert np.abs(np.diff(share)).max() < 0.02


def test_the_load_share_begins_in_the_middle_as_far_as_the_human_does_not_count(
    window: Callable[[Motion], HumanWindow], stand: Callable[..., Motion]
) -> None:
    seen, begun = window(stand(31, lumbar_bending=0.6)), np.linspace(0.0, 1.0, 50)
    whole = quiet_share(seen, np.arange(50) / 125, np.ones(50), 50, 31.0)
    share = quiet_share(seen, np.arange(50) / 125, begun, 50, 31.0)
    assert share[0] == 0.5 and abs(whole[0] - 0.5) > 0.05
    np.testing.assert_allclose(share - 0.5, begun * (whole - 0.5), atol=1e-9)


def test_the_follower_has_a_channel_for_each_target(retargeter: Retargeter) -> None:
    made = follower(retargeter.robot, retargeter.body)
    channels = 4 + len(retargeter.body.upper.joints)
    assert made.omega.shape == made.speed.shape == made.acceleration.shape == (channels,)
    assert (made.speed[4:] < retargeter.robot.no_load_speed[retargeter.body.upper.joints]).all()
