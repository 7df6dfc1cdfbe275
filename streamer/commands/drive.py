"""`flexmotion drive`: steer a run from a terminal."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from flexmotion.streamer.commands.options import TokenFileOption
from flexmotion.streamer.commands.run_address import HostOption, PortOption, SourceOption, StopPortOption


def drive(
    fastest: Annotated[
        tuple[float, float, float],
        typer.Option(
            "--fastest", metavar="VX VY WZ", help="Speed of a held key: ahead, aside \\[m/s], turning \\[rad/s]."
        ),
    ] = (0.3, 0.15, 0.5),
    host: HostOption = "127.0.0.1",
    port: PortOption = 8790,
    stop_port: StopPortOption = 8791,
    source: SourceOption = "keyboard",
    token_file: TokenFileOption = None,
) -> None:
    """Steer a run by keys, from this terminal or over ssh: it walks while a key is held, and space is STOP.

    [bold]Examples[/bold]

      flexmotion drive

      flexmotion drive --host robot.local --fastest .5 .2 .8
    """
    import asyncio

    from flexmotion.streamer.gateway.admission import find_token
    from flexmotion.streamer.gateway.async_client import AsyncClient
    from flexmotion.streamer.gateway.client import Client
    from flexmotion.streamer.gateway.keyboard import Keyboard, keys_at_once

    token, terminal = find_token(token_file), sys.stdin.fileno()
    with keys_at_once(terminal):
        keyboard = Keyboard(
            lambda: AsyncClient(host, port, source=source, token=token),
            Client(host, port, stop_port=stop_port, source=source, token=token),
            fastest,
        )
        asyncio.run(keyboard.run(terminal))
    typer.echo(err=True)
