"""One sensor at a time: what is not believed, what becomes a fault, and what is true although it jumps."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.interface import RobotState
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.control.believed import Suspicion
from flexmotion.streamer.control.plausibility import KINDS, Plausibility

KNEE = 11
RATE = 125.0


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


class Watched:
    """Readings of a robot, checked tick by tick; its knee moves with `speed` [rad/s]."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.checks = robot, Plausibility(robot)
        self.state, self.tick, self.speed = RobotState(robot.n), 0, np.zeros(robot.n)
        self.true = robot.stand_pose.copy()

    def read(self, *, powered: bool = True, silent: int | None = None, **wrong: float) -> RobotState:
        """The next reading, wrong by so much; `silent`: a joint that does not answer."""
        state, robot = self.state, self.robot
        self.true += self.speed / RATE
        state.position[:], state.velocity[:] = self.true, self.speed
        state.voltage[:], state.temperature[:] = robot.nominal_voltage, 40.0
        state.gyro[:], state.accel[:] = 0.0, (0.0, 0.0, GRAVITY)
        state.stale[:], state.imu_stale = 0, 0
        for name, value in wrong.items():
            getattr(state, name)[0 if name in ("gyro", "accel") else KNEE] += value
        if silent is not None:
            state.stale[silent] = 1
        self.checks.check(state, self.speed, self.tick, powered=powered)
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
    suspicion, yes = Suspicion(1), np.ones(1, np.bool_)
    for _ in range(10_000):
        suspicion.note(yes, yes)
    for _ in range(200):
        suspicion.note(~yes, yes)
    assert suspicion.level[0] < 5.0 and suspicion.total == 10_000


def test_a_gyro_that_was_frozen_is_believed_again_once_torque_is_off(watched: Watched) -> None:
    """Frozen at the rate of a jerk, it was held there for good: at rest the difference stayed too large."""
    watched.read(gyro=1.4)
    for _ in range(10):
        watched.read(gyro=5.0)
    assert watched.state.gyro[0] == pytest.approx(1.4) and watched.state.imu_stale > 0
    for _ in range(300):
        watched.read(powered=False)
    assert watched.state.gyro[0] == 0.0 and watched.state.imu_stale == 0


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
