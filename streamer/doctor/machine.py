"""What a realtime loop needs of the machine: scheduling, locked memory, processors, clocks.

Files are read below `root`, which tests set.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil

from flexmotion.drivers.realtime.priority import LOOP_PRIORITY, WAKE_LATENCY, WITNESS_PRIORITY
from flexmotion.streamer.doctor.finding import Finding, fine, problem, warning

LEAST_PROCESSORS = 2
"""The planner has a processor of its own."""
LEAST_MEMORY_MB, LEAST_DISK_MB = 1500.0, 2000.0
"""Available memory of a run with its model: 0.9 GB measured; space for an hour of log is 1.2 GB."""
_PROBE = "import os, sys; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(sys.argv[1])))"
_LIMITS = "/etc/security/limits.d/90-flexmotion.conf"
_FASTEST = "performance"
_CLOCKS = ("tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page")
"""Clock sources that are read without a system call or slow hardware."""


def scheduling() -> Finding:
    """Whether a process of this user gets SCHED_FIFO. A process of its own tries: this one must not keep it."""
    tried = subprocess.run([sys.executable, "-c", _PROBE, str(LOOP_PRIORITY)], capture_output=True, check=False)
    if tried.returncode == 0:
        return fine("realtime scheduling", f"SCHED_FIFO {LOOP_PRIORITY} is granted")
    user = _user()
    return problem(
        "realtime scheduling",
        "the system refuses SCHED_FIFO: the loop waits for other programs (late by 7 ms, p99)",
        f"echo '{user} - rtprio {WITNESS_PRIORITY}' | sudo tee -a {_LIMITS}  # then log in again",
    )


def locked_memory() -> Finding:
    """Whether the loop may lock its memory."""
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if soft == resource.RLIM_INFINITY or os.geteuid() == 0:
        return fine("locked memory", "unlimited")
    return warning(
        "locked memory",
        f"at most {soft / 1e6:.0f} MB: pages of the loop may be swapped out, which takes milliseconds",
        f"echo '{_user()} - memlock unlimited' | sudo tee -a {_LIMITS}  # then log in again",
    )


def processors() -> Finding:
    """Whether planner and loop have a processor each."""
    usable = len(os.sched_getaffinity(0))
    if usable >= LEAST_PROCESSORS:
        return fine("processors", f"{usable}")
    return problem(
        "processors", f"{usable}: planner and loop need one each, plans take 1.8 times as long on a shared one"
    )


def governor(root: Path) -> Finding:
    """Whether the processors run at full speed when the loop wakes."""
    files = sorted(root.glob("sys/devices/system/cpu/cpu[0-9]*/cpufreq/scaling_governor"))
    found = sorted({file.read_text(encoding="ascii").strip() for file in files})
    if not found:
        return fine("processor governor", "none, the speed is fixed or set by the host")
    if found == [_FASTEST]:
        return fine("processor governor", found[0])
    return warning(
        "processor governor",
        f"{', '.join(found)}: a processor that idles is slow when the loop wakes",
        f"echo {_FASTEST} | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",
    )


def wake_latency(root: Path) -> Finding:
    """Whether processors can be kept from sleeping."""
    file = root / WAKE_LATENCY.relative_to("/")
    subject = "sleep of processors"
    if not file.exists():
        return fine(subject, "the kernel has no setting for it")
    if os.access(file, os.W_OK):
        return fine(subject, "can be switched off during a run")
    return warning(
        subject,
        f"{WAKE_LATENCY} cannot be written: a sleeping processor wakes late",
        'echo \'KERNEL=="cpu_dma_latency", GROUP="dialout", MODE="0660"\' | '
        "sudo tee /etc/udev/rules.d/90-flexmotion.rules && sudo udevadm control --reload && sudo udevadm trigger",
    )


def realtime_share(root: Path) -> Finding:
    """Whether realtime processes are cut off within each second."""
    file = root / "proc/sys/kernel/sched_rt_runtime_us"
    subject = "time of realtime processes"
    if not file.exists():
        return fine(subject, "not limited")
    share = int(file.read_text(encoding="ascii"))
    if share < 0 or share >= 900_000:
        return fine(subject, "not limited" if share < 0 else f"{share / 1e4:.0f} % of each second")
    return warning(
        subject,
        f"{share / 1e4:.0f} % of each second: the loop is stopped for the rest of it when the planner is busy",
        "sudo sysctl -w kernel.sched_rt_runtime_us=950000",
    )


def memory() -> Finding:
    """Whether a run fits into the memory that is free."""
    available = psutil.virtual_memory().available * 1e-6
    if available >= LEAST_MEMORY_MB:
        return fine("memory", f"{available:.0f} MB available")
    return problem("memory", f"{available:.0f} MB available, a run with its model needs {LEAST_MEMORY_MB:.0f} MB")


def disk(folder: Path) -> Finding:
    """Whether there is space for a log."""
    free = psutil.disk_usage(str(folder)).free * 1e-6
    if free >= LEAST_DISK_MB:
        return fine("disk", f"{free:.0f} MB free in {folder}")
    return warning(
        "disk", f"{free:.0f} MB free in {folder}: a log takes 20 MB a minute, and ends where the disk is full"
    )


def clocks(root: Path) -> Iterator[Finding]:
    """The clock that the loop reads, and the wall clock that log and messages are stamped with."""
    file = root / "sys/devices/system/clocksource/clocksource0/current_clocksource"
    if file.exists():
        source = file.read_text(encoding="ascii").strip()
        if source in _CLOCKS:
            yield fine("clock of the loop", source)
        else:
            yield warning("clock of the loop", f"{source}: each reading takes microseconds; see `dmesg | grep -i tsc`")
    marks = ("run/systemd/timesync/synchronized", "run/chrony/chronyd.pid", "run/chronyd.pid", "run/ntpd.pid")
    if any((root / mark).exists() for mark in marks):
        yield fine("wall clock", "is kept by a time service")
    else:
        yield warning(
            "wall clock",
            "no time service: stamps in the log may be wrong, and messages with a stamp_s expire or are refused",
            "sudo timedatectl set-ntp true",
        )


def _user() -> str:
    return psutil.Process().username()
