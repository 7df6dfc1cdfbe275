"""A session stepped by a program, and its state."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError, SessionError
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.api import open_session
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.clip_library import ClipLibrary
from flexmotion.streamer.motion.intents import Clip, Intent, Stop, Text, Velocity
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.sources import ClipSource, Source
from flexmotion.streamer.outcome import outcome
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

from ...virtual_time import virtual_time

STEPS, WAVE = default_clip()[225:290], default_clip()[:120]
TIMING = {"stamp_ns", "work_s", "lateness_s", "robot_lateness_s", "sample_s", "retarget_s"}


def library() -> ClipLibrary:
    return ClipLibrary({"steps": STEPS, "wave": WAVE}, "steps")


def test_a_stepped_run_is_the_run() -> None:
    whole = open_session("op3", source=ClipSource(STEPS), seed=2)
    whole.run()
    with open_session("op3", source=ClipSource(STEPS), seed=2) as stepped:
        while stepped.step():
            pass
        assert not stepped.step(), "a run that is over stays over"
    assert stepped.record.used == whole.record.used
    for name in set(whole.record.rows.dtype.names or ()) - TIMING:
        np.testing.assert_array_equal(stepped.record.rows[name], whole.record.rows[name], err_msg=name)
    assert stepped.elapsed_s is not None and stepped.elapsed_s > 0.0


def test_targets_are_followed_and_the_state_tells_of_it() -> None:
    with open_session("op3", source=library(), seed=2) as session:
        assert session.state.tick == -1 and np.isnan(session.state.q).all()
        assert session.advance(2.0)
        before = session.state
        assert (before.tick, before.ladder, before.target) == (249, State.STREAMING, 0)
        assert before.time_s == pytest.approx(249 / 125)
        assert before.torso[2] > 0.2 and np.isfinite(before.torque).all()
        target = session.send(Clip("wave"))
        session.advance(0.5)
        assert session.state.target == target.id == 1
        np.testing.assert_array_equal(before.q, session.record.q[249], "a state keeps its values")
        session.finish()
    assert session.state.ladder is State.OFF
    assert outcome(session).report.safety.faults == []


def test_an_emergency_stop_freezes_at_the_next_tick() -> None:
    with open_session("op3", source=library()) as session:
        session.advance(2.0)
        session.ask(Request.ESTOP)
        session.step()
        assert session.state.ladder is State.HOLD
        frozen = session.state.q_cmd
        session.advance(0.1)
        np.testing.assert_array_equal(session.state.q_cmd, frozen)


def test_a_source_that_follows_no_targets_refuses_them() -> None:
    with (
        open_session("op3", source=ClipSource(STEPS)) as session,
        pytest.raises(ConfigError, match=r"follows no targets but a stand; a model or a clip library does"),
    ):
        session.send(Clip("wave"))


@pytest.mark.parametrize("rest", [Stop(), Text("stop")])
@pytest.mark.parametrize("source", [lambda: ClipSource(STEPS), library])
def test_a_source_that_knows_no_stand_comes_to_one_all_the_same(source: Callable[[], Source], rest: Intent) -> None:
    """A hold and "stop" were refused by a run that plays a clip, and the robot walked on."""
    with open_session("op3", source=source(), stay=True) as session:
        session.advance(2.5)
        assert session.state.ladder is State.STREAMING
        session.send(rest)
        session.advance(2.5)
        (heard,) = session.heard
        assert (heard.state, heard.heard_as) == ("accepted", "stand")
        assert heard.notes == (() if isinstance(session.source, ClipLibrary) else (f"{session.source.name} is over",))
        assert session.state.ladder is State.HOLD and not session.telemetry.ticks.latest()["must_stop"]
        session.advance(1.0)
        assert session.state.ladder is State.HOLD, "the clip does not go on"
        if isinstance(session.source, ClipLibrary):
            session.send(Clip("wave"))
            session.advance(0.5)
            assert session.state.ladder is State.STREAMING
    assert not session.record.violations_sent


@pytest.mark.parametrize("source", [lambda: ClipSource(STEPS), library])
def test_a_stop_beside_another_request_is_not_refused_with_it(source: Callable[[], Source]) -> None:
    """Went wrong: runs that play a clip refused "stop and wave", one of a single clip by an error: they walked on."""
    with open_session("op3", source=source(), stay=True) as session:
        session.advance(2.5)
        session.send(Text("stop and wave"))
        session.advance(2.5)
        (heard,) = session.heard
        assert (heard.state, heard.heard_as, heard.dropped) == ("partly", "stand", ("wave",))
        assert session.state.ladder is State.HOLD


@pytest.mark.parametrize("rest", [Stop(), Velocity(0.0, 0.0, 0.0), Text("stop")])
@pytest.mark.parametrize("source", [lambda: ClipSource(STEPS), library])
def test_a_stand_that_is_asked_for_again_is_not_put_off(source: Callable[[], Source], rest: Intent) -> None:
    """Went wrong: each velocity of zero of a stick at rest made a new stop plan, and the robot never came to HOLD."""
    with open_session("op3", source=source(), stay=True) as session:
        session.advance(2.5)
        for _ in range(26):
            session.send(rest)
            session.advance(0.1)
        assert session.state.ladder is State.HOLD
        again = [heard for heard in session.heard if heard.reason == "goes on as before"]
        assert len(session.heard) >= 25 and len(again) >= len(session.heard) - 2
        assert {(heard.state, heard.heard_as) for heard in session.heard} == {("accepted", "stand")}
        if isinstance(session.source, ClipLibrary):
            session.send(Clip("wave"))
            session.advance(0.5)
            assert session.state.ladder is State.STREAMING
            session.send(rest)
            session.advance(2.5)
            assert session.state.ladder is State.HOLD and session.heard[-1].reason is None


def test_a_run_of_one_clip_is_over_once_the_robot_was_told_to_stand() -> None:
    """Its clip does not go on, so nothing could end it before its time limit, which is a fault."""
    with open_session("op3", source=ClipSource(STEPS), stay=False) as session:
        session.advance(2.0)
        session.send(Stop())
        while session.step():
            assert session.state.time_s < 10.0
    assert session.state.ladder is State.OFF and outcome(session).report.safety.faults == []


@pytest.mark.parametrize(
    ("items", "expected"),
    [
        ([], "script: has no items"),
        ([Item(1.0, Text("walk"))], "script, item 1: a script starts with something to do at: 0"),
        ([Item(0.0, Text("walk")), Item(0.0, Stop())], "script, item 2: at: 0 does not come after 0"),
        ([Item(0.0, Text("walk")), Item(1.0, Clip("a.bvh"))], "script, item 2: clip after text"),
    ],
)
def test_items_that_are_no_script_are_refused(items: list[Item], expected: str) -> None:
    with pytest.raises(ConfigError, match=expected):
        open_session("op3", source=items)


def test_stepping_needs_the_context_and_leaves_the_torque_off() -> None:
    session = open_session("op3", source=library())
    with pytest.raises(SessionError, match=r"has not begun\): steps are taken within its context"):
        session.step()
    with pytest.raises(KeyError, match="of the program"), session:
        session.advance(2.0)
        raise KeyError("of the program")
    with pytest.raises(SessionError, match=r"has ended\): steps are taken within its context"):
        session.step()
    with pytest.raises(SessionError, match=r"has ended\): nothing acts on it any more"):
        session.send(Clip("wave"))
    with pytest.raises(SessionError, match=r"has ended\): nothing acts on it any more"):
        session.ask(Request.STOP)


def test_a_run_that_is_over_takes_nothing_more() -> None:
    """Regression: after `finish`, within the context, a target and a request were accepted and vanished."""
    with open_session("op3", source=library()) as session:
        session.advance(0.5)
        record = session.finish()
        with pytest.raises(SessionError, match="the run of op3 is over: nothing acts on it any more"):
            session.send(Clip("wave"))
        with pytest.raises(SessionError, match="the run of op3 is over: nothing acts on it any more"):
            session.ask(Request.STOP)
        assert session.finish() is record, "to finish twice does no harm"


def test_in_processes_a_program_reads_the_state_and_sends_targets() -> None:
    session: Session = open_session("op3", source=library(), clock="real", realtime=False, stay=True)
    sent: list[int] = []

    def operate() -> Request | None:
        if session.state.ladder is not State.STREAMING:
            return None
        if not sent:
            sent.append(session.send(Clip("wave")).id)
        return Request.END if session.state.target == sent[0] else None

    session.next_request = operate
    with virtual_time():
        record = session.run()
    assert sent == [1] and record.rows["target"].max() == 1
    assert record.state[-1] == State.OFF


def test_a_session_is_run_once() -> None:
    """Regression: a second run read the first one's END and its rows again, and torque never went on."""
    session = open_session("op3", source=library())
    with session:
        session.step()
        with pytest.raises(SessionError, match=r"is running\): a session is run once"):
            session.run()
        with pytest.raises(SessionError, match=r"is running\): a session is run once"), session:
            pass
        assert session.step(), "the run that was going on goes on"
    with pytest.raises(SessionError, match=r"has ended\): a session is run once"):
        session.run()


