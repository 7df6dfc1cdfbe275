"""Options that say which run a command speaks to, and as whom."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from flexmotion.streamer.commands.options import JsonOption, TokenFileOption

if TYPE_CHECKING:
    from flexmotion.streamer.gateway.client import Client

HostOption = Annotated[str, typer.Option("--host", help="Address of the run.")]
PortOption = Annotated[int, typer.Option("--port", min=1, max=65535, help="Its port for targets (--web-port).")]
StopPortOption = Annotated[
    int | None,
    typer.Option(
        "--stop-port",
        min=1,
        max=65535,
        help="Its port for stops (--stop-port of the run); with another --port the run is asked for it.",
        show_default="8791",
    ),
]
SourceOption = Annotated[
    str, typer.Option("--source", help="Name of this sender; the run's settings give it a priority.")
]
ZenohEndpointOption = Annotated[
    list[str] | None,
    typer.Option(
        "--zenoh",
        metavar="ENDPOINT",
        help="Over zenoh instead: of a router or of the run, such as tcp/192.168.0.10:7447 (repeatable).",
        show_default=False,
    ),
]
RobotNameOption = Annotated[
    str, typer.Option("--name", metavar="NAME", help="With --zenoh: name of the robot (--name of the run).")
]


@dataclass(frozen=True)
class Address:
    """Where the run is that a command speaks to, and the name that the command gives itself."""

    host: HostOption = "127.0.0.1"
    port: PortOption = 8790
    stop_port: StopPortOption = None
    source: SourceOption = "command line"
    token_file: TokenFileOption = None

    def token(self) -> str | None:
        """The run's token. Raises `ConfigError` where it cannot be read."""
        from flexmotion.streamer.gateway.admission import find_token

        return find_token(self.token_file)

    def client(self) -> Client:
        """A connection to the run. Raises `ConfigError` where the token cannot be read."""
        from flexmotion.streamer.gateway.client import Client

        return Client(self.host, self.port, stop_port=self.stop_port, source=self.source, token=self.token())


@dataclass(frozen=True)
class KeyboardAddress(Address):
    """The run that is steered by keys."""

    source: SourceOption = "keyboard"


@dataclass(frozen=True)
class RunAddress(Address):
    """The run that takes a command's message or stop, over the network or zenoh."""

    zenoh: ZenohEndpointOption = None
    name: RobotNameOption = "op3"
    as_json: JsonOption = False

    def client(self) -> Client:
        """See `Address.client`."""
        return _over_zenoh(self.zenoh, self.name, self.source, self.token()) if self.zenoh else super().client()


def _over_zenoh(endpoints: list[str], robot: str, source: str, token: str | None) -> Client:
    from flexmotion.streamer.gateway.transports.zenoh_client import ZenohClient

    return ZenohClient(*endpoints, robot=robot, source=source, token=token)
