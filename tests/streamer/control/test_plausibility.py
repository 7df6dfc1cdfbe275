"""One sensor at a time: what is not believed, what becomes a fault, and what is true although it jumps."""

from __future__ import annotations

import math
from copy import copy

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.interface import RobotState
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.control.believed import Suspicion
from flexmotion.streamer.control.imu_plausibility import REST_S
from flexmotion.streamer.control.plausibility import KINDS, Plausibility

KNEE = 11
RATE = 125.0


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


def patient(op3: Robot, reads: int) -> Robot:
    """OP3 whose sensors may be silent or wrong for so many reads."""
    robot = copy(op3)
    robot.safety = op3.safety.model_copy(update={"max_stale_reads": reads})
    return robot


class Watched:
    """Readings of a robot, checked tick by tick; its knee moves with `speed` [rad/s]."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.checks = robot, Plausibility(robot)
        self.state, self.tick, self.speed = RobotState(robot.n), 0, np.zeros(robot.n)
        self.true = robot.stand_pose.copy()

    def read(
        self,
        *,
        powered: bool = True,
        silent: int | None = None,
        lies: bool = False,
        force: np.ndarray | None = None,
        turns: np.ndarray | None = None,
        **wrong: float,
    ) -> RobotState:
        """The next reading, wrong by so much.

        Args:
            silent: a joint that does not answer.
            force, turns: of the IMU, (3,) [m/s², rad/s]; None: at rest.
        """
        state, robot = self.state, self.robot
        self.true += self.speed / RATE
        state.position[:], state.velocity[:] = self.true, self.speed
        state.voltage[:], state.temperature[:] = robot.nominal_voltage, 40.0
        state.gyro[:], state.accel[:] = 0.0 if turns is None else turns, (0.0, 0.0, GRAVITY) if force is None else force
        state.stale[:], state.imu_stale = 0, 0
        for name, value in wrong.items():
            getattr(state, name)[0 if name in ("gyro", "accel") else KNEE] += value
        if silent is not None:
            state.stale[silent] = 1
        self.checks.check(state, self.speed, self.tick, powered=powered, lies=lies)
        self.tick += 1
        return state

    def level(self, kind: str) -> float:
        return float(self.checks.suspicions[KINDS.index(kind)].level[KNEE])


@pytest.fixture
def watched(op3: Robot) -> Watched:
    made = Watched(op3)
    for _ in range(3):
        made.read()
    return made


@pytest.mark.parametrize("wrong", [0.06, 0.61, -6.28])
def test_a_position_that_cannot_be_is_stale_and_the_joint_moves_on_as_planned(watched: Watched, wrong: float) -> None:
    watched.speed[KNEE] = 0.8
    watched.read()
    state = watched.read(position=wrong)
    assert state.stale[KNEE] == 1 and watched.checks.disbelieved == 1
    assert state.position[KNEE] == pytest.approx(watched.true[KNEE], abs=1e-9)
    state = watched.read()
    assert state.stale[KNEE] == 0 and state.position[KNEE] == watched.true[KNEE]
    assert watched.level("position") < 1


def test_a_position_that_stays_wrong_is_never_believed_again(watched: Watched) -> None:
    patience = watched.robot.safety.max_stale_reads
    for _ in range(300):
        state = watched.read(position=4.0)
        assert state.position[KNEE] == pytest.approx(watched.true[KNEE])
    assert watched.level("position") > patience and state.stale[KNEE] == 300
    watched.read(powered=False)
    assert watched.level("position") == 0 and watched.read().stale[KNEE] == 0


def test_the_first_reading_may_be_that_of_the_set_up(op3: Robot) -> None:
    """On a bus it is one cycle old: a robot whose servos all answered did not start ("does not answer")."""
    made = Watched(op3)
    made.read(powered=False, silent=KNEE)
    assert not made.checks.unread.any() and made.state.stale[KNEE] == 1
    made.read(powered=False, silent=KNEE)
    assert made.checks.unread[KNEE] == 1


def test_a_joint_that_is_found_elsewhere_after_a_silence_is_believed(watched: Watched) -> None:
    for _ in range(4):
        watched.read(silent=KNEE)
    watched.true[KNEE] += 0.2
    state = watched.read()
    assert state.stale[KNEE] == 0 and state.position[KNEE] == watched.true[KNEE]
    assert watched.checks.expected[KNEE] == pytest.approx(watched.true[KNEE] - 0.2)


@pytest.mark.parametrize("wrong", [3.0, -4.5, 60.0])
def test_a_speed_that_the_positions_contradict_is_replaced(watched: Watched, wrong: float) -> None:
    state = watched.read(velocity=wrong)
    assert abs(state.velocity[KNEE]) < 0.7 and state.stale[KNEE] == 0 and watched.level("speed") == 1
    for _ in range(watched.robot.safety.max_stale_reads + 1):
        watched.read(velocity=wrong)
    assert watched.level("speed") > watched.robot.safety.max_stale_reads


@pytest.mark.parametrize("gap", [1, 3])
@pytest.mark.parametrize("wrong", [4.4, -4.4])
def test_a_false_speed_behind_a_false_position_is_bounded_by_what_the_joint_moved(
    watched: Watched, gap: int, wrong: float
) -> None:
    """Regression: nothing was compared with such a speed; with random lies a goal jumped by 10 degrees in a tick."""
    for _ in range(20):
        watched.read()
    for _ in range(gap):
        assert watched.read(position=1.5).stale[KNEE] > 0
    state, most = watched.read(velocity=wrong), 0.15 * (1 + gap) * watched.robot.no_load_speed[KNEE]
    assert state.stale[KNEE] == 0 and 0.0 < abs(state.velocity[KNEE]) < min(most, 4.0)
    assert watched.read().velocity[KNEE] == pytest.approx(0.0, abs=1e-9)


def test_a_joint_that_was_not_read_for_a_few_ticks_keeps_the_speed_that_it_has(watched: Watched) -> None:
    watched.speed[KNEE] = 3.0
    for _ in range(10):
        watched.read()
    watched.speed[KNEE] = 3.4
    watched.read(silent=KNEE)
    watched.read(silent=KNEE)
    watched.speed[KNEE] = 3.8
    assert watched.read().velocity[KNEE] == pytest.approx(3.8)


@pytest.mark.parametrize(("kind", "wrong"), [("voltage", -9.0), ("voltage", 30.0), ("temperature", 200.0)])
def test_a_value_outside_every_range_is_replaced_and_a_fault_if_it_stays(
    watched: Watched, kind: str, wrong: float
) -> None:
    right = getattr(watched.read(), kind)[KNEE]
    for count in range(1, 8):
        assert getattr(watched.read(**{kind: wrong}), kind)[KNEE] == right
        assert watched.level(kind) == count


def test_a_servo_that_is_hot_at_once_is_believed_after_as_many_reads_as_it_may_be_silent(watched: Watched) -> None:
    """One reading of 90 degrees parked the robot."""
    reads = watched.robot.safety.max_stale_reads
    seen = [float(watched.read(temperature=38.0).temperature[KNEE]) for _ in range(reads + 2)]
    assert seen == [40.0] * reads + [78.0] * 2


def test_a_turn_that_nothing_explains_is_not_believed_and_an_impact_is(watched: Watched) -> None:
    assert watched.read(gyro=5.0).gyro[0] == 0.0
    assert watched.read().gyro[0] == 0.0 and watched.checks.disbelieved == 1
    struck = watched.read(gyro=5.0, accel=30.0)
    assert struck.gyro[0] == 5.0 and struck.accel[0] == 30.0


STRIKES = {
    "it turns about its upright axis": [
        ((-0.81, 1.15, -0.12), (-0.21, -0.07, 0.92)),
        ((-0.79, 2.08, 1.47), (-0.34, -0.45, 1.00)),
        ((-0.69, 2.05, 1.55), (-0.27, -0.32, 0.74)),
        ((-0.60, 2.00, 1.60), (-0.29, -0.32, 0.72)),
    ],
    "with half a step in another one": [
        ((1.95, -1.63, -0.70), (-0.19, -0.03, 0.66)),
        ((3.05, -0.54, -3.31), (-0.04, 0.21, 0.27)),
        ((3.01, -0.41, -3.59), (-0.04, 0.48, 0.60)),
        ((2.90, -0.33, -3.83), (-0.05, 0.50, 0.59)),
    ],
}
"""What the IMU of a pushed OP3 measured where a foot struck the floor, tick by tick: turn [rad/s] and force [g]."""


@pytest.mark.parametrize("strike", STRIKES)
def test_an_imu_is_believed_where_a_foot_strikes_far_from_the_middle(watched: Watched, strike: str) -> None:
    """The force changed by less than 1 g, so that nothing explained the turn: it was held, and the tilt was lost.

    A robot that fell on from 20 degrees was taken to be upright, and struck the ground stiff.
    """
    first, *struck = STRIKES[strike]
    for _ in range(4):  # a speed of the middle of a fall, reached step by step
        watched.read(turns=np.array(first[0]) / 2, force=GRAVITY * np.array(first[1]))
    for turns, force in (first, *struck, *struck[-1:] * 20):
        state = watched.read(turns=np.array(turns), force=GRAVITY * np.array(force))
        np.testing.assert_array_equal(state.gyro, turns)
        assert state.imu_stale == 0


@pytest.mark.parametrize("axis", range(3))
def test_a_turn_of_any_axis_without_a_force_is_not_believed(watched: Watched, axis: int) -> None:
    wrong = np.zeros(3)
    wrong[axis] = 8.0
    for _ in range(watched.robot.safety.max_stale_reads + 1):
        assert not watched.read(turns=wrong).gyro.any()
    assert watched.state.imu_stale > 0


def test_a_turn_that_was_wrong_before_an_impact_is_wrong_after_it(watched: Watched) -> None:
    """A gyro that lied for good was believed at the next strike of a foot: the attitude went round, the robot fell."""
    for _ in range(20):
        watched.read(gyro=5.0)
    for force in (4.0, -4.0, 0.0, 0.0, 0.0):
        assert watched.read(gyro=5.0, accel=force * GRAVITY).gyro[0] == 0.0
    assert watched.state.imu_stale > 0


def test_two_lies_that_seem_to_explain_each_other_are_no_fall(watched: Watched) -> None:
    """A wrong force was an impact, which explained any turn within three ticks, and the turn was held for good.

    In six ticks it made 50 degrees of tilt, and a robot that stood still was dropped.
    """
    watched.read(accel=-10.3)
    watched.read()
    assert watched.read(gyro=18.4).gyro[0] == 0.0
    for _ in range(10):
        watched.read()
    watched.read(accel=-10.3)
    held = [float(watched.read(gyro=wrong).gyro[0]) for wrong in (2.5, 0.0, 0.0)]
    assert held == [2.5, 0.0, 0.0] and watched.state.imu_stale == 0


@pytest.mark.parametrize("size", [0.5, 1.0, 4.0])
def test_the_step_of_a_turn_that_is_believed_follows_the_robots_size(op3: Robot, size: float) -> None:
    """A bound of OP3's size was that of every robot: one of four times its size believed 1.4 rad/s in a tick."""
    tall = copy(op3)
    tall.gait = op3.gait.model_copy(update={"stand_hip_height": size * op3.gait.stand_hip_height})
    watched = Watched(tall)
    watched.read()
    step = 4.0 * GRAVITY / tall.gait.stand_hip_height / RATE
    assert watched.read(gyro=0.9 * step).gyro[0] == pytest.approx(0.9 * step)
    assert watched.read(gyro=2.0 * step).gyro[0] == pytest.approx(0.9 * step) and watched.checks.disbelieved == 1


