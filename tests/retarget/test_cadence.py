"""Steps of the robot's own cadence: as many as it takes along the human's way, within what its legs can do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import build_clip
from flexmotion.retarget.footsteps import FeetState
from flexmotion.retarget.human_steps import count_steps
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.step_timing import SAME_FOOT_REST_S
from flexmotion.retarget.steps import NOTICE_S, Step

from .conftest import RATE, Views, Windows, in_time, step_script

Stepped = Callable[..., list[Step]]

STANDS_S = 1.0
"""The humans of these tests stand so long before they walk."""


def walker(step_m: float, step_s: float, count: int = 8, stands_s: float = 4.0) -> Motion:
    """A human who stands, makes steps of a length and a duration each, right foot first, and stands."""
    steps = []
    for k in range(count):
        lift = STANDS_S + k * step_s
        steps.append(("rl"[k % 2], lift, lift + 0.76 * step_s, min(k + 1, count - 1) * step_m))
    return build_clip(step_script(steps, STANDS_S + count * step_s + stands_s), Body())


@pytest.fixture(scope="session")
def stepped(retargeter: Retargeter, view: Views) -> Stepped:
    """Function (motion, whether the human goes on after it) -> steps of a robot that stands, in one plan."""

    def make(motion: Motion, whole: bool = True) -> list[Step]:
        home = retargeter.body.home_feet
        start = FeetState(home, np.full((2, 2), np.nan), np.full(2, -np.inf), np.zeros(2), [], at_rest=True)
        seen = view(motion)
        start = replace(start, human_feet=seen.window.feet[0, :, :2].copy())
        return retargeter.footsteps.plan(replace(seen, whole=whole), start)

    return make


def places(retargeter: Retargeter, steps: list[Step], until: float = np.inf) -> np.ndarray:
    """The feet after the steps that land before a tick, (2, 4)."""
    feet = retargeter.body.home_feet.copy()
    for step in steps:
        if step.land <= until:
            feet[step.side] = step.target
    return feet


def way(motion: Motion, retargeter: Retargeter) -> float:
    """How far the human goes, scaled to the robot [m]."""
    ratio = retargeter.body.leg_length / motion.body.leg
    return float(ratio * (motion.root_position[-1, 0] - motion.root_position[0, 0]))


@settings(max_examples=40, deadline=None)
@given(step_m=st.floats(0.1, 0.8), step_s=st.floats(0.3, 1.4))
def test_feet_rest_and_go_no_faster_than_the_legs(
    stepped: Stepped, retargeter: Retargeter, step_m: float, step_s: float
) -> None:
    swings, gait, feet = retargeter.swings, retargeter.gait, retargeter.body.home_feet.copy()
    landed, last = -np.inf, None
    for step in stepped(walker(step_m, step_s)):
        assert in_time(swings, step)
        # Feet alternate; one that steps twice in a row, while its human waits, has rested.
        rests_s = SAME_FOOT_REST_S if step.side == last else gait.double_support_min_s
        assert step.lift >= landed + rests_s * RATE - 1e-9
        np.testing.assert_array_equal(step.start, feet[step.side])
        stance, last = feet[step.stance], step.side
        assert abs(step.target[0] - stance[0]) <= swings.stride((step.land - step.lift) / RATE) + 1e-3
        apart = (step.target[1] - stance[1]) * (1 if step.side == 0 else -1)
        assert gait.lateral[0] - 1e-9 <= apart <= gait.lateral[1] + 1e-9
        feet[step.side], landed = step.target, step.land


def test_a_foot_whose_step_is_made_does_not_look_ahead_of_its_human(stepped: Stepped) -> None:
    """While the human's foot was in the air, a robot's foot on its way there counted as ahead, by up to a stride.

    The robot thought that it had caught up, waited, and stepped with the other foot twice.
    """
    steps = stepped(walker(0.75, 0.71875))
    assert all(one.side != other.side for one, other in zip(steps, steps[1:], strict=False))


def test_a_slow_human_of_long_strides_is_kept_up_with_by_more_steps(stepped: Stepped, retargeter: Retargeter) -> None:
    """One step of the robot for each of the human's: slowed to half its pace, a walk still lost half of its way."""
    slow = walker(0.6, 1.1, count=9)
    steps = stepped(slow)
    assert len(steps) > 1.3 * count_steps(slow)
    assert places(retargeter, steps)[:, 0].mean() == pytest.approx(way(slow, retargeter), abs=0.03)


