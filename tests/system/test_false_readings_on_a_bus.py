"""False readings over an emulated bus: the goals stay those of the true run; a sensor that goes on is named."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import Robot
from flexmotion.human.motion import Motion

from .bus_runs import Run, through_bytes

AT = 1.7
"""When false readings come, after torque went on [s]; the arms swing."""
APART = 0.16
"""Time between false readings of one run [s]."""
MOST_STEP = np.radians(1.7)
"""Greatest change in a tick of a goal's difference from that of the true run [rad]."""

ONCE = {
    "a step of 400 ticks moved the knee's goal 32 degrees": "false_position:14:400",
    "a step of a turn moved it 70 degrees": "false_position:14:-4096",
    "a moving joint": "false_position:1:300",
    "a speed below that without load": "false_speed:14:-4",
    "a speed that no servo has": "false_speed:1:60",
    "no supply": "false_voltage:14:-11",
    "a temperature at which the robot was parked": "false_temperature:14:50",
    "a temperature of no servo": "false_temperature:14:200",
    "a turn of the torso": "false_gyro:8",
    "a strike": "false_accel:120",
}
FOR_GOOD = {
    "false_position:14:4096": "servo of l_knee (id 14) measures a position that cannot be",
    "false_position:14:1000": "servo of l_knee (id 14) measures a position that cannot be",
    "false_speed:14:50": "servo of l_knee (id 14) measures a speed that cannot be",
    "false_voltage:14:-8": "servo of l_knee (id 14) measures a voltage that cannot be",
    "false_temperature:14:200": "servo of l_knee (id 14) measures a temperature that cannot be",
}


@pytest.fixture(scope="module")
def clean(op3: Robot) -> Run:
    return through_bytes(op3)


@pytest.fixture(scope="module")
def lied_to(op3: Robot) -> Run:
    """A run with all that is read falsely once, one after the other around `AT`."""
    return through_bytes(op3, *(f"{fault}@{comes_at(fault):.2f}+once" for fault in ONCE.values()))


