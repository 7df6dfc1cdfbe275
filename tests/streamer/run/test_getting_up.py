"""A robot that has fallen gets up on request alone, through the loop, its clamps and its ladder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.get_up import GetUp
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.simulated import lockstep
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.start_check import gets_up_from
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.run.requests import Request

from .test_arming import TURN, Attended


class Fallen(Attended):
    """An attended run whose robot is pushed over, once it stands if it was armed at once.

    Args:
        push: impulse, ahead and to the left [N·s].
    """

    def __init__(self, push: tuple[float, float], *, at_s: float = 3.0, **options: object) -> None:
        impulse = (*push, 0.0)
        super().__init__(pushes=[{"at": at_s, "impulse": impulse, "duration": 0.2}], **options)

    def fall(self) -> None:
        self.ask(Request.ARM)
        self.until_state(State.DAMPED)
        self.until_state(State.FAULT)
        self.session.advance(1.0)

    @property
    def upright(self) -> bool:
        return upright(self)


def upright(run: Attended) -> bool:
    _, x, y, _ = run.session.record.true_base[-1, 3:]
    return bool(1 - 2 * (x * x + y * y) > 0.95)


AHEAD, BACK, ASIDE = (1.6, 0.0), (-1.6, 0.0), (0.0, 3.2)


@pytest.mark.parametrize("push", [AHEAD, BACK])
def test_after_a_fall_the_run_goes_on_and_the_robot_gets_up_on_request(push: tuple[float, float]) -> None:
    """A fall ended in FAULT for good: the robot had to be put up by hand before the run was of use again."""
    run = Fallen(push)
    with run.session as session:
        run.fall()
        session.advance(3.0)
        assert session.state.ladder is State.FAULT and not run.upright, "it does nothing by itself"
        assert run.messages("fault")[-1].startswith("DAMPED -> FAULT: fall:")
        run.ask(Request.GET_UP)
        assert session.state.ladder is State.GET_UP
        run.until_state(State.READY)
        assert run.messages("done") == ["GET_UP"]
        run.until(lambda: session.telemetry.ticks.latest()["ready"], "the robot to stand")
        session.advance(1.0)
        assert session.state.ladder is State.READY, "what was asked before does not go on"
        accepted = run.answer(session.send(TURN).id)
        assert accepted.state == "accepted"
        session.advance(2.0)
        assert session.state.ladder is State.STREAMING and run.upright
        session.finish()
    assert session.record.state[-1] == State.OFF and session.record.violations_sent == 0


def test_a_robot_that_collapsed_limp_onto_its_front_gets_up() -> None:
    """Its chest struck the floor between two samples of the IMU, which was not believed any more: it lay at "0°"."""
    run = Fallen((0.8, 0.0), at_s=8.0)
    with run.session as session:
        run.ask(Request.ARM)
        run.until(lambda: session.state.time_s >= 8.1, "the push")
        run.ask(Request.KILL)
        session.advance(5.0)
        assert session.telemetry.ticks.latest()["tilt"][1] > 1.2, "it lies on its front"
        run.ask(Request.GET_UP)
        run.until_state(State.READY)
        assert run.messages("done") == ["GET_UP"] and run.upright


def test_clear_leads_to_off_and_arm_names_the_way_up() -> None:
    run = Fallen(AHEAD)
    with run.session as session:
        run.fall()
        run.ask(Request.CLEAR)
        assert session.state.ladder is State.OFF
        run.ask(Request.ARM)
        assert session.state.ladder is State.OFF
        assert run.messages("refused")[-1].endswith("or let it get up: flexmotion clear --get-up")
        run.ask(Request.GET_UP)
        run.until_state(State.READY)


@pytest.mark.parametrize("request_", [Request.ESTOP, Request.STOP, Request.DISARM, Request.KILL])
@pytest.mark.parametrize("after_s", [0.5, 4.0])
def test_every_stop_ends_it(request_: Request, after_s: float) -> None:
    run = Fallen(AHEAD)
    with run.session as session:
        run.fall()
        run.ask(Request.GET_UP)
        session.advance(after_s)
        assert session.state.ladder is State.GET_UP
        session.ask(request_)
        session.advance(2 / session.robot.rate_hz)
        assert session.state.ladder is (State.FAULT if request_ is Request.KILL else State.DAMPED)
        (refused,) = run.messages("refused")
        assert refused.startswith("GET_UP: ") and "operator" in refused
        run.until_state(State.FAULT)
        session.advance(3.0)
        assert session.state.ladder is State.FAULT and not run.upright, "it lies, and does not try again"


def test_the_end_of_the_run_ends_it_too() -> None:
    run = Fallen(BACK)
    with run.session as session:
        run.fall()
        run.ask(Request.GET_UP)
        session.advance(2.0)
        session.finish()
    assert session.record.state[-1] == State.FAULT


def test_a_simulated_robot_whose_torque_was_cut_in_mid_walk_stays_where_it_fell() -> None:
    """It stood again 3 s after a KILL, held by nobody; asked to get up, as its attitude said, it threw itself over."""
    run = Attended(picked_up_s=1.5)
    with run.session as session:
        run.ask(Request.ARM)
        run.until_state(State.HOLD)
        session.send(Velocity(0.4, 0.0, 0.0))
        session.advance(3.0)
        run.ask(Request.KILL)
        session.advance(6.0)
        assert not upright(run)
        run.ask(Request.GET_UP)
        run.until_state(State.READY)
        assert run.messages("done") == ["GET_UP"] and upright(run)


def test_a_simulated_robot_that_tips_over_as_it_rests_is_set_up() -> None:
    """No fall after the torque went off counted; that of a parked robot, which nobody has made fall, still does not."""
    run = Attended(picked_up_s=1.5)
    with run.session as session:
        run.ask(Request.ARM)
        run.until_state(State.HOLD)
        run.ask(Request.DISARM)
        run.until_state(State.OFF)
        driver = lockstep(session.driver)
        assert driver is not None
        driver.push((2.5, 0.0, 0.0), 0.2)  # type: ignore[attr-defined]
        session.advance(1.0)
        assert not upright(run)
        session.advance(1.0)
        assert upright(run)


def test_one_that_was_just_set_up_does_not_get_up() -> None:
    """The attitude follows over seconds: for four of them it still lay, and the motion threw a standing robot over."""
    run = Fallen(AHEAD)
    with run.session as session:
        run.fall()
        driver = lockstep(session.driver)
        assert driver is not None
        driver.place()  # type: ignore[attr-defined]
        session.advance(0.5)
        assert session.telemetry.ticks.latest()["tilt"][1] > 1.0, "the attitude says that it lies"
        assert "how it lies is not known yet" in refused(run)
        assert gets_up_from(session.robot, TickRow(session.telemetry.ticks.latest())) is None
        session.advance(8.0)
        assert "the robot does not lie" in refused(run)


def refused(run: Attended) -> str:
    before = run.session.state.ladder
    run.ask(Request.GET_UP)
    assert run.session.state.ladder is before
    return run.messages("refused")[-1]


def test_it_is_refused_while_the_robot_stands() -> None:
    run = Attended()
    with run.session:
        run.session.advance(0.5)
        assert refused(run) == "GET_UP: the robot does not lie: clear, then arm"
        run.ask(Request.ARM)
        run.until_state(State.HOLD)
        assert refused(run) == "GET_UP: torque is on, the robot is in HOLD"


def test_it_is_refused_on_the_side() -> None:
    run = Fallen(ASIDE)
    with run.session:
        run.fall()
        assert refused(run).startswith("GET_UP: the robot lies on its side, it gets up from its front or back alone")
        run.ask(Request.CLEAR)
        run.ask(Request.ARM)
        assert "get-up" not in run.messages("refused")[-1]


def test_it_is_refused_with_a_faulty_servo_and_ended_by_one() -> None:
    run = Fallen(AHEAD)
    with run.session as session:
        run.fall()
        driver = lockstep(session.driver)
        assert driver is not None
        driver._hardware_error[3] = 0x04  # type: ignore[attr-defined]
        assert "reports hardware error 0x04" in refused(run)
        driver._hardware_error[3] = 0  # type: ignore[attr-defined]
        run.ask(Request.GET_UP)
        session.advance(2.0)
        driver._hardware_error[3] = 0x04  # type: ignore[attr-defined]
        session.advance(0.1)
        assert session.state.ladder is State.DAMPED
        assert run.messages("refused")[-1].startswith("GET_UP: servo of l_sho_roll")


def test_a_robot_that_does_not_come_up_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its legs are held: it is not upright after a step, and gives way."""
    run = Fallen(AHEAD)
    with run.session as session:
        run.fall()
        driver = lockstep(session.driver)
        assert driver is not None
        for joint in ("l_sho_pitch", "r_sho_pitch"):
            driver.block(session.robot.index(joint), True)  # type: ignore[attr-defined]
        run.ask(Request.GET_UP)
        run.until_state(State.DAMPED)
        reason = run.messages("refused")[-1]
        assert reason.startswith("GET_UP: get up: after step") and "the torso is pitched by" in reason
        run.until_state(State.FAULT)
        assert np.isfinite(session.record.true_base[-1]).all()


