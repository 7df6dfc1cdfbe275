"""`metrics_text`: the run in the text format of Prometheus, for `GET /metrics`."""

from __future__ import annotations

import math
from collections.abc import Iterator

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    InfoMetricFamily,
    Metric,
    StateSetMetricFamily,
)
from prometheus_client.registry import Collector

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway.desk import Desk
from flexmotion.streamer.gateway.health import WORKS, Health

METRICS_TYPE = "text/plain; version=0.0.4; charset=utf-8"


class RunCollector(Collector):
    """The newest tick and the counts of the desk as metrics. Units as Prometheus has them: seconds, radians, volts.

    Args:
        desk: of the run.
        robot, driver: their names.
        joints: the robot's joints, in the order of the rows.
        health: of the ways to the run; None: it has none beside HTTP.
    """

    def __init__(
        self, desk: Desk, robot: str, driver: str, joints: tuple[str, ...], health: Health | None = None
    ) -> None:
        self.desk, self.robot, self.driver, self.joints = desk, robot, driver, joints
        self.health = health or Health()

    def collect(self) -> Iterator[Metric]:
        """See `Collector`."""
        yield InfoMetricFamily("flexmotion_run", "Robot and driver.", {"robot": self.robot, "driver": self.driver})
        yield from self._loop()
        yield from self._gateway()

    def _loop(self) -> Iterator[Metric]:
        row = self.desk.row()
        if row is None:
            return
        yield _counter("ticks", "Ticks of the control loop.", int(row.tick) + 1)
        yield _gauge("loop_stamp_seconds", "Monotonic time at which the newest tick began.", int(row.stamp_ns) * 1e-9)
        names = {state.name: state == int(row.state) for state in State}
        yield StateSetMetricFamily("flexmotion_ladder", "State of the safety ladder.", names)
        yield _gauge("must_stop", "1 while a stop is in force.", bool(row.must_stop))
        for name, text, value in (
            ("missed_deadlines", "Ticks that were not done when the next was due.", row.missed_deadlines),
            ("late_plans", "Plans that came too late to be played.", row.late_plans),
            ("underruns", "Times that a plan's own stop was played for lack of another.", row.underruns),
            ("violations", "Goals outside a servo's envelope that left the loop.", row.violations),
            ("steps", "Footsteps of the robot.", row.steps_planned),
        ):
            yield _counter(name, text, int(value))
        yield _gauge("loop_work_seconds", "Work of the newest tick.", float(row.work_s))
        yield _gauge("loop_lateness_seconds", "Lateness of its wake-up.", float(row.lateness_s))
        tilt = GaugeMetricFamily("flexmotion_tilt_radians", "Estimated tilt of the torso.", labels=["axis"])
        for axis, angle in zip(("roll", "pitch"), row.tilt, strict=True):
            _add(tilt, axis, float(angle))
        yield tilt
        for name, text, values in (
            ("servo_temperature_celsius", "Temperature of a servo.", row.temperature),
            ("servo_supply_volts", "Supply of a servo.", row.voltage),
            ("servo_stale_reads", "Reads of a servo in a row without a new value.", row.stale),
        ):
            family = GaugeMetricFamily(f"flexmotion_{name}", text, labels=["joint"])
            for joint, value in zip(self.joints, values, strict=True):
                _add(family, joint, float(value))
            yield family

    def _gateway(self) -> Iterator[Metric]:
        yield _gauge("operator", "1 while a source holds the lease.", self.desk.lease.holder is not None)
        counts = CounterMetricFamily("flexmotion_messages", "Messages by what became of them.", labels=["state"])
        for state, number in sorted(self.desk.counts.items()):
            counts.add_metric([state], number)
        yield counts
        ways = GaugeMetricFamily("flexmotion_way_works", "1 while targets or stops can come this way.", labels=["way"])
        for way, state in self.health.problems().items():
            _add(ways, way, float(state == WORKS))
        yield ways


def metrics_text(desk: Desk, robot: str, driver: str, joints: tuple[str, ...], health: Health | None = None) -> bytes:
    """All metrics of the run, now."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(RunCollector(desk, robot, driver, joints, health))
    return generate_latest(registry)


def _gauge(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(f"flexmotion_{name}", text, value=float(value))


def _counter(name: str, text: str, value: int) -> Metric:
    return CounterMetricFamily(f"flexmotion_{name}", text, value=value)


def _add(family: GaugeMetricFamily, label: str, value: float) -> None:
    """Add a sample, unless it is unknown."""
    if math.isfinite(value):
        family.add_metric([label], value)