def sidler(speed: float, step_s: float, count: int = 8, stands_s: float = 4.0) -> Motion:
    """A human who goes to the left at a speed [m/s] while it steps, and stands."""
    steps = walker(0.0, step_s, count, stands_s)
    seconds = np.clip(np.arange(len(steps)) / steps.fps - STANDS_S, 0.0, count * step_s)
    return replace(steps, root_position=steps.root_position + seconds[:, None] * [0.0, speed, 0.0])


def aside(motion: Motion, retargeter: Retargeter) -> float:
    """How far the human goes to the left, scaled to the robot [m]."""
    ratio = retargeter.body.leg_length / motion.body.leg
    return float(ratio * (motion.root_position[-1, 1] - motion.root_position[0, 1]))


@pytest.mark.parametrize("speed", [-0.2, 0.2])
def test_wide_steps_aside_are_followed_by_more_steps(stepped: Stepped, retargeter: Retargeter, speed: float) -> None:
    """A robot that stepped once for each wide step of the human made .36 of its way, and gave up most of the rest."""
    motion = sidler(speed, 1.4)
    steps = stepped(motion)
    ended = places(retargeter, steps, (STANDS_S + 8 * 1.4) * RATE)
    assert ended[:, 1].mean() / aside(motion, retargeter) > 0.8
    assert places(retargeter, steps)[:, 1].mean() == pytest.approx(aside(motion, retargeter), abs=0.03)


@settings(max_examples=40, deadline=None)
@given(speed=st.floats(-0.6, 0.6), step_s=st.floats(0.4, 1.4))
def test_feet_that_go_aside_rest_and_never_cross(
    stepped: Stepped, retargeter: Retargeter, speed: float, step_s: float
) -> None:
    gait, feet, landed, last = retargeter.gait, retargeter.body.home_feet.copy(), -np.inf, None
    for step in stepped(sidler(speed, step_s)):
        assert in_time(retargeter.swings, step)
        rests_s = SAME_FOOT_REST_S if step.side == last else gait.double_support_min_s
        assert step.lift >= landed + rests_s * RATE - 1e-9
        apart = (step.target[1] - feet[step.stance, 1]) * (1 if step.side == 0 else -1)
        assert gait.lateral[0] - 1e-9 <= apart <= gait.lateral[1] + 1e-9
        feet[step.side], landed, last = step.target, step.land, step.side


@pytest.mark.parametrize("step_m", [0.2, 0.3])
def test_a_robot_that_keeps_up_steps_with_its_human(
    stepped: Stepped, retargeter: Retargeter, window: Windows, step_m: float
) -> None:
    strolls = walker(step_m, 0.7)
    steps = stepped(strolls)
    assert len(steps) == count_steps(strolls)
    for step, swing in zip(steps, window(strolls).swings, strict=True):
        assert step.side == swing.side and step.lift / RATE == pytest.approx(swing.lift_s, abs=0.01)
    assert places(retargeter, steps)[:, 0].mean() == pytest.approx(way(strolls, retargeter), abs=0.02)


def test_no_faster_human_makes_the_robot_slower(stepped: Stepped, retargeter: Retargeter) -> None:
    """Above .36 m/s, leg-scaled, it made .11 m/s instead of .16: each step was cut to the human's time."""
    ways = []
    for step_s in (0.8, 0.7, 0.6, 0.5, 0.4, 0.34):
        motion = walker(0.7, step_s, count=int(6.0 / step_s), stands_s=0.1)
        end = (STANDS_S + 5.0) * RATE
        ways.append(float(places(retargeter, stepped(motion), end)[:, 0].mean()))
    best = np.maximum.accumulate(ways)
    assert (np.array(ways) > best - 0.06).all()
    assert ways[-1] > 0.8 * 4.5 * 0.92 * retargeter.swings.speed


