"""A planner that dies while the robot mirrors a person; in processes, on virtual time."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from typing import Any

from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.motion.person_channel import FPS, PersonChannel, PersonPose

Live = Callable[..., Any]
Send = Callable[..., Any]

KILLED_S, AGAIN_S, END_S = 2.0, 6.0, 7.5


def test_a_planner_that_dies_while_mirroring_leaves_a_stand_until_the_robot_is_told_to_go_on(
    live: Live, send: Send
) -> None:
    motion, source = choose_motion(), MirrorSource(PersonChannel())

    def shown(number: int) -> Callable[[Any], None]:
        def act(_session: Any) -> None:
            frame, now = number % (len(motion) - 1), time.perf_counter()
            source.channel.publish(PersonPose(1, round(now * FPS) / FPS, now, motion[frame : frame + 1]))

        return act

    def go_on(session: Any) -> None:
        session.send(Text("mirror"))

    kill, again = (KILLED_S, send(signal.SIGKILL, "fm-planner")), (AGAIN_S, go_on)
    acts = [*((number / FPS, shown(number)) for number in range(round(END_S * FPS))), kill, again]
    run = live(acts, source=source, end_s=2.0)
    assert run.upright and run.record.violations_sent == 0
    # First nobody is seen; then the person, the stop of the plan, and the person again when it is said.
    expected = [State.STREAMING, State.HOLD, State.STREAMING, State.HOLD, State.PARK, State.OFF]
    assert run.states[-6:] == expected
    assert any("it is started again" in message for message in run.messages("fault"))
    # While the person is still seen the robot stands, from the plan's own stop to the word.
    order = sorted(acts, key=lambda act: act[0])
    killed, told = order.index(kill), order.index(again)
    assert run.seconds_until(State.HOLD, killed) < AGAIN_S - KILLED_S
    assert run.ticks_until(State.STREAMING, told) < run.record.rate_hz
