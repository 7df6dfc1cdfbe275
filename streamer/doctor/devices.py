"""Serial adapters and input devices: their rights, and their latency timers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from flexmotion.streamer.doctor.finding import Finding, fine, problem, warning

SLOWEST_MS = 1
"""Latency timer of a USB serial adapter that keeps a bus cycle of 8 ms; an FTDI chip begins with 16 [ms]."""

Allowed = Callable[[Path], bool]


def usable(path: Path) -> bool:
    """Whether this user may read and write a device."""
    return os.access(path, os.R_OK | os.W_OK)


def serial_ports(root: Path, allowed: Allowed = usable) -> Iterator[Finding]:
    """The serial ports of servo buses: whether they can be opened, and how long their adapters keep bytes back."""
    ports = sorted([*root.glob("dev/ttyUSB*"), *root.glob("dev/ttyACM*")])
    if not ports:
        yield fine("serial ports", "none (no USB adapter is plugged in)")
    for port in ports:
        name = f"/dev/{port.name}"
        if not allowed(port):
            yield problem(name, "this user may not open it", "sudo usermod -aG dialout $USER  # then log in again")
            continue
        timer = root / f"sys/bus/usb-serial/devices/{port.name}/latency_timer"
        if not timer.exists():
            yield fine(name, "can be opened, its adapter has no latency timer")
            continue
        latency = int(timer.read_text(encoding="ascii"))
        if latency <= SLOWEST_MS:
            yield fine(name, f"can be opened, latency timer {latency} ms")
        else:
            yield warning(
                name,
                f"latency timer {latency} ms: answers of servos wait in the adapter (a run asks for 1 ms, "
                "where the kernel permits it)",
                f"echo {SLOWEST_MS} | sudo tee /sys/bus/usb-serial/devices/{port.name}/latency_timer",
            )


def input_devices(root: Path, allowed: Allowed = usable) -> Finding:
    """Gamepads and other input devices."""
    devices = sorted(root.glob("dev/input/event*"))
    if not devices:
        return fine("input devices", "none (no gamepad is plugged in)")
    refused = [device.name for device in devices if not allowed(device)]
    if not refused:
        return fine("input devices", f"{len(devices)}, all can be read")
    return warning(
        "input devices",
        f"{len(refused)} of {len(devices)} cannot be read: a gamepad would not steer",
        "sudo usermod -aG input $USER  # then log in again",
    )