def test_after_two_false_turns_the_true_one_is_believed(watched: Watched) -> None:
    """Each was near the one before, the true one was not: the gyro stayed at 2.2 rad/s until the IMU was silent."""
    step = 4.0 * GRAVITY / watched.robot.gait.stand_hip_height / RATE
    held = [float(watched.read(gyro=turn).gyro[0]) for turn in (0.95 * step, 1.5 * step, 0.05, 0.0, 0.0)]
    assert held == pytest.approx([0.95 * step, 1.5 * step, 0.05, 0.0, 0.0])
    assert watched.state.imu_stale == 0 and watched.checks.disbelieved == 0


def test_an_imu_that_stays_wrong_counts_as_silent(watched: Watched) -> None:
    reads = watched.robot.safety.max_stale_reads
    stale = [watched.read(gyro=5.0).imu_stale for _ in range(reads + 3)]
    assert stale[:reads] == [0] * reads and stale[-1] > reads
    assert watched.checks.imu_suspicion.level[0] > reads


def test_a_fall_is_believed_tick_by_tick(watched: Watched) -> None:
    """Nothing may delay its detection: a robot that topples over turns as g / h makes it."""
    height = watched.robot.gait.stand_hip_height
    rate, angle = 0.0, 0.05
    for _ in range(200):
        rate += GRAVITY / height * np.sin(angle) / RATE
        angle += rate / RATE
        if angle > 1.5:
            break
        state = watched.read(gyro=rate)
        assert state.gyro[0] == pytest.approx(rate) and state.imu_stale == 0
    assert angle > 1.5 and watched.checks.disbelieved == 0


