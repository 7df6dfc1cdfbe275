"""A robot that mirrors a person who comes, walks out of the picture and comes back; in lockstep, over a bad wire."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from benchmarks.shared.wire import SENDER, over_the_wire
from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.api import open_mirror, open_session
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.log.judged import Subject
from flexmotion.streamer.log.reader import read_log
from flexmotion.streamer.log.replay import replay
from flexmotion.streamer.mirror.clip_frames import clip_frames
from flexmotion.streamer.mirror.intake import Intake
from flexmotion.streamer.mirror.mirroring import MirrorFrom
from flexmotion.streamer.motion.intents import Text, Velocity
from flexmotion.streamer.outcome import Outcome, outcome
from flexmotion.streamer.run.requests import Request

from .mirror_frames import shipped

COMES_S, BACK_S, STOP_S, AGAIN_S, END_S = 1.5, 7.5, 10.0, 13.0, 14.5
"""When the person comes, comes back, when the operator stops the robot and lets it go on, and the end [s]."""
SEEN_S = 4.0
RATE = 125


@dataclass(frozen=True)
class Mirrored:
    """A run, its log and its messages."""

    outcome: Outcome
    log: Path
    messages: list[str]
    answers: list[tuple[str, str | None]]
    intake: Intake

    def states(self, begin_s: float, end_s: float) -> set[State]:
        """States between two moments."""
        return {State(int(state)) for state in self.outcome.record.state[round(begin_s * RATE) : round(end_s * RATE)]}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Mirrored:
    log, messages = tmp_path_factory.mktemp("mirrored") / "run.mcap", []
    frames = clip_frames(shipped(SEEN_S))
    wire = {"lost": 0.05, "jitter_s": 0.01, "seed": 1}
    coming = over_the_wire(frames, begin_s=COMES_S, **wire)
    # Seen all the time from then on.
    coming += over_the_wire(
        [(turn * SEEN_S + at, datagram) for turn in range(2) for at, datagram in clip_frames(shipped(SEEN_S))],
        begin_s=BACK_S,
        **wire,
    )
    nonsense = [(COMES_S + 0.1 * n, datagram) for n, datagram in enumerate([b"{", b"\xff", b'{"joints": {}}'] * 5)]
    source = open_mirror(foreseen=False)
    session = open_session("op3", source=source, log=log, stay=True, on_event=lambda one: messages.append(one.message))
    intake = Intake(Admission(), source.channel, on_note=messages.append)
    waiting = sorted([*coming, *nonsense], key=lambda one: one[0])
    asked = [
        (COMES_S + 3.0, lambda: session.send(Velocity(0.2, 0.0, 0.0))),
        (STOP_S, lambda: session.ask(Request.STOP)),
        (STOP_S + 2.5, lambda: session.ask(Request.CLEAR)),
        (AGAIN_S, lambda: session.send(Text("mirror"))),
    ]
    with session:
        for tick in range(round(END_S * RATE)):
            while waiting and waiting[0][0] <= tick / RATE:
                intake.take(waiting.pop(0)[1], SENDER, tick / RATE)
            while asked and asked[0][0] <= tick / RATE:
                asked.pop(0)[1]()
            session.step()
        session.finish()
    answers = [(heard.state, heard.reason) for heard in session.heard]
    return Mirrored(outcome(session), log, messages, answers, intake)


def test_the_robot_stands_until_the_person_is_measured(run: Mirrored) -> None:
    assert run.states(COMES_S, COMES_S + 1.0) <= {State.READY, State.STREAMING, State.HOLD}
    followed = np.isfinite(run.outcome.record.source_s)
    assert not followed[: round((COMES_S + 1.0) * RATE)].any()
    assert followed[round((COMES_S + 2.2) * RATE) : round((COMES_S + SEEN_S) * RATE)].all()


def test_who_walks_out_of_the_picture_brings_the_robot_to_a_stand(run: Mirrored) -> None:
    assert run.states(BACK_S - 0.7, BACK_S) == {State.HOLD}


def test_who_comes_back_is_followed_again_at_once(run: Mirrored) -> None:
    # The body is known: poses of a stream that is begun again are there after some frames.
    assert run.states(BACK_S + 0.6, BACK_S + 2.4) == {State.STREAMING}


def test_a_stop_holds_until_the_robot_is_told_to_mirror(run: Mirrored) -> None:
    assert run.states(AGAIN_S - 0.3, AGAIN_S) == {State.HOLD}
    assert State.STREAMING in run.states(AGAIN_S + 0.3, END_S)


def test_other_targets_are_refused_by_name(run: Mirrored) -> None:
    (refused, reason), (accepted, _) = run.answers
    assert refused == "refused" and "velocity cannot be followed" in (reason or "")
    assert accepted == "accepted"


def test_nothing_unsafe_was_sent(run: Mirrored) -> None:
    report = run.outcome.report
    assert not report.motion.fell and report.limits.violations_sent == 0
    assert not report.safety.faults and report.safety.final_state == "OFF"


def test_the_operator_is_told_who_is_seen_and_what_is_no_frame(run: Mirrored) -> None:
    assert run.messages.count("mirror: frames (joints) from 127.0.0.1 port 50000") == 1
    assert sum("is measured" in message for message in run.messages) == 1
    assert run.intake.unreadable == 15
    assert sum("is no frame" in message for message in run.messages) == 3  # each kind once


def test_the_log_holds_the_poses_and_its_replay_is_equal(run: Mirrored) -> None:
    log = read_log(run.log)
    assert log.header.source_parts["kind"] == "mirror"
    assert len(log.persons) > 150 and set(log.persons["stream"]) == {1, 2}
    found = replay(log, Subject.of(log))
    assert found.agrees and found.differing == []


def test_a_session_receives_only_where_it_mirrors_and_on_the_real_clock() -> None:
    with pytest.raises(ConfigError, match="lockstep"):
        open_session("op3", source=open_mirror(foreseen=False), mirror=MirrorFrom())
    with pytest.raises(ConfigError, match="mirrors nobody"):
        open_session("op3", clock="real", mirror=MirrorFrom())
    with pytest.raises(ConfigError, match="token"):
        open_session("op3", source=open_mirror(foreseen=False), clock="real", mirror=MirrorFrom("0.0.0.0"))
