"""`flexmotion doctor`: findings about made-up machines, and about this one."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from flexmotion.bundles.shipped import shipped_bundle
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.cli import execute
from flexmotion.streamer.doctor import devices, machine
from flexmotion.streamer.doctor.doctor import examine, model, network_port
from flexmotion.streamer.gateway.ports import any_free

Make = Callable[[str, str], None]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Function (path, content): a file of the made-up machine."""

    def write(path: str, content: str) -> None:
        file = tmp_path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(content)

    return write


def test_a_governor_that_saves_power_is_found(tmp_path: Path, make: Make) -> None:
    assert machine.governor(tmp_path).level == "ok"
    for number, name in enumerate(("performance", "powersave")):
        make(f"sys/devices/system/cpu/cpu{number}/cpufreq/scaling_governor", name + "\n")
    found = machine.governor(tmp_path)
    assert found.level == "warning" and "powersave" in found.found
    assert found.mend is not None and "scaling_governor" in found.mend
    make("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "performance\n")
    assert machine.governor(tmp_path).level == "ok"


def test_an_adapter_that_keeps_bytes_back_is_found(tmp_path: Path, make: Make) -> None:
    make("dev/ttyUSB0", "")
    make("sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "16\n")
    make("dev/ttyACM3", "")
    acm, usb = devices.serial_ports(tmp_path, lambda _path: True)
    assert (acm.subject, acm.level) == ("/dev/ttyACM3", "ok")
    assert usb.level == "warning" and "16 ms" in usb.found
    assert usb.mend == "echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB0/latency_timer"
    make("sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "1\n")
    assert [one.level for one in devices.serial_ports(tmp_path, lambda _path: True)] == ["ok", "ok"]


def test_a_port_without_rights_is_a_problem_and_an_input_device_a_warning(tmp_path: Path, make: Make) -> None:
    make("dev/ttyUSB0", "")
    make("dev/input/event2", "")
    (port,) = devices.serial_ports(tmp_path, lambda _path: False)
    assert port.level == "problem" and "dialout" in str(port.mend)
    pad = devices.input_devices(tmp_path, lambda _path: False)
    assert pad.level == "warning" and "usermod -aG input" in str(pad.mend)
    assert devices.input_devices(tmp_path, lambda _path: True).level == "ok"


def test_a_machine_without_adapters_is_fine(tmp_path: Path) -> None:
    assert [one.level for one in devices.serial_ports(tmp_path)] == ["ok"]
    assert devices.input_devices(tmp_path).level == "ok"


def test_clocks(tmp_path: Path, make: Make) -> None:
    make("sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n")
    loop, wall = machine.clocks(tmp_path)
    assert loop.level == wall.level == "warning" and wall.mend == "sudo timedatectl set-ntp true"
    make("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n")
    make("run/systemd/timesync/synchronized", "")
    assert [one.level for one in machine.clocks(tmp_path)] == ["ok", "ok"]


def test_realtime_time_that_is_limited_is_found(tmp_path: Path, make: Make) -> None:
    assert machine.realtime_share(tmp_path).level == "ok"
    make("proc/sys/kernel/sched_rt_runtime_us", "500000\n")
    assert machine.realtime_share(tmp_path).level == "warning"
    make("proc/sys/kernel/sched_rt_runtime_us", "-1\n")
    assert machine.realtime_share(tmp_path).level == "ok"


def test_processors_that_cannot_be_kept_awake_are_found(
    tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert machine.wake_latency(tmp_path).level == "ok"
    make("dev/cpu_dma_latency", "")
    monkeypatch.setattr(os, "access", lambda *_: False)
    found = machine.wake_latency(tmp_path)
    assert found.level == "warning" and "udev" in str(found.mend)


def test_scheduling_that_is_refused_is_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "_PROBE", "raise PermissionError")
    found = machine.scheduling()
    assert found.level == "problem" and "rtprio" in str(found.mend)
    monkeypatch.setattr(machine, "_PROBE", "pass")
    assert machine.scheduling().level == "ok"


def test_one_processor_is_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: {0})
    assert machine.processors().level == "problem"


def test_little_memory_and_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "LEAST_MEMORY_MB", float("inf"))
    monkeypatch.setattr(machine, "LEAST_DISK_MB", float("inf"))
    assert machine.memory().level == "problem" and machine.disk(tmp_path).level == "warning"


def test_a_port_in_use_is_named_with_its_process() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
        found = network_port("port for targets", port, "--web-port")
        assert found.level == "warning" and f"process {os.getpid()} uses it (" in found.found
        assert psutil.Process().cmdline()[0] in found.found
        # The advice was to kill that process: it may be a run, with a robot that stands.
        assert "kill" not in str(found.mend)
        option, other = str(found.mend).split()[3:5]
        assert option == "--web-port" and network_port("port", int(other), option).level == "ok"
    assert network_port("port for targets", port, "--web-port").level == "ok"


def test_a_damaged_model_is_a_problem(tmp_path: Path) -> None:
    found = model(tmp_path)
    assert found.level == "problem" and str(tmp_path) in found.found and found.mend is not None
    if shipped_bundle() is not None:
        assert model(None).level == "ok"


def test_every_problem_has_a_command_or_says_what_is_missing(tmp_path: Path) -> None:
    ports = Gateway(port=any_free(), stop_port=any_free())
    found = examine(ports, root=tmp_path)
    subjects = [one.subject for one in found.findings]
    assert len(set(subjects)) == len(subjects) > 10
    assert found.ok == all(one.level != "problem" for one in found.findings)
    assert all(one.mend is None for one in found.findings if one.level == "ok")


def test_the_command_prints_json_and_exits_by_the_problems(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(machine, "_PROBE", "raise PermissionError")
    assert execute(["doctor", "--json"]) == 1
    content = json.loads(capsys.readouterr().out)
    assert content["schema"] == "flexmotion.doctor/1" and content["ok"] is False
    assert content["findings"][0]["subject"] == "realtime scheduling"
    assert execute(["doctor"]) == 1
    assert "rtprio" in capsys.readouterr().out