def test_a_human_who_waits_is_caught_up_with(stepped: Stepped, retargeter: Retargeter) -> None:
    strides = walker(0.65, 0.5, count=5)
    steps = stepped(strides)
    ended = (STANDS_S + 5 * 0.5) * RATE
    assert places(retargeter, steps, ended)[:, 0].mean() < 0.85 * way(strides, retargeter)
    assert places(retargeter, steps)[:, 0].mean() == pytest.approx(way(strides, retargeter), abs=0.04)


def test_after_the_human_has_ended_the_robot_goes_on_for_a_while_only(stepped: Stepped, retargeter: Retargeter) -> None:
    """What is more than it can walk in 1.5 s is given up, so that it stands soon after its human."""
    runs = walker(0.8, 0.34, count=16, stands_s=0.1)
    steps = stepped(runs, whole=False)
    before = places(retargeter, steps, len(runs) / runs.fps * RATE)
    after = places(retargeter, steps)
    most = retargeter.footsteps.footholds.most_lag
    assert 0.5 * most < after[:, 0].mean() - before[:, 0].mean() < most + retargeter.swings.longest_stride
    assert after[:, 0].mean() < 0.7 * way(runs, retargeter)
    assert steps[-1].land / RATE < len(runs) / runs.fps + 3.0


def about_turn() -> Motion:
    """A human who walks fast, turns about on planted feet in .8 s, and stands."""
    strides = walker(0.7, 0.45, count=8, stands_s=0.0)
    last = strides[len(strides) - 1 :]
    turn = np.radians(180.0) * np.clip(np.arange(120) / 24.0, 0.0, 1.0)
    about = Rotation.from_euler("z", turn[:, None])
    standing = replace(
        last,
        root_position=np.tile(last.root_position, (120, 1)),
        root_quaternion=about.as_quat(scalar_first=True),
        joints=np.tile(last.joints, (120, 1)),
    )
    return replace(
        strides,
        root_position=np.concatenate([strides.root_position, standing.root_position]),
        root_quaternion=np.concatenate([strides.root_quaternion, standing.root_quaternion]),
        joints=np.concatenate([strides.joints, standing.joints]),
    )


def test_who_turns_about_is_not_met_walking_backward(stepped: Stepped, retargeter: Retargeter) -> None:
    """A human far ahead who turned about would have been behind the robot's back."""
    steps = stepped(about_turn())
    assert abs(np.degrees(steps[-1].target[3])) > 150.0
    backward = [_ahead(step) for step in steps if abs(step.target[3]) > 0.6 * np.pi]
    assert len(backward) >= 2
    assert sum(backward) > -retargeter.swings.longest_stride


def _ahead(step: Step) -> float:
    """How far a step takes its foot ahead [m]."""
    yaw, (x, y) = 0.5 * (step.start[3] + step.target[3]), (step.target - step.start)[:2]
    return float(np.cos(yaw) * x + np.sin(yaw) * y)


def test_steps_stay_as_they_are_over_many_plans(retargeter: Retargeter) -> None:
    """Each plan decides about the steps that are not settled; what it settles, the next ones keep."""
    motion = walker(0.7, 0.5, count=8, stands_s=1.0)
    state, tick, made = retargeter.standing(), 0, {}
    while True:
        first = retargeter.next_frame(state, tick, motion.fps)
        plan = retargeter.plan(state, motion[first : first + 32], first, tick)
        known = {(step.side, step.lift): step for step in plan.steps}
        for key, step in made.items():
            if step.lift > tick and step.lift - step.notice_s * RATE <= tick:
                np.testing.assert_allclose(known[key].target, step.target, atol=1e-12)
                assert known[key].land == step.land
        for key, step in known.items():
            assert key in made or step.lift >= tick + NOTICE_S * RATE - 1
        made |= {key: step for key, step in known.items() if step.lift - step.notice_s * RATE <= tick + 31}
        if plan.stop_row <= 31:
            break
        state, tick = plan.states[31], tick + 31
    steps = sorted([*made.values(), *(known[key] for key in known if key not in made)], key=lambda step: step.lift)
    own = [step for step in steps if not step.inserted]
    assert all(one.side != other.side for one, other in zip(own, own[1:], strict=False))
    assert len(own) >= 8
