"""A robot that mirrors a person: a planner that dies, and the time that plans take; in processes, on virtual time."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.motion.person_channel import FPS, PersonChannel, PersonPose

from ..virtual_time import Costs

Live = Callable[..., Any]
Send = Callable[..., Any]
Act = tuple[float, Callable[[Any], None]]

KILLED_S, AGAIN_S, END_S = 2.0, 6.0, 7.5
SAMPLING_S, CHECKPOINT_S = 0.014, 0.0003
"""Processor time of a prediction, and of a checkpoint: some 40 of them are the 12 ms of retargeting."""
P50_S, P95_S = 0.06, 0.07
"""From the pose to the first command; the fit of a frame, 6 ms, comes before, and 80 and 150 ms are asked."""


def seen(source: MirrorSource, seconds: float) -> list[Act]:
    """Acts that show a person who moves on the spot, 30 times a second."""
    motion = choose_motion()

    def shown(number: int) -> Callable[[Any], None]:
        def act(_session: Any) -> None:
            frame, now = number % (len(motion) - 1), time.perf_counter()
            source.channel.publish(PersonPose(1, round(now * FPS) / FPS, now, motion[frame : frame + 1]))

        return act

    return [(number / FPS, shown(number)) for number in range(round(seconds * FPS))]


def go_on(session: Any) -> None:
    """What an operator says after a stop."""
    session.send(Text("mirror"))


def test_a_planner_that_dies_while_mirroring_leaves_a_stand_until_the_robot_is_told_to_go_on(
    live: Live, send: Send
) -> None:
    source = MirrorSource(PersonChannel())
    kill, again = (KILLED_S, send(signal.SIGKILL, "fm-planner")), (AGAIN_S, go_on)
    acts = [*seen(source, END_S), kill, again]
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


def test_a_pose_becomes_commands_in_time_although_plans_take_time(live: Live) -> None:
    source = MirrorSource(PersonChannel())
    costs = Costs(plan_s=SAMPLING_S, checkpoint_s=CHECKPOINT_S)
    run = live(seen(source, 5.0), source=source, end_s=2.0, costs=costs)
    assert run.upright and run.record.underruns == 0
    waited = run.record.ticks.seen_to_command_s
    waited = waited[np.isfinite(waited)]
    assert len(waited) > 40
    assert np.percentile(waited, 50) <= P50_S and np.percentile(waited, 95) <= P95_S, np.percentile(waited, [50, 95])
