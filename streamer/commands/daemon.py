"""`flexmotion daemon`: a systemd unit that runs a robot."""

from __future__ import annotations

import getpass
import shutil
import sys
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Annotated

import typer

from flexmotion.streamer.commands.output import print_note

UNIT = Path("/etc/systemd/system/flexmotion.service")
_LOGS = "%L/flexmotion"
"""The folder of `LogsDirectory=` in a unit."""


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
    """
    _check(options)
    given = {option.partition("=")[0] for option in options}
    whole = [*options]
    whole += [option for option in ("--web", "--wait") if option not in given]
    if given.isdisjoint(("--arm", "--no-arm")):
        whole.append("--no-arm")  # a motion that is given would else begin when somebody powers the robot
    words = [*map(_quoted, [*_program(), "run", *whole])]
    if given.isdisjoint(("--log", "--report")):
        words += ["--log", _LOGS]
    template = Template((files("flexmotion.streamer.commands") / "flexmotion.service").read_text(encoding="utf-8"))
    return template.substitute(command=" ".join(words), user=user, robot=_robot(options))


def _program() -> list[str]:
    """The installed program, by its absolute path: a unit has no PATH of a shell."""
    found = shutil.which("flexmotion")
    return [str(Path(found).resolve())] if found else [sys.executable, "-m", "flexmotion.streamer"]


def _check(options: list[str]) -> None:
    """Let the parser of `flexmotion run` read the options."""
    from flexmotion.streamer.commands.run import run

    app = typer.Typer(add_completion=False)
    app.command("run")(run)
    typer.main.get_command(app).make_context("flexmotion run", list(options))


def _robot(options: list[str]) -> str:
    for name, value in zip(options, options[1:], strict=False):
        if name in ("-r", "--robot"):
            return value
    return next((option.partition("=")[2] for option in options if option.startswith("--robot=")), "a robot")


def _quoted(word: str) -> str:
    """A word of `ExecStart=`: systemd expands percent and dollar signs, and reads quotes and backslashes."""
    escaped = word.replace("%", "%%").replace("$", "$$").replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"' if not escaped or set(escaped) & set(" \t'\"\\;") else escaped
