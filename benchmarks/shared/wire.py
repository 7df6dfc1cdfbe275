"""A wire that loses, delays and reorders datagrams, and a run that mirrors what comes over it, in lockstep."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from flexmotion.configs.stream import StreamSettings
from flexmotion.streamer import api
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.mirror.intake import Intake
from flexmotion.streamer.run.session import Session

SENDER = ("127.0.0.1", 50000)

Arrivals = list[tuple[float, bytes]]


def over_the_wire(
    frames: Sequence[tuple[float, bytes]], *, begin_s: float, lost: float, jitter_s: float, seed: int
) -> Arrivals:
    """Datagrams with their times of arrival [s], in that order.

    Args:
        frames: times on the sender's clock [s], and datagrams.
        begin_s: when the first one is sent.
        lost: share that does not arrive.
        jitter_s: mean of the exponentially distributed delay [s]; delays longer than a frame reorder them.
        seed: of loss and delay.
    """
    random = np.random.default_rng(seed)
    arrive = [
        (begin_s + time_s + random.exponential(jitter_s), datagram)
        for time_s, datagram in frames
        if random.random() >= lost
    ]
    return sorted(arrive, key=lambda one: one[0])


def mirrored(
    arrivals: Arrivals,
    seconds: float,
    *,
    robot: str = "op3",
    bundle: str | Path | None = None,
    foreseen: bool = True,
    seed: int = 0,
    settings: StreamSettings | None = None,
    log: Path | None = None,
    each_tick: Callable[[Session, Intake], None] = lambda _session, _intake: None,
) -> tuple[Session, Intake]:
    """A run of the simulated robot that mirrors what arrives, to its end; `seconds`: of the robot's time."""
    source = api.open_mirror(bundle, foreseen=foreseen)
    session = api.open_session(robot, source=source, settings=settings, seed=seed, log=log, stay=True)
    intake = Intake(Admission(), source.channel)
    waiting = list(arrivals)
    with session:
        tick = 0
        while tick < seconds * session.robot.rate_hz:
            now_s = tick / session.robot.rate_hz
            while waiting and waiting[0][0] <= now_s:
                intake.take(waiting.pop(0)[1], SENDER, now_s)
            each_tick(session, intake)
            if not session.step():
                break
            tick += 1
        session.finish()
    return session, intake
