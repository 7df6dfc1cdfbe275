"""Requests to single servos over the DYNAMIXEL SDK, on emulated servos and a simulated clock."""

from __future__ import annotations

import pytest

from flexmotion.configs.robot import Robot
from flexmotion.drivers.dynamixel.registers import table_of
from flexmotion.drivers.dynamixel.sdk import LATENCY_S, Client
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.faults import Fault
from flexmotion.drivers.emulator.loopback import Loopback

KNEE = 14


@pytest.mark.parametrize("late_s", [LATENCY_S + 0.005, 1.8 * LATENCY_S])
def test_late_answers_are_not_taken_for_those_of_the_next_request(op3: Robot, late_s: float) -> None:
    """Regression: on a busy host a late answer to a ping was taken for the control table, and the servo refused."""
    world = Loopback(BenchBody(op3), faults=[Fault.parse(f"late:{late_s}")])
    client, table = Client(world.open_port("main", op3.config.buses["main"].baud)), table_of("XM430-W350")
    world.advance(0.05)  # the fault acts
    assert client.ping(KNEE) == 1020
    memory = client.read_block(KNEE, 0, 100)
    assert len(memory) == 100 and memory[table["protocol_type"].address] == 2
    for name in ("min_position_limit", "max_position_limit", "position_p_gain", "min_position_limit"):
        register = table[name]
        assert client.read(KNEE, register) == register.unpack(memory[register.address : register.end]), name