def test_limp_joints_may_be_moved_by_hand(watched: Watched) -> None:
    watched.true[KNEE] += 0.5
    for _ in range(20):
        state = watched.read(powered=False)
    assert state.position[KNEE] == watched.true[KNEE] and state.stale[KNEE] == 0


def test_a_sensor_that_was_wrong_for_minutes_is_believed_again_within_seconds() -> None:
    """Each wrong sample of an IMU counted: after ten seconds of them falls were not detected for 100 s."""
    suspicion, yes = Suspicion(1, patience=5), np.ones(1, np.bool_)
    for _ in range(10_000):
        suspicion.note(yes, yes)
    for _ in range(200):
        suspicion.note(~yes, yes)
    assert suspicion.level[0] < 5.0 and suspicion.total == 10_000


@pytest.mark.parametrize("reads", [1, 5, 19, 20, 25, 60])
def test_however_patient_a_robot_file_is_a_sensor_that_goes_on_lying_is_found(op3: Robot, reads: int) -> None:
    """The level of suspicion ended at 20: with `max_stale_reads: 20` and more, 200 degrees for good were no fault."""
    watched = Watched(patient(op3, reads))
    watched.read()
    for _ in range(reads + 1):
        watched.read(temperature=200.0, accel=200.0)
    assert watched.level("temperature") > reads and watched.checks.imu_suspicion.level[0] > reads
    for _ in range(1000):
        watched.read(temperature=200.0)
    for _ in range(40 * reads + 1):
        watched.read()
    assert watched.level("temperature") == 0


