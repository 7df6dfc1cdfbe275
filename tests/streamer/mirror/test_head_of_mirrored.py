"""A mirrored person whose robot a stop has left with a low head."""

from __future__ import annotations

import numpy as np

from benchmarks.shared.wire import SENDER
from flexmotion.streamer.api import open_mirror, open_session
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.mirror.clip_frames import clip_frames
from flexmotion.streamer.mirror.intake import Intake
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.part_intents import HeadPlace
from flexmotion.streamer.run.requests import Request

from .mirror_frames import shipped

RATE = 125


def test_a_person_who_is_mirrored_again_after_a_stop_finds_the_robot_upright() -> None:
    """Steps are withheld while a stop has left the trunk bent; `mirror` ends that, as it ends the stop itself."""
    seen = [(8.0 + at, datagram) for at, datagram in clip_frames(shipped(4.0))]
    source = open_mirror(foreseen=False)
    session = open_session("op3", source=source, stay=True)
    intake = Intake(Admission(), source.channel, on_note=lambda _: None)
    asked = [
        (2.0, lambda: session.send(HeadPlace((0.05, 0.0, 0.37)), holds_s=np.inf)),
        (4.0, lambda: session.ask(Request.STOP)),
        (6.0, lambda: session.ask(Request.CLEAR)),
        (9.5, lambda: session.send(Text("mirror"))),
    ]
    heights = dict[float, float]()
    with session:
        for tick in range(round(12.1 * RATE)):
            while seen and seen[0][0] <= tick / RATE:
                intake.take(seen.pop(0)[1], SENDER, tick / RATE)
            while asked and asked[0][0] <= tick / RATE:
                asked.pop(0)[1]()
            session.step()
            ticks = session.record.ticks
            if len(ticks.tick) and session.state.ladder in (State.STREAMING, State.HOLD):
                heights[tick / RATE] = float(ticks.true_base[-1, 2])
    low = heights[9.0]
    assert low < heights[2.0] - 0.05  # a person who is seen, and not mirrored, raises nobody
    assert heights[12.0] > low + 0.05
