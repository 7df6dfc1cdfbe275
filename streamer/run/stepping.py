"""`stepped`: a run in lockstep, tick by tick in one process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial

from flexmotion.configs.errors import ConfigError, FlexMotionError
from flexmotion.drivers.simulated import lockstep
from flexmotion.streamer.control.run_trace import Collector
from flexmotion.streamer.planning.lead import FixedLead
from flexmotion.streamer.run.lifecycle import Lifecycle
from flexmotion.streamer.run.parts import RunParts
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.supervisor import requests_of


@contextmanager
def stepped(run: RunParts) -> Iterator[Callable[[], bool]]:
    """Open the driver; each call of the function runs one tick and returns whether the run goes on.

    Raises:
        ConfigError: the driver's time cannot be stepped.
        DriverError: the driver failed.
    """
    driver = lockstep(run.driver)
    if driver is None:
        raise ConfigError(f"driver {run.driver.name!r} runs on the real clock only: clock real")
    rate = run.robot.rate_hz
    lead = FixedLead(max(round(run.settings.commit_s * rate), 1))
    replanner = run.replanner(lead, partial(run.requests.send, Request.NOTE))
    collector = Collector(run.telemetry, run.record)
    followers = [service.follow() for service in run.services]
    with ExitStack() as ending, driver:
        for follow in followers:
            ending.callback(follow, True)
        loop = run.loop = run.control_loop(driver)
        lifecycle = Lifecycle(
            loop,
            run.settings,
            seconds=run.seconds,
            stay=bool(run.stay),
            armed=run.armed,
            attended=run.attended,
            patient=run.patient,
        )
        channels = [channel.reader() for channel in (*requests_of(run.services), run.requests)]

        def step() -> bool:
            if lifecycle.finished:
                return False
            request = None if run.next_request is None else run.next_request()
            if request is not None:
                lifecycle.request(request)
            for channel in channels:
                for sent, reason in channel.read():
                    lifecycle.request(sent, reason)
            lifecycle.step()
            if lifecycle.broken is None:
                try:
                    replanner.step(loop.tick_count)
                except (FlexMotionError, ArithmeticError, ValueError, LookupError) as error:
                    # The plan that plays ends in its own stop.
                    lifecycle.broken = f"{type(error).__name__}: {error}"
            loop.tick()
            driver.advance(1.0 / rate)
            for event in collector.collect():
                run.on_event(event)
            run.answers.listen()
            for follow in followers:
                follow(False)
            if run.progress is not None:
                run.progress(float(run.record.source_s[-1]))
            return not lifecycle.finished

        yield step
