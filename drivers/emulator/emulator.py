"""`Emulator`: the servo buses of a robot on pseudo-terminals, on the real clock."""

from __future__ import annotations

import math
import select
import time
from collections.abc import Sequence
from typing import Any

from flexmotion.configs.errors import ConfigError
from flexmotion.drivers.emulator.body import Body
from flexmotion.drivers.emulator.false_readings import FalseReadings
from flexmotion.drivers.emulator.faults import FALSE_OF_SERVO, OF_SERVO, Fault, FaultKind
from flexmotion.drivers.emulator.line import BusLine, Line

WATCH_S = 0.01
"""Period of updates of watchdogs and hardware errors [s]."""

SPARE_S = 0.0004
"""A physics step is delayed if bytes are due within this time, unless the step is late itself [s]."""

LOST_S = 0.1
"""Lateness of physics above which the lost time is skipped, not made up for [s]."""


class Emulator:
    """Runs in the caller's thread; sleeps whenever nothing is due.

    Args:
        body: the body that servos move.
        lines: its buses, and other devices with a port.
        faults: faults to inject.
        false_readings: what the devices report wrongly.

    Attributes:
        powered_at: time at which torque of a servo first went on [s]; NaN before.
        lateness_s: greatest lateness of physics since torque first went on [s].
        lost_s: time that physics skipped [s].
    """

    def __init__(
        self,
        body: Body,
        lines: Sequence[Line],
        faults: Sequence[Fault] = (),
        false_readings: FalseReadings | None = None,
    ) -> None:
        self.body, self.lines, self.faults = body, list(lines), list(faults)
        self.false_readings = FalseReadings() if false_readings is None else false_readings
        boards = {id_ for line in self.lines if isinstance(line, BusLine) for id_ in line.bus.imu_ids}
        for fault in self.faults:
            if fault.kind in OF_SERVO and not (fault.kind is FaultKind.DEAD and fault.argument in boards):
                self._owner(fault)
        self.powered_at = math.nan
        self.lateness_s = self.lost_s = 0.0
        self._stopping = False
        self._next_step = self._next_watch = math.nan
        self._elapsed = self._processor = math.nan
        self._acting: tuple[Fault, ...] = ()
        self._supply = body.plant.supply

    def __enter__(self) -> Emulator:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the ports. May be called twice."""
        for line in self.lines:
            line.terminal.close()

    def stop(self) -> None:
        """Make `run` return; may be called from a signal handler or another thread."""
        self._stopping = True

    def run(self, seconds: float = math.inf) -> None:
        """Run on the real clock until `stop`, or for `seconds`."""
        begin = time.perf_counter()
        processor = time.process_time()
        while not self._stopping and (now := time.perf_counter()) < begin + seconds:
            self._wait(self.poll(now) - time.perf_counter())
        self._elapsed = time.perf_counter() - begin
        self._processor = time.process_time() - processor

    def poll(self, now: float) -> float:
        """Do what is due at time `now` [s], at most one physics step; returns the time of the next call [s]."""
        for line in self.lines:
            line.deliver(now)
        due = min((line.due for line in self.lines), default=math.inf)
        if math.isnan(self._next_step):
            self._next_step = self._next_watch = now
        timestep = self.body.timestep
        free = due > now + SPARE_S or now > self._next_step + 2 * timestep
        if now >= self._next_step and free:
            self.body.step(timestep)
            self._next_step = self._on_time(self._next_step + timestep, now)
            if now >= self._next_watch:
                self._watch(now)
                self._next_watch = now + WATCH_S
        # A delayed step is due right after the bytes.
        return min(due, self._next_step if self._next_step > now or free else due)

    def report(self) -> dict[str, Any]:
        """Figures of the run, once `run` has returned."""
        told = {str(kind): count for kind, count in self.false_readings.told.items() if count}
        return self.body.report() | {
            "false_readings": told,
            "buses": {line.name: line.report(self._elapsed) for line in self.lines},
            "elapsed_s": round(self._elapsed, 3),
            "processor_share": round(self._processor / self._elapsed, 4),
            "lateness_ms": round(self.lateness_s * 1e3, 3),
            "lost_ms": round(self.lost_s * 1e3, 3),
        }

    # ---------------------------------------------------------------- inside

    def _wait(self, seconds: float) -> None:
        ports = {line.terminal.descriptor: line for line in self.lines if line.terminal.open}
        for descriptor in select.select(list(ports), (), (), max(seconds, 0.0))[0]:
            ports[descriptor].receive(time.perf_counter())

    def _on_time(self, next_step: float, now: float) -> float:
        late = now - next_step
        if not math.isnan(self.powered_at):
            self.lateness_s = max(self.lateness_s, late)
        if late > LOST_S:
            self.lost_s += late
            return now
        return next_step

    def _watch(self, now: float) -> None:
        if math.isnan(self.powered_at) and self.body.plant.enabled.any():
            self.powered_at = now
        self._act(now)
        for line in self.lines:
            line.watch(now)

    def _act(self, now: float) -> None:
        since = -1.0 if math.isnan(self.powered_at) else now - self.powered_at
        acting = tuple(fault for fault in self.faults if fault.active(since))
        if acting == self._acting:
            return
        begun = [fault for fault in acting if fault not in self._acting]
        over = [fault for fault in self._acting if fault not in acting]
        self._acting = acting
        plant = self.body.plant
        volts = [fault.argument for fault in acting if fault.kind is FaultKind.VOLTAGE]
        plant.set_supply(min(volts, default=self._supply))
        for fault in begun:
            if fault.kind is FaultKind.OVERHEAT:
                _, index = self._owner(fault)
                plant.temperature[index] = self.body.robot.servos[index].temperature_limit + 5
            elif fault.kind is FaultKind.RESET:
                self._owner(fault)[0].bus.reset(int(fault.argument), now)
            elif fault.kind is FaultKind.TRIPPED:
                self._owner(fault)[0].bus.trip(int(fault.argument))
        for fault in (*over, *begun):
            if fault.kind is FaultKind.BLOCKED:
                self.body.block(self._owner(fault)[1], fault in begun)
        joint_of = {fault: self._owner(fault)[1] for fault in acting if fault.kind in FALSE_OF_SERVO}
        self.false_readings.act(acting, joint_of)
        for line in self.lines:
            line.act(acting)

    def _owner(self, fault: Fault) -> tuple[BusLine, int]:
        """Line and joint of the servo that a fault names. Raises `ConfigError`."""
        for line in self.lines:
            if not isinstance(line, BusLine):
                continue
            joints = [joint.bus == line.name and joint.id == int(fault.argument) for joint in self.body.robot.joints]
            if any(joints):
                return line, joints.index(True)
        ids = sorted({joint.id for joint in self.body.robot.joints})
        raise ConfigError(f"fault {fault.kind}: no servo has id {fault.argument:g}, there are: {ids}")
