"""A robot that mirrors is told to stand, while the person goes on."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from benchmarks.shared.wire import SENDER
from flexmotion.streamer.api import open_mirror, open_session
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.mirror.clip_frames import clip_frames
from flexmotion.streamer.mirror.intake import Intake
from flexmotion.streamer.motion.intents import Intent, Stop, Text, Velocity
from flexmotion.streamer.motion.mirror_source import GOES_ON

from .mirror_frames import shipped

RATE = 125


@pytest.mark.parametrize("rest", [Stop(), Text("Please stand still."), Velocity(0.0, 0.0, 0.0)])
def test_a_robot_that_mirrors_comes_to_a_stand_and_stays_there_until_it_is_told_to_go_on(rest: Intent) -> None:
    """A hold, "stand still" and a zero velocity were refused ("... expected a stop"), and the robot moved on."""
    seen = [(4.0 * turn + at, datagram) for turn in range(2) for at, datagram in clip_frames(shipped(4.0))]
    source = open_mirror(foreseen=False)
    session = open_session("op3", source=source, stay=True)
    intake = Intake(Admission(), source.channel, on_note=lambda _: None)
    states = dict[float, State]()
    asked: list[tuple[float, Callable[[], object]]] = [
        (3.0, lambda: session.send(rest)),
        (5.5, lambda: session.send(Text("mirror"))),
    ]
    with session:
        for tick in range(round(7.0 * RATE)):
            while seen and seen[0][0] <= tick / RATE:
                intake.take(seen.pop(0)[1], SENDER, tick / RATE)
            while asked and asked[0][0] <= tick / RATE:
                asked.pop(0)[1]()
            session.step()
            states[tick / RATE] = session.state.ladder
        session.finish()
    stood, mirrored = session.heard
    assert (stood.state, stood.heard_as, stood.notes) == ("accepted", "stand", (GOES_ON,)) and stood.tick is not None
    assert mirrored.state == "accepted"
    assert states[3.0] is State.STREAMING and states[7.0 - 1 / RATE] is State.STREAMING
    assert {state for at, state in states.items() if 5.0 <= at < 5.5} == {State.HOLD}, "it went on by itself"
    assert session.record.violations_sent == 0
