"""Loses chosen packets of a host on their way to emulated servos."""

from __future__ import annotations

from collections.abc import Callable

from flexmotion.drivers.port import SerialPort


def lose(port: SerialPort, chosen: Callable[[bytes], bool], many: int = 1) -> list[bytes]:
    """Lose the next `many` chosen packets that the port sends; what was lost, filled as it happens.

    They take their time on the wire and reach no servo.
    """
    send, lost = port.send, list[bytes]()

    def sends(data: bytes) -> None:
        if len(lost) < many and chosen(data):
            lost.append(data)
            port._count(data)
        else:
            send(data)

    port.send = sends  # type: ignore[method-assign]
    return lost
