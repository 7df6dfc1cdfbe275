"""Forearms keep clear of the legs as they are in a plan.

A robot whose target changed from one clip to another led its forearms through its walking thighs: both clips were clear
of the body, as was every frame of the window, but not what the filters made between them. The shoulders pushed
against the thighs, counted as blocked, and 7 of 12 runs of a minute ended there.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest

from flexmotion.configs.robot import Robot
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.retarget.arm_guard import ArmGuard
from flexmotion.retarget.posture import follower
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.whole_body import POSTURE

BEFORE = np.array([-0.46, 1.08, -1.24, 0.41, -1.17, 1.39])
AFTER = np.array([0.35, 1.45, -0.54, -0.29, -1.38, 0.69])
"""Arms in two clips, left then right, from shoulder to elbow [rad]."""
LEGS = np.array([0.04, -0.13, -0.32, 1.18, 0.89, -0.13, 0.02, -0.12, 0.73, -1.28, -0.57, -0.12])
"""Legs while the arms went from one to the other [rad]."""
ROWS = 150
FIRST = len(POSTURE)
ARMS = slice(FIRST, FIRST + 6)


def touching(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Whether the robot touches itself at each row of angles (T, n), by MuJoCo's collision detection, (T,) bool."""
    data, found = mujoco.MjData(robot.model), np.zeros(len(q), dtype=bool)
    for k, row in enumerate(q):
        data.qpos[:7], data.qpos[robot.qpos_address] = (0, 0, 5, 1, 0, 0, 0), row
        mujoco.mj_kinematics(robot.model, data)
        mujoco.mj_collision(robot.model, data)
        found[k] = data.ncon > 0
    return found


class Change:
    """Arms of the OP3 that change from one pose to another over legs that stay, and the guard's answer."""

    def __init__(
        self, retargeter: Retargeter, before: np.ndarray, after: np.ndarray, legs: np.ndarray, row: int = 20
    ) -> None:
        self.robot, self.upper = retargeter.robot, retargeter.body.upper
        self.q = np.tile(self.robot.stand_pose, (ROWS, 1))
        self.q[:, 8:] = legs
        start = np.concatenate([[0.2, 0.0, 0.0, 0.0], before, [0.0, 0.0]])
        self.targets = np.tile(start, (ROWS, 1))
        self.targets[row:, ARMS] = after
        self.follower = follower(self.robot, retargeter.body)
        still = np.zeros(len(start))
        follow = partial(self.follower.follow, position=start, velocity=still)
        self.plain = follow(self.targets)
        self.q[:, self.upper.joints] = self.plain[0][:, FIRST:]
        self.clear = retargeter.guard.keep_clear(self.targets, (start, still), self.plain, self.q, follow)

    def guarded(self) -> np.ndarray:
        """All joint angles with the arms as the guard leads them, (T, n) [rad]."""
        assert self.clear is not None
        q = self.q.copy()
        q[:, self.upper.joints] = self.clear[0][:, FIRST:]
        return q


@pytest.fixture(scope="module")
def change(retargeter: Retargeter) -> Change:
    return Change(retargeter, BEFORE, AFTER, LEGS)


def test_forearms_do_not_pass_the_thighs_on_their_way_to_the_next_clip(op3: Robot, change: Change) -> None:
    assert touching(op3, change.q).any()
    assert not touching(op3, change.q[[0, -1]]).any()
    assert not touching(op3, change.guarded()).any()


def test_what_is_kept_clear_stays_within_speed_and_acceleration_and_arrives(change: Change) -> None:
    assert change.clear is not None
    position, velocity, _, _ = change.clear
    acceleration = np.diff(velocity, axis=0, prepend=0.0) / change.follower.dt
    assert (np.abs(velocity) <= change.follower.speed + 1e-9).all()
    assert (np.abs(acceleration) <= change.follower.acceleration + 1e-6).all()
    np.testing.assert_allclose(position[-1], change.plain[0][-1], atol=0.02)
    others = np.delete(np.arange(position.shape[1]), np.arange(position.shape[1])[ARMS])
    np.testing.assert_array_equal(position[:, others], change.plain[0][:, others])


def test_arms_that_are_clear_of_the_body_stay_as_they_are(retargeter: Retargeter, op3: Robot) -> None:
    rest = op3.stand_pose[retargeter.body.upper.arms].ravel()
    assert Change(retargeter, rest, rest, op3.stand_pose[8:]).clear is None


@pytest.mark.parametrize("row", [0, 20])
def test_random_changes_touch_nothing_on_the_way_even_where_they_begin_at_once(
    retargeter: Retargeter, row: int
) -> None:
    random, found = np.random.default_rng(0), 0
    for _ in range(24):
        spread = random.uniform(-0.3, 0.3, (2, 6))
        legs = LEGS + random.uniform(-0.1, 0.1, 12)
        change = Change(retargeter, BEFORE + spread[0], AFTER + spread[1], legs, row)
        if change.clear is None or touching(retargeter.robot, change.q[[0, -1]]).any():
            continue
        if touching(retargeter.robot, change.q).any():
            found += 1
            assert not touching(retargeter.robot, change.guarded()).any()
    assert found > 5


def test_a_robot_without_collision_shapes_has_nothing_to_keep_clear_of(
    retargeter: Retargeter, op3: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = op3.compile()
    bare.geom_contype[:] = bare.geom_conaffinity[:] = 0
    monkeypatch.setattr(op3, "model", bare)
    guard = ArmGuard(op3, retargeter.body.upper.chain, FIRST, 22.0)
    q = np.tile(op3.stand_pose, (8, 1))
    q[:, retargeter.body.upper.arms.ravel()] = 0.5 * (BEFORE + AFTER)
    still = np.zeros((8, 12))
    followed = (still, still, still, still)
    assert guard.keep_clear(still, (still[0], still[0]), followed, q, lambda targets: followed) is None


@pytest.mark.parametrize(("back", "elbow", "turned", "ahead"), [(-30, 80, 30, 60), (-60, 110, 40, 60)])
def test_a_human_who_walks_and_swings_bent_arms_ahead_makes_no_plan_that_touches_itself(
    retargeter: Retargeter, op3: Robot, walk: Motion, back: float, elbow: float, turned: float, ahead: float
) -> None:
    """The first passed thighs while walking, the second crossed its forearms; degrees."""
    angles, line = walk.joints.copy(), np.arange(len(walk.joints))
    for side in "lr":
        for joint, first, last in (
            ("shoulder_flexion", back, 30.0),
            ("elbow_flexion", elbow, ahead),
            ("shoulder_rotation", turned, turned),
        ):
            angles[:, JOINTS.index(f"{joint}_{side}")] = np.radians(np.interp(line, [70, 76], [first, last]))
    motion, state, tick = replace(walk, joints=angles), retargeter.standing(), 0
    for _ in range(20):
        first = retargeter.next_frame(state, tick, motion.fps)
        plan = retargeter.plan(state, motion[first : first + 32], first, tick)
        assert not touching(op3, plan.q[:31]).any()
        state, tick = plan.states[31], tick + 31
