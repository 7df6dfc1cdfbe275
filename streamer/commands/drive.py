"""`flexmotion drive`: steer a run from a terminal."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from flexmotion.streamer.commands.option_groups import grouped
from flexmotion.streamer.commands.run_address import KeyboardAddress


@grouped
def drive(
    *,
    fastest: Annotated[
        tuple[float, float, float],
        typer.Option(
            "--fastest", metavar="VX VY WZ", help="Speed of a held key: ahead, aside \\[m/s], turning \\[rad/s]."
        ),
    ] = (0.3, 0.15, 0.5),
    run: KeyboardAddress,
) -> None:
    """Steer a run by keys, from this terminal or over ssh: it walks while a key is held, and space is STOP.

    [bold]Examples[/bold]

      flexmotion drive

      flexmotion drive --host robot.local --fastest .5 .2 .8
    """
    import asyncio

    from flexmotion.streamer.gateway.async_client import AsyncClient
    from flexmotion.streamer.gateway.keyboard import Keyboard, keys_at_once

    stops, terminal = run.client(), sys.stdin.fileno()
    with keys_at_once(terminal):
        keyboard = Keyboard(
            lambda: AsyncClient(run.host, run.port, source=run.source, token=stops.token), stops, fastest
        )
        asyncio.run(keyboard.run(terminal))
    typer.echo(err=True)
