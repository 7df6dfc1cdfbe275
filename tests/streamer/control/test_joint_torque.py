"""An operator makes single joints limp and stiff while the robot stands, and restarts servos while it has no torque."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.lockstep import LockstepBus
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.servo import OVERLOAD
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.registry import create
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.joint_torque import LIMP, REBOOT, STIFF
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.servo_command import DECAY_SHARE
from flexmotion.streamer.control.telemetry import Event, Telemetry, events
from flexmotion.streamer.control.tick_row import TickRow

ARM = ("l_sho_pitch", "l_sho_roll", "l_el")
ALL_ARMS = (*ARM, "r_sho_pitch", "r_sho_roll", "r_el", "head_pan", "head_tilt")
MOST_TICKS = 2500
"""Bound against hanging."""


class Stand:
    """A loop on a robot that can be armed.

    Attributes:
        body: the simulated robot behind the bus or in driver `sim`.
        world: the emulated buses; None with driver `sim`.
    """

    def __init__(self, loop: ControlLoop, body: SimDriver, world: Loopback | None) -> None:
        self.loop, self.body, self.world = loop, body, world
        self._events, self.seen = loop.telemetry.events.reader(), list[Event]()
        self._rows = loop.telemetry.ticks.reader()

    def run(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            self.loop.tick()
            self.loop.driver.advance(0.008)  # type: ignore[attr-defined]

    def until(self, condition: Callable[[], bool]) -> None:
        end = self.loop.tick_count + MOST_TICKS
        while not condition():
            assert self.loop.tick_count < end, "the condition never held"
            self.run()

    def arm(self) -> None:
        self.loop.inputs.start = True
        self.run()
        self.until(lambda: self.loop.ready)

    def disarm(self) -> None:
        self.loop.inputs.park = True
        self.run()
        self.until(lambda: self.loop.ladder.state is State.OFF)

    def ask(self, what: str, *joints: str) -> list[str]:
        """What the loop answers to a request within two ticks."""
        self.told()
        self.loop.joints.ask(what, joints)
        self.run(2)
        return self.told()

    def told(self) -> list[str]:
        new = events(self._events)
        self.seen += new
        return [f"{event.kind}: {event.message}" for event in new if event.kind in ("refused", "done", "fault")]

    def rows(self) -> TickRow:
        return TickRow(self._rows.read())

    @property
    def powered(self) -> set[str]:
        names = self.loop.robot.joint_names
        return {name for name, on in zip(names, self.body.plant.enabled, strict=True) if on}


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def retargeter(op3: Robot) -> Retargeter:
    return Retargeter(op3, load_stream())


@contextmanager
def on_sim(robot: Robot) -> Iterator[tuple[SimDriver, SimDriver, None]]:
    with SimDriver(robot, options=SimOptions()) as driver:
        yield driver, driver, None


@contextmanager
def on_bus(robot: Robot, **lies: float) -> Iterator[tuple[LockstepBus, SimDriver, Loopback]]:
    body = SimBody(robot)
    world = Loopback(body, **lies)
    driver = create("dynamixel", robot, port="main")
    assert isinstance(driver, BusDriver)
    with LockstepBus(driver, world, body) as stepped:
        yield stepped, body.driver, world


@pytest.fixture
def stand(op3: Robot, retargeter: Retargeter) -> Iterator[Callable[..., Stand]]:
    """Function (where, **lies) -> a loop on `sim` or on an emulated bus of Dynamixels."""
    with ExitStack() as stack:

        def make(where: str, **lies: float) -> Stand:
            found = on_sim(op3) if where == "sim" else on_bus(op3, **lies)
            driver, body, world = stack.enter_context(found)
            plans = PlanBuffer(op3.n, retargeter.layout.size, retargeter.horizon, op3.rate_hz)
            loop = ControlLoop(op3, driver, retargeter, plans, Telemetry(op3.n, op3.rate_hz))
            return Stand(loop, body, world)

        yield make


def pull(one: Stand, joint: str, torque: float, ticks: int) -> None:
    """Turn a joint by hand."""
    index = one.loop.robot.joint_names.index(joint)
    step = one.body._step

    def pulled() -> None:
        plant_step = one.body.plant.step

        def turned(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
            made = plant_step(position, velocity).copy()
            made[index] += torque
            return made

        one.body.plant.step = turned  # type: ignore[method-assign]
        step()
        one.body.plant.step = plant_step  # type: ignore[method-assign]

    one.body._step = pulled  # type: ignore[method-assign]
    one.run(ticks)
    one.body._step = step  # type: ignore[method-assign]


@pytest.mark.parametrize("where", ["sim", "bus"])
def test_a_limp_joint_gives_way_and_comes_back_slowly_from_where_it_is(
    stand: Callable[..., Stand], op3: Robot, where: str
) -> None:
    """An operator could cut the torque of the whole robot alone."""
    one = stand(where)
    one.arm()
    joint = op3.joint_names.index("head_pan")
    assert one.ask(LIMP, "head_pan") == [] and one.powered == set(op3.joint_names) - {"head_pan"}
    pull(one, "head_pan", 0.2, 60)
    one.run(80)  # it has come to rest
    moved = one.loop.state.position[joint]
    assert 0.3 < moved < op3.upper[joint], "it gives way to a hand"
    one.rows()
    assert one.ask(STIFF, "head_pan") == [] and one.powered == set(op3.joint_names)
    one.until(lambda: abs(one.loop.state.position[joint] - one.loop.now.q[joint]) < 0.02)
    goals = one.rows().q_cmd[:, joint]
    # The reference comes back at the first speed; what it needs as a lead decays at the second.
    most = (op3.safety.soft_start_speed + DECAY_SHARE * op3.no_load_speed[joint]) / op3.rate_hz
    assert abs(goals[0] - moved) < 0.03, "it begins where it is"
    assert np.abs(np.diff(goals)).max() < 1.001 * most, "no jump"
    assert np.median(np.abs(np.diff(goals))) < 1.001 * op3.safety.soft_start_speed / op3.rate_hz
    one.run(100)
    assert one.told() == [] and one.loop.ready and one.loop.driver.violations == 0


@pytest.mark.parametrize("where", ["sim", "bus"])
def test_a_robot_with_limp_arms_and_head_goes_on_standing_and_parks(stand: Callable[..., Stand], where: str) -> None:
    one = stand(where)
    one.arm()
    assert one.ask(LIMP, *ALL_ARMS) == []
    one.run(250)
    assert one.loop.ready and one.loop.must_stop and one.body.torso_up > 0.99
    assert one.rows().limp[-1].sum() == len(ALL_ARMS)
    one.disarm()
    assert one.powered == set() and not one.loop.joints.limp.any()
    one.arm()
    assert one.powered == set(one.loop.robot.joint_names), "armed again, all joints have torque"
    assert one.told() == []


def test_a_hand_that_turns_a_limp_joint_fast_is_no_lie_and_no_disobedience(
    stand: Callable[..., Stand], op3: Robot
) -> None:
    """A joint under torque that leaves its limits is not believed, and one far from its goal does not follow it."""
    one = stand("bus")
    one.arm()
    one.ask(LIMP, "l_el")
    pull(one, "l_el", -0.8, 50)
    one.run(100)
    assert one.loop.ready and one.told() == []
    assert one.loop.obedience.worst is None and not one.loop.plausibility._never.any()


@pytest.mark.parametrize("joint", ["l_knee", "r_ank_roll", "l_hip_yaw"])
def test_a_standing_robot_never_loses_the_torque_of_a_leg(stand: Callable[..., Stand], joint: str) -> None:
    one = stand("sim")
    one.arm()
    assert one.ask(LIMP, "l_el", joint) == [
        f"refused: LIMP l_el,{joint}: {joint}: carries the robot, and never goes limp by itself; disarm it"
    ]
    assert one.powered == set(one.loop.robot.joint_names), "the elbow neither"


def test_a_leg_is_refused_as_such_whatever_the_robot_does(stand: Callable[..., Stand]) -> None:
    """The advice was to let the robot come to a stand, or to arm it, after which the leg was refused all the same."""
    one = stand("sim")
    one.run()
    never = "refused: LIMP l_knee: l_knee: carries the robot, and never goes limp by itself; disarm it"
    assert one.ask(LIMP, "l_knee") == [never], "in OFF"
    one.loop.inputs.start = True
    one.run(3)
    assert one.ask(LIMP, "l_knee") == [never], "while it stands up"


def test_what_is_refused_in_each_state(stand: Callable[..., Stand]) -> None:
    one = stand("sim")
    one.run()
    assert one.ask(LIMP, "l_el") == ["refused: LIMP l_el: in OFF no joint has torque; arm the robot"]
    assert one.ask(STIFF, "l_el") == ["refused: STIFF l_el: in OFF no joint has torque; arm the robot"]
    assert one.ask(REBOOT, "l_elb") == ["refused: REBOOT l_elb: no joint 'l_elb', did you mean: l_el, r_el"]
    one.loop.inputs.start = True
    one.run(3)
    moves = "in READY the robot moves: let it come to a stand first (hold)"
    assert one.ask(LIMP, "l_el") == [f"refused: LIMP l_el: {moves}"], "while it stands up"
    one.until(lambda: one.loop.ready)
    disarm = "in READY the robot has torque: a servo restarts in OFF and FAULT alone; disarm it first"
    assert one.ask(REBOOT, "l_el") == [f"refused: REBOOT l_el: {disarm}"]
    assert one.ask(STIFF, "l_el") == [], "it is"
    one.loop.inputs.estop = True
    one.run()
    latched = "a fault is latched: e-stop: frozen by an operator"
    assert one.ask(LIMP, "l_el") == [f"refused: LIMP l_el: {latched}"], "in HOLD"
    one.until(lambda: one.loop.ladder.state is State.PARK)
    one.told()
    assert one.ask(LIMP, "l_el") == [f"refused: LIMP l_el: {latched}"]
    one.until(lambda: one.loop.ladder.state is State.FAULT)
    one.told()
    assert one.ask(LIMP, "l_el") == ["refused: LIMP l_el: in FAULT no joint has torque; arm the robot"]
    assert one.powered == set()


def test_a_limp_joint_outside_its_limits_stays_limp(stand: Callable[..., Stand], op3: Robot) -> None:
    one = stand("sim")
    one.arm()
    one.ask(LIMP, "head_pan")
    joint = op3.joint_names.index("head_pan")
    one.body.model.jnt_limited[one.body.model.joint("head_pan").id] = False
    while one.loop.state.position[joint] < op3.upper[joint] + 0.2:
        pull(one, "head_pan", 0.15, 10)
        one.run(20)
    one.run(40)
    assert one.loop.state.position[joint] > op3.upper[joint] + 0.2
    (told,) = one.ask(STIFF, "head_pan")
    assert "more than 0.15 rad outside" in told and "head_pan" not in one.powered


def overload(one: Stand, id_: int) -> None:
    assert one.world is not None
    bus = one.world.emulator.lines[0].bus  # type: ignore[attr-defined]
    next(servo for servo in bus.servos if servo.id == id_).fail(OVERLOAD)


def test_a_servo_in_shutdown_restarts_and_the_robot_stands_up_again(stand: Callable[..., Stand], op3: Robot) -> None:
    """The run had to be ended for it: `servo reboot` needs the port for itself."""
    one = stand("bus")
    one.arm()
    id_ = op3.joints[op3.joint_names.index("l_el")].id
    overload(one, id_)
    one.until(lambda: one.loop.ladder.state is State.FAULT)
    assert "reports hardware error 0x" in str(one.loop.ladder.fault)
    one.told()
    assert one.ask(REBOOT, "l_el", "r_el") == []
    assert one.ask(REBOOT, "l_el") == ["refused: REBOOT l_el: restarting: l_el"]
    one.until(lambda: one.told() == ["done: REBOOT l_el,r_el"])
    one.loop.inputs.clear = True
    one.until(lambda: not one.loop.state.stale.any())
    writes = [servo.eeprom_writes for servo in one.world.emulator.lines[0].bus.servos]  # type: ignore[union-attr]
    assert not any(writes)
    one.until(lambda: bool(one.body.position[0] < 10) and one.loop.tick_count % 500 == 0)  # it is picked up
    one.arm()
    assert one.powered == set(op3.joint_names) and one.told() == []
    one.run(100)
    assert one.loop.ready and one.loop.driver.violations == 0


def test_a_servo_whose_error_comes_back_is_told(stand: Callable[..., Stand], op3: Robot) -> None:
    one = stand("bus")
    one.run(5)
    joint = op3.joint_names.index("l_el")
    one.body.plant.temperature[joint] = 150.0
    one.run(5)
    one.ask(REBOOT, "l_el")
    told: list[str] = []
    one.until(lambda: bool(told.extend(one.told()) or told))
    assert told[0].startswith("refused: REBOOT l_el: servo of l_el (id 6) on main: reports hardware error 0x04 after")


def test_a_servo_that_does_not_come_back_is_told(stand: Callable[..., Stand], op3: Robot) -> None:
    one = stand("bus")
    one.run(5)
    one.ask(REBOOT, "l_el")
    one.world.emulator.lines[0].bus.dead.add(op3.joints[op3.joint_names.index("l_el")].id)  # type: ignore[union-attr]
    told: list[str] = []
    one.until(lambda: bool(told.extend(one.told()) or told))
    assert told == ["refused: REBOOT l_el: servo of l_el (id 6) on main: does not answer 2 s after its reboot"]
    assert one.loop.joints.restarting is None


def test_a_driver_that_cannot_is_named(stand: Callable[..., Stand], monkeypatch: pytest.MonkeyPatch) -> None:
    one = stand("sim")
    one.arm()
    bare = one.loop.driver.capabilities.__class__(lockstep=True, truth=True)
    monkeypatch.setattr(SimDriver, "capabilities", bare)
    assert one.ask(LIMP, "l_el") == ["refused: LIMP l_el: driver 'sim' does not switch the torque of single joints"]
    one.disarm()
    one.told()
    told = "refused: REBOOT l_el: driver 'sim' does not restart servos: switch their power off and on"
    assert one.ask(REBOOT, "l_el") == [told]


@pytest.mark.parametrize("share", [0.3])
def test_lost_packets_do_not_keep_a_joint_stiff_or_limp(stand: Callable[..., Stand], share: float) -> None:
    """A sync write is not acknowledged."""
    one = stand("bus")
    one.arm()
    assert one.world is not None
    port, lost = one.loop.driver._driver.buses[0].port, [0]  # type: ignore[attr-defined]
    send = port.send

    def losing(data: bytes) -> None:
        torque = data[7:8] == b"\x83" and data[8:10] == (64).to_bytes(2, "little")
        lost[0] += torque
        if not (torque and lost[0] == 1):
            send(data)

    port.send = losing
    one.ask(LIMP, "l_el")
    one.run(10)
    assert lost[0] > 1 and "l_el" not in one.powered
    lost[0] = 0
    one.ask(STIFF, "l_el")
    one.run(10)
    assert lost[0] > 1 and "l_el" in one.powered and one.told() == []
