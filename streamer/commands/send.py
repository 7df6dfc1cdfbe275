"""`flexmotion send`, `status`, `stop`, `estop`, `clear`, `kill`: speak to a run that was started with --web."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexmotion.streamer.commands.exit_codes import CHECK_FAILED
from flexmotion.streamer.commands.options import JsonOption, TokenFileOption
from flexmotion.streamer.commands.output import print_json, print_result

if TYPE_CHECKING:
    from flexmotion.streamer.gateway.client import Client
    from flexmotion.streamer.gateway.messages import Answer

_VELOCITY_S = 5.0
"""A velocity that is sent once holds this long [s]; a stick's holds for half a second and is sent again."""

HostOption = Annotated[str, typer.Option("--host", help="Address of the run.")]
PortOption = Annotated[int, typer.Option("--port", min=1, max=65535, help="Its port for targets (--web-port).")]
StopPortOption = Annotated[int, typer.Option("--stop-port", min=1, max=65535, help="Its port for stops.")]
SourceOption = Annotated[
    str, typer.Option("--source", help="Name of this sender; the run's settings give it a priority.")
]


def _client(host: str, port: int, stop_port: int, source: str, token_file: Path | None) -> Client:
    from flexmotion.streamer.gateway.admission import find_token
    from flexmotion.streamer.gateway.client import Client

    return Client(host, port, stop_port=stop_port, source=source, token=find_token(token_file))


def _present(answer: Answer, as_json: bool) -> None:
    if as_json:
        print_json(answer.model_dump_json(exclude_none=True, indent=2))
    else:
        print_result(_line(answer))
    if answer.state not in ("accepted", "slowed"):
        raise typer.Exit(CHECK_FAILED)


def _line(answer: Answer) -> str:
    parts: list[str] = [answer.state]
    if answer.heard_as is not None:
        parts.append(f"heard as {answer.heard_as}")
    if answer.slowed is not None:
        parts.append(f"slowed to {answer.slowed}")
    if answer.dropped:
        parts.append(f"not done: {', '.join(answer.dropped)}")
    parts += answer.notes or ()
    if answer.tick is not None:
        parts.append(f"from tick {answer.tick}")
    if answer.took_lease_from is not None:
        parts.append(f"took over from {answer.took_lease_from}")
    if answer.reason is not None:
        parts.append(answer.reason)
    return ", ".join(parts)


def send(
    text: Annotated[str | None, typer.Argument(help='What to do, in words: "wave".', show_default=False)] = None,
    velocity: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            "--velocity", metavar="VX VY WZ", help="Forward, left [m/s], turning left [rad/s].", show_default=False
        ),
    ] = None,
    clip: Annotated[str | None, typer.Option("--clip", help="A clip of the run's library.", show_default=False)] = None,
    hold: Annotated[bool, typer.Option("--hold", help="Come to a stand.")] = False,
    seconds: Annotated[
        float | None,
        typer.Option("--for", min=0.05, max=600.0, help="Come to a stand after this many seconds.", show_default=False),
    ] = None,
    take: Annotated[bool, typer.Option("--take", help="Take the lease over from another operator first.")] = False,
    host: HostOption = "127.0.0.1",
    port: PortOption = 8790,
    source: SourceOption = "command line",
    token_file: TokenFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """Send a target to a run and print what it heard; exit code 1 where the target is not followed.

    A velocity holds for 5 s, or for --for; words hold until the next target.

    [bold]Examples[/bold]

      flexmotion send "wave with the right hand"

      flexmotion send --velocity .3 0 0 --for 4
    """
    given = {"TEXT": text, "--velocity": velocity, "--clip": clip, "--hold": hold or None}
    chosen = [name for name, value in given.items() if value is not None]
    if len(chosen) != 1:
        raise typer.BadParameter(f"expected one of {', '.join(given)}; found {' and '.join(chosen) or 'none'}")
    message: dict[str, Any]
    if text is not None:
        message = {"type": "text", "text": text}
    elif velocity is not None:
        message, seconds = {"type": "velocity", "velocity": list(velocity)}, seconds or _VELOCITY_S
    else:
        message = {"type": "hold"} if clip is None else {"type": "clip", "clip": clip}
    with _client(host, port, port, source, token_file) as client:
        if take:
            client.take()
        answer = client.ask({**message, "ttl_s": seconds})
    _present(answer, as_json)


def status(
    host: HostOption = "127.0.0.1",
    port: PortOption = 8790,
    token_file: TokenFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print what a run does.

    [bold]Examples[/bold]

      flexmotion status --json
    """
    found = _client(host, port, port, "command line", token_file).status()
    if as_json:
        print_json(json.dumps(found, indent=2))
        return
    print_result("\n".join(f"{name:18}{_value(value)}" for name, value in found.items() if name not in _HIDDEN))


_HIDDEN = ("type", "version")


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_value(one)}" for key, one in value.items() if one is not None)
    return "unknown" if value is None else str(value)


def stop(
    host: HostOption = "127.0.0.1",
    stop_port: StopPortOption = 8791,
    token_file: TokenFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """Bring the robot to a balanced stand; it refuses targets until `flexmotion clear`. Needs no token.

    [bold]Examples[/bold]

      flexmotion stop
    """
    _press("stop", host, stop_port, token_file, as_json)


def estop(
    host: HostOption = "127.0.0.1",
    stop_port: StopPortOption = 8791,
    token_file: TokenFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """Freeze the robot, then park it; the fault is latched and the run ends. It is no safety function.

    [bold]Examples[/bold]

      flexmotion estop
    """
    _press("estop", host, stop_port, token_file, as_json)


def _press(what: str, host: str, stop_port: int, token_file: Path | None, as_json: bool) -> None:
    client = _client(host, stop_port, stop_port, "command line", token_file)
    answer = client.stop() if what == "stop" else client.estop()
    if as_json:
        print_json(answer.model_dump_json(exclude_none=True, indent=2))
    else:
        print_result(
            answer.state + (f" before tick {answer.tick}" if answer.tick is not None else f": {answer.reason}")
        )
    if answer.state != "accepted":
        raise typer.Exit(CHECK_FAILED)


def clear(
    host: HostOption = "127.0.0.1",
    port: PortOption = 8790,
    source: SourceOption = "command line",
    token_file: TokenFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """Release a STOP once the robot stands; it stands on until a new target arrives.

    [bold]Examples[/bold]

      flexmotion clear
    """
    with _client(host, port, port, source, token_file) as client:
        answer = client.clear()
    _present(answer, as_json)


def kill(
    confirm: Annotated[bool, typer.Option("--the-robot-will-fall", help="Confirms that nobody is in its way.")] = False,
    host: HostOption = "127.0.0.1",
    port: PortOption = 8790,
    source: SourceOption = "command line",
    token_file: TokenFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """Switch the torque off at once: the robot falls.

    [bold]Examples[/bold]

      flexmotion kill --the-robot-will-fall
    """
    if not confirm:
        raise typer.BadParameter("the robot will fall: confirm it by --the-robot-will-fall, or use `flexmotion stop`")
    with _client(host, port, port, source, token_file) as client:
        answer = client.kill()
    _present(answer, as_json)
