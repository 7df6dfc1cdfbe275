from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from flexmotion.configs.robot import load_robot
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.plant import ServoPlant
from flexmotion.streamer.control.servo_command import BRAKING_SHARE, STOPPED_SHARE, ServoCommand

ROBOT = load_robot("op3")  # hypothesis takes no fixtures
N = ROBOT.n
DELAY = 0.004


def each(low: float, high: float) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.float64, N, elements=st.floats(low, high), fill=st.nothing())


def measured(position: np.ndarray, velocity: np.ndarray | None = None, voltage: float = np.nan) -> RobotState:
    state = RobotState(N)
    state.position[:], state.voltage[:] = position, voltage
    state.velocity[:] = 0.0 if velocity is None else velocity
    return state


def settled(q: np.ndarray, qd: np.ndarray, torque: np.ndarray, state: RobotState) -> ServoCommand:
    """A command whose joints have kept their speed, so that it predicts no acceleration."""
    command = ServoCommand(ROBOT, DELAY)
    for _ in range(2):
        command.update(q, qd, torque, state)
    return command


@given(q=each(-4, 4), qd=each(-8, 8), torque=each(-10, 10), position=each(-2, 2), velocity=each(-6, 6))
def test_goals_keep_to_the_joint_limits_for_any_reference(
    q: np.ndarray, qd: np.ndarray, torque: np.ndarray, position: np.ndarray, velocity: np.ndarray
) -> None:
    command = settled(q, qd, torque, measured(position, velocity))
    assert (command.goal >= ROBOT.lower).all() and (command.goal <= ROBOT.upper).all()


@given(
    q=each(-4, 4), torque=each(-10, 10), share=each(0, 1), velocity=each(-4, 4), voltage=st.sampled_from([9.5, 11, 12])
)
def test_torque_that_a_goal_implies_stays_within_the_envelope(
    q: np.ndarray, torque: np.ndarray, share: np.ndarray, velocity: np.ndarray, voltage: float
) -> None:
    """For joints inside their limits as measured; the envelope scales with the supply."""
    position = ROBOT.lower + share * (ROBOT.upper - ROBOT.lower)
    goal = settled(q, np.zeros(N), torque, measured(position, velocity, voltage)).goal
    supply = voltage / ROBOT.nominal_voltage
    implied = ROBOT.kp * supply * (goal - position) - ROBOT.back_emf * velocity
    # Where the joint's limit does not clamp the goal, the envelope holds.
    inside = (goal > ROBOT.lower) & (goal < ROBOT.upper)
    peak = BRAKING_SHARE * ROBOT.stall_torque * supply
    assert (np.abs(implied[inside]) <= peak[inside] + 1e-9).all()
    driving = inside & (implied * velocity > 0)
    assert (np.abs(implied[driving]) <= (ROBOT.usable_torque * supply)[driving] + 1e-9).all()


@given(q=each(-4, 4), share=each(0, 1), velocity=each(-6, 6), voltage=st.sampled_from([9.5, 11, 12]))
def test_the_goal_of_a_robot_that_gets_up_is_inside_also_for_a_joint_that_the_floor_stops(
    q: np.ndarray, share: np.ndarray, velocity: np.ndarray, voltage: float
) -> None:
    """A hip was stopped from 3.8 rad/s under way: its goal counted on the back EMF, and implied 1.3 of the stall."""
    position = ROBOT.lower + share * (ROBOT.upper - ROBOT.lower)
    state, command = measured(position, velocity, voltage), ServoCommand(ROBOT, DELAY)
    for _ in range(2):
        command.update(q, np.zeros(N), np.zeros(N), state, impacts=True)
    supply = voltage / ROBOT.nominal_voltage
    implied = ROBOT.kp * supply * (command.goal - position)
    inside = (command.goal > ROBOT.lower) & (command.goal < ROBOT.upper)
    assert (np.abs(implied[inside]) <= STOPPED_SHARE * (ROBOT.stall_torque * supply)[inside] + 1e-9).all()


