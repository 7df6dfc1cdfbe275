"""`flexmotion daemon`: a systemd unit that runs a robot."""

from __future__ import annotations

import getpass
import shutil
import sys
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Annotated, Any

import typer

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.commands.output import print_note

UNIT = Path("/etc/systemd/system/flexmotion.service")
_LOGS = "%L/flexmotion"
"""The folder of `LogsDirectory=` in a unit."""
_NAME_OR_FOLDER = ("robot", "bundle")
"""Parameters of `flexmotion run` that are the name of what is shipped, or a folder."""


def daemon(
    options: Annotated[
        list[str], typer.Argument(metavar="-- RUN OPTIONS", help="Options of `flexmotion run`, after two dashes.")
    ],
    user: Annotated[
        str | None, typer.Option("--user", help="User that the daemon runs as.", show_default="you")
    ] = None,
    install: Annotated[
        bool, typer.Option("--install", help=f"Write it to {UNIT} (as root) instead of printing it.")
    ] = False,
) -> None:
    """Print a systemd unit that runs a robot as a daemon: `flexmotion run` with these options.

    It waits for a robot that is not there, takes targets of other programs (--web), and logs to /var/log/flexmotion.
    Torque goes on when an operator arms the robot (`flexmotion arm`). It is not started again after a fault.

    [bold]Examples[/bold]

      flexmotion daemon -- --robot op3 --driver dynamixel --port /dev/ttyUSB0

      sudo flexmotion daemon --user robot --install -- -r op3 -d dynamixel -p /dev/ttyUSB0
    """
    text = unit(options, user or getpass.getuser())
    if not install:
        typer.echo(text, nl=False)
        return
    UNIT.write_text(text, encoding="utf-8")
    print_note(f"written: {UNIT}; next: systemctl daemon-reload && systemctl enable --now {UNIT.stem}")


def unit(options: list[str], user: str) -> str:
    """The unit.

    Args:
        options: of `flexmotion run`; what a daemon needs is added where it is missing.
        user: that the daemon runs as.

    Raises:
        typer.BadParameter: `flexmotion run` does not take the options.
        ConfigError: there is no such robot or driver.
    """
    from flexmotion.configs.robot import load_robot
    from flexmotion.drivers import registry

    command, read = _read(options)
    load_robot(read["robot"])
    if read["driver"] not in registry.names():
        raise ConfigError(f"unknown driver {read['driver']!r}, expected one of: {', '.join(registry.names())}")
    options = _absolute(options, command, read)
    given = {option.partition("=")[0] for option in options}
    whole = [*options]
    # In the life of a daemon something is refused now and then; that is told at once, and is no failure of its service.
    whole += [option for option in ("--web", "--wait", "--allow-refused") if option not in given]
    if given.isdisjoint(("--arm", "--no-arm")):
        whole.append("--no-arm")  # a motion that is given would else begin when somebody powers the robot
    words = [*map(_quoted, [*_program(), "run", *whole])]
    if read["log"] is not None and Path(read["log"]).suffix == ".mcap":
        raise typer.BadParameter(
            f"--log: {read['log']}: expected a folder: a daemon's second start would find a log there"
        )
    if given.isdisjoint(("--log", "--report")):
        words += ["--log", _LOGS]
    template = Template((files("flexmotion.streamer.commands") / "flexmotion.service").read_text(encoding="utf-8"))
    return template.substitute(command=" ".join(words), user=user, robot=read["robot"])


def _program() -> list[str]:
    """The installed program, by its absolute path: a unit has no PATH of a shell."""
    found = shutil.which("flexmotion")
    return [str(Path(found).resolve())] if found else [sys.executable, "-m", "flexmotion.streamer"]


def _read(options: list[str]) -> tuple[Any, dict[str, Any]]:
    """The command `flexmotion run`, and what its parser reads from the options, by name."""
    from flexmotion.streamer.commands.run import run

    app = typer.Typer(add_completion=False)
    app.command("run")(run)
    command = typer.main.get_command(app)
    return command, command.make_context("flexmotion run", list(options)).params


def _absolute(options: list[str], command: Any, read: dict[str, Any]) -> list[str]:
    """The options with paths that hold in any folder: a unit runs in one of its own."""
    from flexmotion.configs.robot import list_robots

    words = set()
    for parameter in command.params:
        value = read[parameter.name]
        first = value[0] if isinstance(value, list | tuple) and value else value
        named = parameter.name in _NAME_OR_FOLDER and first not in (None, *list_robots()) and Path(first).is_dir()
        if isinstance(first, Path) or named:
            words |= {*parameter.opts}
    found = []
    for before, word in zip(["", *options], options, strict=False):
        option, sign, value = word.partition("=")
        if before in words:
            found.append(str(Path(word).absolute()))
        else:
            found.append(f"{option}={Path(value).absolute()}" if sign and option in words else word)
    return found


def _quoted(word: str) -> str:
    """A word of `ExecStart=`: systemd expands percent and dollar signs, and reads quotes and backslashes."""
    escaped = word.replace("%", "%%").replace("$", "$$").replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"' if not escaped or set(escaped) & set(" \t'\"\\;") else escaped
