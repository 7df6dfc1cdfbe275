"""A session stepped by a program, and its state."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.api import open_session, outcome
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.clip_library import ClipLibrary
from flexmotion.streamer.motion.intents import Clip, Stop, Text
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.sources import ClipSource
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
        with pytest.raises(LookupError, match="no tick yet"):
            _ = session.state
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
        pytest.raises(ConfigError, match=r"follows no targets; a model or a clip library does"),
    ):
        session.send(Clip("wave"))


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
    with pytest.raises(RuntimeError, match="within its context"):
        session.step()
    with pytest.raises(KeyError, match="of the program"), session:
        session.advance(2.0)
        raise KeyError("of the program")
    with pytest.raises(RuntimeError, match="within its context"):
        session.step()


def test_in_processes_a_program_reads_the_state_and_sends_targets() -> None:
    session: Session = open_session("op3", source=library(), clock="real", realtime=False, stay=True)
    sent: list[int] = []

    def operate() -> Request | None:
        if not session.telemetry.ticks.count or session.state.ladder is not State.STREAMING:
            return None
        if not sent:
            sent.append(session.send(Clip("wave")).id)
        return Request.END if session.state.target == sent[0] else None

    session.next_request = operate
    with virtual_time():
        record = session.run()
    assert sent == [1] and record.rows["target"].max() == 1
    assert record.state[-1] == State.OFF