@given(
    q=each(-4, 4),
    torque=each(-10, 10),
    share=each(0, 1),
    velocity=each(-4, 4),
    faster=each(-1, 1),
    change=each(-1.5, 1.5),
    voltage=st.sampled_from([9.5, 11, 12]),
    begins=st.booleans(),
)
def test_a_goal_is_inside_also_for_a_joint_that_a_striking_foot_makes_faster(
    q: np.ndarray,
    torque: np.ndarray,
    share: np.ndarray,
    velocity: np.ndarray,
    faster: np.ndarray,
    change: np.ndarray,
    voltage: float,
    begins: bool,
) -> None:
    """A knee was to resist with .8 of the stall torque, and its heel struck: the goal implied 1.08 as it arrived."""
    position = ROBOT.lower + share * (ROBOT.upper - ROBOT.lower)
    struck = np.stack([np.minimum(change, 0.0), np.maximum(change, 0.0)])
    command = ServoCommand(ROBOT, DELAY)
    command.reset(position)
    for speed in (velocity - faster, velocity):
        if begins:
            command.rejoin()  # what a disturbance leaves in the goals is bounded as well
        command.update(q, np.zeros(N), torque, measured(position, speed, voltage), struck=struck)
    supply = voltage / ROBOT.nominal_voltage
    implied = ROBOT.kp * supply * (command.goal - position) - ROBOT.back_emf * velocity
    added = -(ROBOT.back_emf + ROBOT.kp * supply * DELAY) * change  # by the strike, which also moves the joint
    inside = (command.goal > ROBOT.lower) & (command.goal < ROBOT.upper)
    peak = STOPPED_SHARE * ROBOT.stall_torque * supply
    assert (np.abs(implied + added)[inside] <= peak[inside] + 1e-9).all()


def test_no_strike_gives_the_goals_of_a_command_that_knows_of_none() -> None:
    state, speed = measured(ROBOT.stand_pose + 0.1, np.full(N, 1.0), 12.0), np.full(N, 0.4)
    one, other = ServoCommand(ROBOT, DELAY), ServoCommand(ROBOT, DELAY)
    for _ in range(3):
        one.update(ROBOT.stand_pose, speed, 5.0 * speed, state)
        other.update(ROBOT.stand_pose, speed, 5.0 * speed, state, struck=np.zeros((2, N)))
        np.testing.assert_array_equal(one.goal, other.goal)


@given(position=each(-0.2, 0.2), velocity=each(-1, 1), torque=each(-1.5, 1.5), voltage=st.sampled_from([None, 10.5]))
def test_the_servo_makes_the_torque_of_the_reference(
    position: np.ndarray, velocity: np.ndarray, torque: np.ndarray, voltage: float | None
) -> None:
    """On the reference the plant makes the reference's torque, also at a low supply that the servos report."""
    centre = np.clip(position + ROBOT.stand_pose, ROBOT.lower + 0.3, ROBOT.upper - 0.3)
    state = measured(centre, velocity, np.nan if voltage is None else voltage)
    command = settled(centre, velocity, torque, state)
    free = (command.goal > ROBOT.lower) & (command.goal < ROBOT.upper)
    plant = ServoPlant(ROBOT, supply=voltage)
    plant.enabled[:] = True
    plant.goal[:] = command.goal
    made = plant.step(centre, velocity)
    # kp scales with the supply, back-EMF does not.
    np.testing.assert_allclose(made[free & ~plant.saturated], torque[free & ~plant.saturated], atol=1e-9)
    assert np.count_nonzero(free & ~plant.saturated) > N // 2