def test_the_outcome_is_known_after_the_end(tmp_path: Path) -> None:
    """Regression: asked for within the run, it closed the log, and the next tick failed."""
    with open_session("op3", source=library(), log=tmp_path / "run.mcap") as session:
        session.advance(0.5)
        with pytest.raises(SessionError, match="its outcome is known once it has ended"):
            outcome(session)
        session.finish()
    assert outcome(session).report.log == str(tmp_path / "run.mcap")


def test_after_a_stop_the_robot_stands_and_follows_the_next_target() -> None:
    """Regression: the run parked and ended, and a later target was accepted and did nothing."""
    with open_session("op3", source=library()) as session:
        session.advance(3.0)
        session.send(Stop())
        session.advance(6.0)
        assert session.state.ladder is State.HOLD
        target = session.send(Clip("wave"))
        session.advance(0.5)
        assert session.state.ladder is State.STREAMING and session.state.target == target.id
        session.finish()
    assert session.state.ladder is State.OFF


def test_what_is_asked_before_each_tick_may_read_the_state_of_the_first() -> None:
    """Regression: before the first tick `state` raised, and the run ended with that."""
    ticks: list[int] = []

    def operate() -> Request | None:
        ticks.append(session.state.tick)
        return Request.END if session.state.ladder is State.STREAMING else None

    session = open_session("op3", source=library(), next_request=operate)
    session.run()
    assert ticks[:2] == [-1, 0] and session.state.ladder is State.OFF


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"clock": "lock-step"}, "clock: 'lock-step', expected one of: real, lockstep"),
        ({"seconds": -1.0}, "seconds: -1.0, expected a positive number"),
        ({"source": "walk"}, "'walk': expected a motion, an intent"),
        ({"source": 3}, "3: expected a motion, an intent"),
        ({"source": Stop()}, "Stop: nothing is followed before it"),
    ],
)
def test_arguments_that_are_wrong_are_refused_at_once(options: dict[str, Any], expected: str) -> None:
    """Regression: a misspelt clock ran on the wall clock, words without Text ended in an AttributeError."""
    with pytest.raises(ConfigError, match=expected):
        open_session("op3", **({"source": ClipSource(STEPS)} | options))


def test_targets_and_requests_that_are_none_are_refused_before_they_reach_the_loop() -> None:
    with open_session("op3", source=library()) as session:
        with pytest.raises(ConfigError, match="target: 'walk', expected one of: Clip, .*Heading, Waypoint, Stop"):
            session.send("walk")  # type: ignore[arg-type]
        with pytest.raises(ValueError, match="99 is not a valid Request"):
            session.ask(99)  # type: ignore[arg-type]
        for seconds in (0.0, math.nan, math.inf, "2", None):  # those after the first ended in a ValueError or TypeError
            with pytest.raises(ConfigError, match=f"seconds: {seconds!r}, expected at least a tick"):
                session.advance(seconds)  # type: ignore[arg-type]


def test_the_real_clock_is_not_stepped() -> None:
    session = open_session("op3", source=library(), clock="real")
    with pytest.raises(ConfigError, match="clock 'real' passes by itself; call run"), session:
        pass