def test_without_a_file_it_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = Fallen(AHEAD)
    monkeypatch.setattr(run.session.robot, "get_up", GetUp({}, {}))
    with run.session:
        run.fall()
        assert "has no get_up.yaml" in refused(run)


def test_an_arm_beside_a_get_up_is_refused() -> None:
    """Asked for both in one tick, a robot that must not get up was armed without any check."""
    run = Fallen(ASIDE)
    with run.session as session:
        run.fall()
        run.ask(Request.CLEAR)
        session.ask(Request.ARM)
        session.ask(Request.GET_UP)
        session.advance(0.1)
        assert session.state.ladder is State.OFF
        arm, get_up = run.messages("refused")[-2:]
        assert arm == "ARM: the robot is asked to get up" and get_up.startswith("GET_UP: the robot lies on its side")


def test_an_imu_that_is_lost_half_way_up_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without one the tilt is that of the last plan, and steps would pass unseen."""
    run = Fallen(BACK)
    with run.session as session:
        run.fall()
        session.advance(2.0)  # what the fall held against the IMU is forgotten
        run.ask(Request.GET_UP)
        session.advance(2.0)
        assert session.state.ladder is State.GET_UP
        driver = lockstep(session.driver)
        assert driver is not None
        read = driver.read

        def late(state: RobotState) -> None:
            read(state)
            state.imu_stale = 100

        monkeypatch.setattr(driver, "read", late)
        run.until_state(State.DAMPED)
        assert session.loop is not None and "the IMU is silent" in str(session.loop.ladder.fault)


def test_a_run_that_begins_lying_does_its_first_request_once_it_has_got_up() -> None:
    """A get-up from OFF dropped what the run was started with: the robot got up and stood."""
    run = Fallen(BACK, at_s=0.1, held=False)
    with run.session as session:
        session.advance(3.0)
        assert session.state.ladder is State.OFF and not run.upright
        run.ask(Request.GET_UP)
        run.until_state(State.READY)
        run.until_state(State.STREAMING)
        session.advance(1.0)
        assert run.upright and np.nanmax(session.record.ticks.source_s) > 0.0, "it has followed its human"


@pytest.mark.parametrize("stop", [Request.STOP, Request.ESTOP, Request.DISARM, Request.KILL])
@pytest.mark.parametrize("clears", [False, True])
def test_one_that_a_stop_of_its_own_tick_overrides_is_answered_with_who_sent_it(stop: Request, clears: bool) -> None:
    """It had no effect and no event: its sender was told so after 60 s."""
    run = Fallen(AHEAD)
    with run.session as session:
        run.fall()
        if clears:
            run.ask(Request.CLEAR)
        session.requests.send(Request.GET_UP, "page 1: clear")
        session.requests.send(stop, "phone: stop")
        session.step()
        assert session.state.ladder is not State.GET_UP
        assert run.messages("refused") == [f"GET_UP: overridden in its own tick by {stop.name} from phone"]
