"""Third-party clients talk to the emulated bus over its pseudo-terminal.

The emulator runs in a thread on the real clock. Clients usually give up after milliseconds; here their timeouts are
long enough for a slow machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
import rustypot
from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, GroupSyncWrite, PacketHandler, PortHandler

from flexmotion.configs.robot import Robot
from flexmotion.drivers.emulator.emulator import Emulator

from ...waiting import wait_until

pytestmark = pytest.mark.wall_clock

IDS = list(range(1, 21))
GOAL, PRESENT = 116, 132
ANSWER_S = 10.0
"""Time that a client waits for an answer [s]."""


class PatientPort(PortHandler):  # type: ignore[misc]
    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802 - the SDK's name
        super().setPacketTimeout(packet_length)
        self.packet_timeout = 1e3 * ANSWER_S


@pytest.fixture
def port(emulated: Callable[..., Emulator], op3: Robot) -> Iterator[PortHandler]:
    handler = PatientPort(emulated().lines[0].terminal.path)
    handler.setBaudRate(op3.config.buses["main"].baud)
    yield handler
    handler.closePort()


def present(robot: Robot) -> dict[int, int]:
    ticks = robot.to_ticks(robot.stand_pose)
    return {joint.id: int(tick) for joint, tick in zip(robot.joints, ticks, strict=True)}


def test_the_sdk_pings_reads_and_writes(port: PortHandler, op3: Robot) -> None:
    handler = PacketHandler(2.0)
    model, result, error = handler.ping(port, 14)
    assert (model, result, error) == (1020, COMM_SUCCESS, 0)
    # The SDK collects answers to a broadcast for a fixed time.
    wait_until(lambda: sorted(handler.broadcastPing(port)[0]) == [*IDS, 200], "every device answers a broadcast ping")

    write = GroupSyncWrite(port, handler, GOAL, 4)
    for id_ in IDS:
        write.addParam(id_, list((2048 + id_).to_bytes(4, "little")))
    assert write.txPacket() == COMM_SUCCESS
    read = GroupSyncRead(port, handler, GOAL, 4)
    for id_ in IDS:
        read.addParam(id_)
    assert read.txRxPacket() == COMM_SUCCESS
    assert [read.getData(id_, GOAL, 4) for id_ in IDS] == [2048 + id_ for id_ in IDS]


@pytest.mark.parametrize("fast", [False, True])
def test_the_sdk_reads_all_servos_at_once(port: PortHandler, op3: Robot, fast: bool) -> None:
    read = GroupSyncRead(port, PacketHandler(2.0), PRESENT, 4)
    for id_ in IDS:
        read.addParam(id_)
    assert (read.fastSyncRead() if fast else read.txRxPacket()) == COMM_SUCCESS
    assert {id_: read.getData(id_, PRESENT, 4) for id_ in IDS} == present(op3)


def test_rustypot_pings_reads_and_writes(emulated: Callable[..., Emulator], op3: Robot) -> None:
    path, baud = emulated().lines[0].terminal.path, op3.config.buses["main"].baud
    client = rustypot.Xl430PyController(path, baud, 0.5)
    assert not client.ping(99)
    client.close()
    client = rustypot.Xl430PyController(path, baud, ANSWER_S)
    assert client.ping(14)
    assert client.sync_read_present_position(IDS) == [present(op3)[id_] for id_ in IDS]
    client.sync_write_goal_position(IDS, [2100] * 20)
    assert client.sync_read_goal_position(IDS) == [2100] * 20
    client.set_fast_sync_read(True)
    assert client.sync_read_present_position(IDS) == [present(op3)[id_] for id_ in IDS]
    client.close()
