"""`cycle_budget`: bytes and time of a read and a write of all servos of a bus, calculated."""

from __future__ import annotations

from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.servo_bus import Budget
from flexmotion.drivers.dynamixel.exchange import Exchange, ReadMany, ReadOne
from flexmotion.drivers.dynamixel.goals import sync_write
from flexmotion.drivers.dynamixel.layout import Span, layout_of
from flexmotion.drivers.dynamixel.opencr import board_of
from flexmotion.drivers.dynamixel.registers import table_of
from flexmotion.drivers.port import BITS_A_BYTE


def cycle_budget(robot: Robot, name: str) -> Budget:
    """The budget of the bus `name`. Servos that support fast sync reads are assumed to answer them."""
    config = robot.config.buses[name]
    delay = config.return_delay_us * 1e-6
    tables: dict[tuple[Span, bool], list[int]] = {}
    writes: dict[Span, int] = {}
    for joint, servo in zip(robot.joints, robot.servos, strict=True):
        if joint.bus == name:
            table = table_of(servo.name)
            layout = layout_of(table, current_bound=config.current_bound)
            fast = table.fast_sync_read_firmware is not None
            tables.setdefault((layout.read, fast), []).append(joint.id)
            writes[layout.write] = writes.get(layout.write, 0) + 1
    reads: list[Exchange] = [ReadMany(ids, span, fast=fast, where=name) for (span, fast), ids in tables.items()]
    board = board_of(robot, name)
    if board is not None:
        reads.append(ReadOne(board.id, board.span))
    byte_s = BITS_A_BYTE / config.baud
    write_bytes = sum(len(sync_write(span, bytes((span.size + 1) * many))) for span, many in writes.items())
    read_bytes = sum(sum(exchange.sizes) for exchange in reads)
    delays = sum(exchange.delays for exchange in reads) * delay
    asked_s = reads[0].sizes[0] * byte_s
    return Budget(read_bytes, write_bytes, read_bytes * byte_s + delays, write_bytes * byte_s, asked_s)