def test_clamps_are_counted_by_kind() -> None:
    still = measured(ROBOT.stand_pose)
    assert settled(ROBOT.stand_pose, np.zeros(N), np.zeros(N), still).torque_clamps == 0
    command = settled(ROBOT.stand_pose + 2.0, np.zeros(N), np.zeros(N), still)
    assert command.torque_clamps == N
    at_limit = measured(ROBOT.upper)
    command = settled(ROBOT.upper + 0.01, np.zeros(N), np.zeros(N), at_limit)
    assert (command.torque_clamps, command.position_clamps) == (0, N)


def test_the_goal_of_an_accelerating_joint_is_bounded_for_its_predicted_state() -> None:
    """A foot's impact accelerates a joint within a tick: the goal must be inside the envelope in the next one too."""
    command = ServoCommand(ROBOT, DELAY)
    command.update(ROBOT.stand_pose, np.zeros(N), np.zeros(N), measured(ROBOT.stand_pose))
    fast = np.full(N, 2.0)
    goal = command.update(ROBOT.stand_pose - 3.0, np.zeros(N), np.zeros(N), measured(ROBOT.stand_pose, fast)).copy()
    later = ROBOT.stand_pose + DELAY * (fast + 2 * fast)
    implied = ROBOT.kp * (goal - later) - ROBOT.back_emf * 2 * fast
    inside = goal > ROBOT.lower
    assert (implied[inside] >= -BRAKING_SHARE * ROBOT.stall_torque[inside] - 1e-9).all()