def test_a_gyro_that_was_frozen_is_believed_again_once_torque_is_off(watched: Watched) -> None:
    """Frozen at the rate of a jerk, it was held there for good: at rest the difference stayed too large."""
    watched.read(gyro=1.4)
    for _ in range(10):
        watched.read(gyro=5.0)
    assert watched.state.gyro[0] == pytest.approx(1.4) and watched.state.imu_stale > 0
    for _ in range(300):
        watched.read(powered=False)
    assert watched.state.gyro[0] == 0.0 and watched.state.imu_stale == 0


def turn(watched: Watched, rate: float) -> None:
    """The torso turns faster and faster, up to a rate [rad/s], as in a fall."""
    for now in np.linspace(0.0, rate, 20):
        watched.read(gyro=float(now))


def test_a_gyro_is_believed_again_at_rest_after_an_impact_that_fell_between_two_samples(watched: Watched) -> None:
    """The chest of a robot that got up hit the floor: its gyro said rest ever after, and the last turn was believed."""
    turn(watched, 4.5)
    held = []
    while not watched.checks.imu_restored:
        assert len(held) < 2 * REST_S * RATE
        held.append(watched.read(lies=True).gyro[0])
    assert held[:-1] == [4.5] * (len(held) - 1) and held[-1] == 0.0 and len(held) >= REST_S * RATE
    assert watched.state.imu_stale == 0 and watched.checks.imu_suspicion.level[0] == 0


def test_a_robot_that_balances_does_not_trust_a_rest(watched: Watched) -> None:
    """Its fall would not be seen by a gyro that is dead."""
    turn(watched, 4.5)
    for _ in range(round(3 * REST_S * RATE)):
        state = watched.read()
    assert state.gyro[0] == 4.5 and state.imu_stale > 0


@pytest.mark.parametrize("shown", ["a turn", "a push", "gravity that turns", "a topple"])
def test_a_gyro_that_falls_silent_in_a_turn_is_not_believed_where_the_accelerometer_shows_no_rest(
    watched: Watched, shown: str
) -> None:
    """The torso of a lying robot turns, or is pushed, all the same: the IMU counts as silent."""
    turn(watched, 4.5)
    angle, rate, height = 0.1, 1.6, watched.robot.gait.stand_hip_height
    for tick in range(round(3 * REST_S * RATE)):
        force = np.array([0.0, 0.0, GRAVITY])
        if shown == "a push":
            force[0] = 0.6 * GRAVITY
        elif shown == "gravity that turns":
            force = GRAVITY * np.array([0.0, math.sin(1.8 * tick / RATE), math.cos(1.8 * tick / RATE)])
        elif shown == "a topple":  # of a mass on a rod: along the rod, less than gravity by what makes it turn
            rate += GRAVITY / height * math.sin(angle) / RATE
            angle = min(angle + rate / RATE, 1.5)
            force[2] = GRAVITY * math.cos(angle) - rate**2 * height
        state = watched.read(lies=True, force=force, **({"gyro": 0.6} if shown == "a turn" else {}))
    assert state.gyro[0] == pytest.approx(4.5) and state.imu_stale > 0


