"""`run_in_real_time`: a run on the real clock, in processes of its own."""

from __future__ import annotations

from functools import partial

from flexmotion.drivers.realtime.priority import awake
from flexmotion.drivers.simulated import lockstep
from flexmotion.streamer.control.run_trace import Collector
from flexmotion.streamer.planning.lead import Kind, MeasuredLead
from flexmotion.streamer.run.parts import RunParts
from flexmotion.streamer.run.requests import Request, RequestChannel
from flexmotion.streamer.run.supervisor import Supervisor

_AT_FIRST_S = {Kind.WHOLE: 0.05, Kind.PARTIAL: 0.02, Kind.STOP: 0.02}
"""Assumed time to make a plan, before any was made [s]."""


def run_in_real_time(run: RunParts) -> None:
    """Run to the end; fills the record, scheduling and memory.

    Raises:
        DriverError: the driver failed, or the loop's process died.
    """
    stepped = lockstep(run.driver)
    driver = run.driver if stepped is None else stepped.detached(realtime=run.realtime)
    settings, planner_requests = run.settings, RequestChannel()
    lead = MeasuredLead(run.robot.rate_hz, _AT_FIRST_S, settings.horizon_s - settings.replan_s)
    supervisor = Supervisor(
        run.control_loop(driver),
        run.replanner(lead, partial(planner_requests.send, Request.NOTE)),
        settings,
        (run.requests, planner_requests),
        seconds=run.seconds,
        stay=bool(run.stay),
        armed=run.armed,
        attended=run.attended,
        patient=run.patient,
        realtime=run.realtime,
        services=run.services,
        wake=run.wake,
        waits=run.waits,
    )

    def next_request() -> Request | None:
        run.answers.listen()
        return None if run.next_request is None else run.next_request()

    collector = Collector(run.telemetry, run.record)
    with awake(settings.wake_latency_us if run.realtime else None) as run.awake:
        run.scheduling = supervisor.run(collector, next_request, run.progress, run.on_event)
    run.memory_mb = supervisor.memory_mb