@pytest.mark.parametrize("spoiled", ["position", "velocity"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_value_that_is_not_finite_never_becomes_a_goal(spoiled: str, value: float) -> None:
    command = ServoCommand(ROBOT, DELAY)
    good = command.update(ROBOT.stand_pose, np.zeros(N), np.zeros(N), measured(ROBOT.stand_pose)).copy()
    state = measured(ROBOT.stand_pose)
    getattr(state, spoiled)[3] = value
    with np.errstate(invalid="ignore"):
        goal = command.update(ROBOT.stand_pose, np.zeros(N), np.zeros(N), state)
    assert np.isfinite(goal).all()
    assert goal[3] == good[3] or ROBOT.lower[3] <= goal[3] <= ROBOT.upper[3]
    state = measured(ROBOT.stand_pose)
    torque = np.full(N, np.nan)
    command.update(ROBOT.stand_pose, np.zeros(N), torque, state)
    assert np.isfinite(command.goal).all()


def test_an_unknown_voltage_counts_as_nominal_and_zero_does_no_harm() -> None:
    torque = np.full(N, 0.5)
    unknown, nominal = (
        settled(ROBOT.stand_pose, np.zeros(N), torque, measured(ROBOT.stand_pose, voltage=voltage)).goal
        for voltage in (np.nan, float(ROBOT.nominal_voltage[0]))
    )
    np.testing.assert_allclose(unknown, nominal)
    with np.errstate(divide="ignore", invalid="ignore"):
        dead = settled(ROBOT.stand_pose, np.zeros(N), torque, measured(ROBOT.stand_pose, voltage=0.0)).goal
    assert np.isfinite(dead).all()


@given(
    ticks=st.integers(1, 12),
    torque=each(-2.5, 2.5),
    speed=each(-3, 3),
    acceleration=each(-1, 1),
    swing=each(-3, 3),
)
def test_goals_that_leave_while_a_robot_is_silent_are_inside_wherever_its_joints_may_be(
    ticks: int, torque: np.ndarray, speed: np.ndarray, acceleration: np.ndarray, swing: np.ndarray
) -> None:
    """In 80 ms of silence seven goals left for where the joints of a walking robot should have been, and were not.

    The true joints leave the assumed motion with any share of the acceleration that their servos give them.
    """
    command, begin = ServoCommand(ROBOT, DELAY), ROBOT.stand_pose
    command.reset(begin)
    state = measured(begin, speed, 12.0)
    command.update(begin, speed, torque, state)
    most = ROBOT.usable_torque * ROBOT.model.dof_invweight0[ROBOT.dof_address]
    for tick in range(1, ticks + 1):
        seconds = tick / ROBOT.rate_hz
        assumed = begin + speed * seconds
        state.position[:], state.velocity[:], state.stale[:] = assumed, speed, tick
        before = command.goal.copy()
        goal = command.update(assumed + 0.01 * swing, speed, torque, state)
        true = assumed + 0.5 * acceleration * most * seconds**2
        implied = ROBOT.kp * (goal - true) - ROBOT.back_emf * (speed + acceleration * most * seconds)
        inside = (goal > ROBOT.lower) & (goal < ROBOT.upper) & (goal != before)
        assert (np.abs(implied[inside]) <= ROBOT.stall_torque[inside] + 1e-9).all()


def test_a_silent_joint_keeps_its_goal_until_it_answers_and_goes_on_from_there() -> None:
    knee = ROBOT.index("l_knee")
    command, zero, state = ServoCommand(ROBOT, DELAY), np.zeros(N), measured(ROBOT.stand_pose, voltage=12.0)
    command.reset(ROBOT.stand_pose)
    command.update(ROBOT.stand_pose, zero, zero, state)
    load, q = zero.copy(), ROBOT.stand_pose.copy()
    load[knee] = 2.0
    goals = []
    for tick in range(1, 11):
        q[knee] += 0.01
        state.position[knee], state.stale[knee] = q[knee], tick
        goals.append(command.update(q, zero, load, state).copy())
    steps = np.diff([goal[knee] for goal in goals])
    assert steps[0] > 0.0 and (steps[-5:] == 0.0).all()  # it follows at first, and is held in the end
    moved = np.delete(np.ptp(goals, axis=0), knee)
    np.testing.assert_allclose(moved, 0.0, atol=1e-12)
    expected = np.full(N, np.nan)
    expected[knee] = q[knee]
    state.stale[knee] = 0
    after = command.update(q, zero, load, state, expected)
    assert abs(after[knee] - goals[-1][knee]) <= np.radians(1.7)


def test_a_slow_move_goes_on_however_long_the_robot_is_silent() -> None:
    """A robot whose bus is lost is lowered before its torque goes off."""
    command, zero, state = ServoCommand(ROBOT, DELAY), np.zeros(N), measured(ROBOT.stand_pose, voltage=12.0)
    command.reset(ROBOT.stand_pose)
    knee = ROBOT.index("l_knee")
    q = ROBOT.stand_pose.copy()
    for tick in range(1, 126):
        q[knee] += 0.004
        state.position[knee], state.stale[:] = q[knee], tick
        command.update(q, zero, zero, state, slow=True)
    assert command.goal[knee] == pytest.approx(q[knee])


@given(
    q=each(-4, 4), torque=each(-10, 10), share=each(0, 1), velocity=each(-6, 6), before=each(-6, 6), cap=each(0.01, 9.0)
)
def test_a_goal_implies_no_more_than_the_cap_of_its_joint_and_never_more_than_without_one(
    q: np.ndarray, torque: np.ndarray, share: np.ndarray, velocity: np.ndarray, before: np.ndarray, cap: np.ndarray
) -> None:
    """At the position and speed as measured, also of a joint that has just been stopped or pushed."""
    position = ROBOT.lower + share * (ROBOT.upper - ROBOT.lower)
    free, capped = ServoCommand(ROBOT, DELAY), ServoCommand(ROBOT, DELAY)
    capped.cap[:] = cap
    for command in (free, capped):
        for speed in (before, velocity):
            command.update(q, np.zeros(N), torque, measured(position, speed))
    drag = ROBOT.back_emf * velocity
    implied = np.abs(ROBOT.kp * (capped.goal - position) - drag)
    inside = (capped.goal > ROBOT.lower) & (capped.goal < ROBOT.upper)
    assert (implied[inside] <= cap[inside] + 1e-9).all()
    most = np.maximum(BRAKING_SHARE * ROBOT.stall_torque, ROBOT.usable_torque)
    assert (implied[inside] <= most[inside] + 1e-9).all()


@given(
    q=each(-2, 2),
    qd=each(-4, 4),
    torque=each(-2, 2),
    share=each(0.1, 1),
    place=each(0, 1),
    velocity=each(-4, 4),
)
def test_a_softer_joint_is_asked_for_less_beyond_the_plan_and_stays_in_the_envelope(
    q: np.ndarray, qd: np.ndarray, torque: np.ndarray, share: np.ndarray, place: np.ndarray, velocity: np.ndarray
) -> None:
    state = measured(ROBOT.lower + place * (ROBOT.upper - ROBOT.lower), velocity, 12.0)
    stiff, soft = ServoCommand(ROBOT, DELAY), ServoCommand(ROBOT, DELAY)
    for _ in range(40):
        stiff.update(q, qd, torque, state)
        soft.update(q, qd, torque, state, stiffness=share)
    arrives = state.position + 2 * DELAY * velocity
    relaxed = arrives + (torque + ROBOT.back_emf * velocity) / ROBOT.kp
    low, high = np.minimum(relaxed, stiff.goal), np.maximum(relaxed, stiff.goal)
    inside = (relaxed > ROBOT.lower) & (relaxed < ROBOT.upper)
    # A relaxed goal outside the envelope is bounded to it as well: the soft one is still no further out.
    assert (soft.goal >= low - 1e-9)[inside].all() and (soft.goal <= high + 1e-9)[inside].all()
    implied = ROBOT.kp * (soft.goal - state.position) - ROBOT.back_emf * velocity
    free = (soft.goal > ROBOT.lower) & (soft.goal < ROBOT.upper)
    assert (
        np.abs(implied[free]) <= np.maximum(BRAKING_SHARE * ROBOT.stall_torque, ROBOT.usable_torque)[free] + 1e-9
    ).all()


def test_a_blocked_joint_is_pushed_with_the_share_of_the_torque_however_far_its_goal_is() -> None:
    """A stiff OP3 pushes with all that its servo gives from 8 degrees on: less gain in the servo would not help."""
    state, zero, ahead = measured(ROBOT.stand_pose, voltage=12.0), np.zeros(N), np.zeros(N)
    shoulder = ROBOT.index("l_sho_pitch")
    ahead[shoulder] = 0.6
    command = ServoCommand(ROBOT, DELAY)
    for _ in range(60):
        command.update(ROBOT.stand_pose + ahead, zero, zero, state, stiffness=np.full(N, 0.3))
    pushes = ROBOT.kp * (command.goal - state.position)
    assert pushes[shoulder] == pytest.approx(0.3 * ROBOT.usable_torque[shoulder])


def test_a_soft_joint_that_falls_silent_is_stiff_without_a_jump_of_its_goal() -> None:
    state, zero, stiffness = measured(ROBOT.stand_pose, voltage=12.0), np.zeros(N), np.full(N, 0.3)
    shoulder = ROBOT.index("l_sho_pitch")
    target = ROBOT.stand_pose.copy()
    target[shoulder] += 0.1
    command = ServoCommand(ROBOT, DELAY)
    command.reset(ROBOT.stand_pose)
    for _ in range(60):
        command.update(target, zero, zero, state, stiffness=stiffness)
    goals = [command.goal[shoulder]]
    for tick in range(1, 4):
        state.stale[shoulder] = tick
        goals.append(command.update(target, zero, zero, state, stiffness=stiffness)[shoulder])
    assert command.softness.share[shoulder] == 1.0 and goals[-1] > goals[0]
    assert np.abs(np.diff(goals)).max() <= np.radians(0.6)


def test_all_of_the_stiffness_gives_the_goals_of_a_command_that_knows_no_share() -> None:
    state, speed = measured(ROBOT.stand_pose + 0.05, voltage=11.5), np.full(N, 0.4)
    one, other = ServoCommand(ROBOT, DELAY), ServoCommand(ROBOT, DELAY)
    for _ in range(5):
        one.update(ROBOT.stand_pose, speed, 0.2 * speed, state)
        other.update(ROBOT.stand_pose, speed, 0.2 * speed, state, stiffness=np.ones(N))
        np.testing.assert_array_equal(one.goal, other.goal)


def test_a_cap_that_is_let_go_does_not_hit_what_holds_the_joint() -> None:
    """All of the torque came within one tick; lower caps hold at once."""
    command, none = ServoCommand(ROBOT, DELAY), np.full(N, np.inf)
    state, zero = measured(ROBOT.stand_pose, voltage=12.0), np.zeros(N)
    shoulder, ahead = ROBOT.index("l_sho_pitch"), ROBOT.stand_pose.copy()
    ahead[shoulder] += 0.6
    command.take_cap(np.full(N, 0.3))
    pushes = []
    for cap in [np.full(N, 0.3)] * 3 + [none] * 40:
        command.take_cap(cap)
        command.update(ahead, zero, zero, state)
        pushes.append(float((ROBOT.kp * (command.goal - state.position))[shoulder]))
    assert pushes[2] <= 0.3 + 1e-9 and pushes[-1] == pytest.approx(ROBOT.usable_torque[shoulder])
    assert np.diff(pushes[2:]).max() <= ROBOT.stall_torque[shoulder] / 20
    assert np.isinf(command.cap).all()


def test_no_cap_is_left_when_torque_goes_on_again() -> None:
    """A cap that held before a fall still bounded the arms while the robot got up."""
    command = ServoCommand(ROBOT, DELAY)
    command.take_cap(np.full(N, 0.3))
    command.reset(ROBOT.stand_pose)
    assert np.isinf(command.cap).all()


def test_a_frozen_goal_keeps_below_a_cap() -> None:
    """A knee that may give .3 N·m was moved by .25 rad while it was frozen, and its goal implied 3.69 N·m."""
    knee, command = ROBOT.index("l_knee"), ServoCommand(ROBOT, DELAY)
    command.reset(ROBOT.stand_pose)
    command.take_cap(np.full(N, 0.3))
    moved = ROBOT.stand_pose.copy()
    moved[knee] -= 0.25
    for _ in range(3):
        goal = command.held(measured(moved, np.zeros(N), 12.0))
        assert abs(goal[knee] - moved[knee]) * ROBOT.kp[knee] <= 0.3 + 1e-9


def test_a_frozen_goal_follows_a_joint_that_something_moves_as_far_as_the_envelope_asks() -> None:
    """The knee of a robot that fell frozen was moved from its goal, and braked with 1.02 of its stall torque."""
    knee, position, velocity = ROBOT.index("l_knee"), np.zeros(N), np.zeros(N)
    frozen = position.copy()
    frozen[knee] = 1.626
    command = ServoCommand(ROBOT, DELAY)
    command.reset(frozen)
    position[knee] = 1.60
    np.testing.assert_array_equal(command.held(measured(position, velocity, 12.0)), frozen)
    for at in (1.72, 1.735):
        position[knee], velocity[knee] = at, 2.37
        goal = command.held(measured(position, velocity, 12.0))
    implied = (ROBOT.kp * (goal - position) - ROBOT.back_emf * velocity) / ROBOT.stall_torque
    assert abs(implied[knee]) <= STOPPED_SHARE + 1e-9
    assert goal[knee] > frozen[knee]
    np.testing.assert_array_equal(np.delete(goal, knee), np.delete(frozen, knee))
    position[knee] = velocity[knee] = np.nan
    np.testing.assert_array_equal(command.held(measured(position, velocity, 12.0)), frozen)
    position[knee], velocity[knee] = 1.60, 0.0
    command.held(measured(position, velocity, 12.0))
    np.testing.assert_array_equal(command.held(measured(position, velocity, 12.0)), frozen)