def test_a_sensor_that_lies_while_torque_is_off_is_held_against_a_start(watched: Watched) -> None:
    """Every check without torque forgot it: the robot stood up, and fell into a fault on its feet."""
    for _ in range(100):
        watched.read(powered=False, voltage=30.0, accel=40.0)
    patience = watched.robot.safety.max_stale_reads
    assert watched.level("voltage") > patience and watched.checks.imu_suspicion.level[0] > patience
    for _ in range(600):
        watched.read(powered=False)
    assert watched.level("voltage") == 0 and watched.checks.imu_suspicion.level[0] == 0


@pytest.mark.parametrize("filter_s", [0.03, 0.08, 0.2])
@pytest.mark.parametrize("share", [0.7, 0.95])
def test_a_speed_that_lags_behind_is_bounded_and_the_position_stays_believed(
    watched: Watched, filter_s: float, share: float
) -> None:
    """Feetech's servos filter their speed: a fast joint's positions were doubted for it, in the end for good.

    The joint swings to and fro, and reaches `share` of its no-load speed in each second.
    """
    told, keeps = 0.0, np.exp(-1.0 / RATE / filter_s)
    most = share * float(watched.robot.no_load_speed[KNEE])
    for tick in range(500):
        watched.speed[KNEE] = most * np.sin(2 * np.pi * tick / RATE)
        told += (1.0 - keeps) * (watched.speed[KNEE] - told)
        state = watched.read(velocity=told - watched.speed[KNEE])
        assert state.stale[KNEE] == 0 and state.position[KNEE] == watched.true[KNEE], tick
        assert abs(state.velocity[KNEE] - watched.speed[KNEE]) < 0.3 * most
    patience = watched.robot.safety.max_stale_reads
    assert max(watched.level("position"), watched.level("speed")) < patience


def test_a_speed_that_lies_takes_no_position_with_it(watched: Watched) -> None:
    """The joint was driven blind to its rest pose although its positions were right."""
    for _ in range(20):
        state = watched.read(velocity=4.5)
        assert state.stale[KNEE] == 0 and state.position[KNEE] == watched.true[KNEE]
    assert watched.level("speed") > watched.robot.safety.max_stale_reads


class LongWay(Plausibility):
    """Checks that never take their short way."""

    def _as_expected(self, *_: object) -> bool:
        return False


def test_the_short_way_believes_what_the_long_way_believes(op3: Robot) -> None:
    """Over two thousand ticks with lies, gaps, silences and torque that goes off."""
    random = np.random.default_rng(0)
    short, long = Watched(op3), Watched(op3)
    long.checks = LongWay(op3)
    kinds = ("position", "velocity", "voltage", "temperature", "gyro", "accel")
    taken = 0
    for _ in range(2000):
        wrong = {}
        if random.random() < 0.1:
            wrong[str(random.choice(kinds))] = float(random.choice([0.02, 0.4, 6.0, 60.0, np.nan]))
        silent = int(random.integers(op3.n)) if random.random() < 0.03 else None
        powered, speed = random.random() > 0.02, float(random.choice([0.0, 0.0, 0.5, 3.0]))
        short.speed[KNEE] = long.speed[KNEE] = speed
        taken += short.checks._calm
        for each in (short, long):
            each.read(powered=powered, silent=silent, **wrong)
        ours, theirs = short.checks, long.checks
        for name in ("position", "velocity", "voltage", "temperature", "stale", "gyro", "accel", "imu_stale"):
            np.testing.assert_array_equal(getattr(short.state, name), getattr(long.state, name), err_msg=name)
        for name in ("unread", "doubted", "expected", "returned", "disbelieved"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
        for one, other in zip(ours.suspicions, theirs.suspicions, strict=True):
            np.testing.assert_array_equal(one.level, other.level)
    assert taken > 200