def comes_at(fault: str) -> float:
    """When a false reading of `lied_to` comes, after torque went on [s]."""
    place = list(ONCE.values()).index(fault)
    return AT + APART * (place - len(ONCE) // 2)


def greatest_step(run: Run, clean: Run, ticks: slice) -> float:
    """Greatest change in a tick of a goal's difference from that of the true run [rad]."""
    offset = run.record.q_cmd[ticks] - clean.record.q_cmd[ticks]
    return float(np.nanmax(np.abs(np.diff(offset, axis=0))))


def both(run: Run, clean: Run) -> slice:
    """Ticks that both runs have."""
    return slice(min(run.record.used, clean.record.used))


@pytest.mark.parametrize("fault", ONCE.values(), ids=ONCE.keys())
def test_one_false_reading_moves_no_goal(clean: Run, lied_to: Run, fault: str) -> None:
    ticks = slice(lied_to.tick_at(comes_at(fault)) - 2, lied_to.tick_at(comes_at(fault) + APART) - 2)
    assert greatest_step(lied_to, clean, ticks) < MOST_STEP
    disbelieved = lied_to.record.rows["disbelieved"][ticks]
    # A strike of 12 g reads as 2 g, the end of OP3's range, and steps strike as hard: nothing is wrong with it.
    assert int(disbelieved[-1] - disbelieved[0]) == (0 if "accel" in fault else 1)


def test_single_false_readings_change_nothing_in_the_course_of_a_run(clean: Run, lied_to: Run) -> None:
    assert lied_to.states == clean.states and lied_to.driver.violations == 0
    assert greatest_step(lied_to, clean, both(lied_to, clean)) < MOST_STEP


@pytest.mark.parametrize(("fault", "message"), FOR_GOOD.items())
def test_a_sensor_that_stays_wrong_is_named_and_the_robot_parked(
    op3: Robot, clean: Run, fault: str, message: str
) -> None:
    """A knee whose position was a turn off went to its limit, without a message."""
    run = through_bytes(op3, f"{fault}@{AT}")
    assert run.states[-3:] == ["STREAMING -> HOLD", "HOLD -> PARK", "PARK -> FAULT"]
    assert run.end == f"PARK -> FAULT: {message}"
    assert run.driver.violations == 0 and run.body is not None and not run.body.fell
    stop = next(event.tick for event in run.record.events if "-> HOLD" in event.message)
    knee = op3.index("l_knee")
    offset = run.record.q_cmd[:stop, knee] - clean.record.q_cmd[:stop, knee]
    assert np.nanmax(np.abs(np.diff(offset))) < MOST_STEP


@pytest.mark.parametrize("fault", ["false_gyro:3", "false_accel:40"])
def test_an_imu_that_stays_wrong_is_not_used(op3: Robot, clean: Run, fault: str) -> None:
    """The robot was damped for a fall that the gyroscope alone had seen."""
    run = through_bytes(op3, f"{fault}@{AT}")
    assert run.states == clean.states and run.body is not None and not run.body.fell
    warnings = [event.message for event in run.record.events if event.kind == "warning"]
    assert warnings == ["the IMU measures what cannot be: the robot runs open loop, falls are not detected"]


def test_false_readings_at_random_change_nothing(op3: Robot, clean: Run) -> None:
    run = through_bytes(op3, false_readings=0.01, seed=1)
    assert run.states == clean.states and run.driver.violations == 0
    assert run.body is not None and not run.body.fell
    assert int(run.record.rows["disbelieved"][-1]) > 20
    assert greatest_step(run, clean, both(run, clean)) < np.radians(4)


HOLD_S = 1.5


@pytest.fixture
def held_shortly(op3: Robot, monkeypatch: pytest.MonkeyPatch) -> Robot:
    """OP3 that stands for a shorter time with a blocked leg."""
    monkeypatch.setattr(op3, "safety", op3.safety.model_copy(update={"blocked_hold_s": HOLD_S}))
    return op3


@pytest.mark.parametrize(
    ("blocked", "at_s", "lies"),
    # One moment of seven throws a robot whose ankle freezes in a step.
    [
        ("l_knee", 2.0, ()),
        ("l_knee", 2.0, ("false_speed:14:0.35@2.0",)),
        ("r_knee", 2.0, ()),
        ("l_ank_pitch", 2.15, ()),
    ],
    ids=["l_knee", "l_knee, its speed reads as moving", "r_knee", "l_ank_pitch"],
)
def test_a_robot_that_walks_with_a_blocked_leg_is_frozen_and_stands(
    held_shortly: Robot, steps: Motion, blocked: str, at_s: float, lies: tuple[str, ...]
) -> None:
    """A blocked knee was named as the robot fell, 6.7 s later, or never if its speed register was stuck at 0.35 rad/s.

    The plan was played on to its stop with it, and then the robot was lowered to its rest pose: it fell in both.
    """
    id_ = held_shortly.joints[held_shortly.index(blocked)].id
    run = through_bytes(held_shortly, f"blocked:{id_}@{at_s}", *lies, motion=steps)
    assert f"servo of {blocked} (id {id_}) does not follow its goals" in run.end
    assert "it stands still while they lead it" in run.end
    (named,) = [event.tick for event in run.record.events if "STREAMING -> HOLD" in event.message]
    (parked,) = [event.tick for event in run.record.events if "HOLD -> PARK" in event.message]
    knee, record = held_shortly.index(blocked), run.record
    away = np.abs(record.q_ref[:named, knee] - record.q[:named, knee])
    led = int(np.flatnonzero(away < 0.08)[-1])  # from here on the plan has left it behind
    assert (named - led) / held_shortly.rate_hz < 0.3
    assert parked - named == pytest.approx(HOLD_S * held_shortly.rate_hz, abs=1)
    assert run.lowest > 0.9 * record.true_base[named, 2]
    frozen = record.q_cmd[named + 1 : parked]
    assert (frozen == frozen[0]).all()
    assert abs(frozen[0, knee] - record.q[named, knee]) < 0.01  # its servo pushes no more
    assert run.driver.violations == 0 and np.isfinite(record.q).all()  # the simulation of a blocked joint diverged
