"""The command line `flexmotion`: its commands, and the place where an error becomes a message and an exit code.

Exit codes: 0 fine; 1 it ran and the check failed; 2 bad usage, file or configuration; 3 hardware or driver failed;
130 interrupted. Results go to stdout, everything else to stderr.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import Annotated

import typer

from flexmotion.configs.errors import FlexMotionError
from flexmotion.streamer.commands.bundles import bundles
from flexmotion.streamer.commands.check import check
from flexmotion.streamer.commands.check_bus import bus
from flexmotion.streamer.commands.daemon import daemon
from flexmotion.streamer.commands.data import data
from flexmotion.streamer.commands.data_dynamics import dynamics
from flexmotion.streamer.commands.doctor import doctor
from flexmotion.streamer.commands.drive import drive
from flexmotion.streamer.commands.drivers import drivers
from flexmotion.streamer.commands.dry_run import dry_run
from flexmotion.streamer.commands.emulate import emulate
from flexmotion.streamer.commands.evaluate import evaluate
from flexmotion.streamer.commands.exit_codes import BAD_USAGE, INTERRUPTED, OK
from flexmotion.streamer.commands.export import export
from flexmotion.streamer.commands.log import log
from flexmotion.streamer.commands.options import MIRROR_ADDRESS
from flexmotion.streamer.commands.personalize import personalize
from flexmotion.streamer.commands.retarget import retarget
from flexmotion.streamer.commands.robots import robots
from flexmotion.streamer.commands.robots_tune import tune
from flexmotion.streamer.commands.run import run
from flexmotion.streamer.commands.send import arm, clear, disarm, estop, kill, send, status, stop
from flexmotion.streamer.commands.servo import servo
from flexmotion.streamer.commands.servo_adopt import adopt
from flexmotion.streamer.commands.servo_calibration import calibrate, calibrate_imu
from flexmotion.streamer.commands.servo_identify import identify
from flexmotion.streamer.commands.servo_settings import configure, restore
from flexmotion.streamer.commands.train import train

ParserError: type[Exception] = typer.BadParameter.__mro__[2]
"""Base class of the parser's errors (click's `ClickException`, of which Typer exports only a subclass)."""

app = typer.Typer(
    help="Human motion to a humanoid's servos, live: retargeted, balanced, inside every servo's limits.",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)
app.command("dry-run")(dry_run)
app.command("run")(run)
app.command("daemon", context_settings={"ignore_unknown_options": True})(daemon)
app.command("doctor")(doctor)
for _command in (drive, send, status, arm, disarm, stop, estop, clear, kill):
    app.command(_command.__name__)(_command)
app.command("retarget")(retarget)
check.command("bus")(bus)
app.add_typer(check, name="check")
data.command("dynamics")(dynamics)
app.add_typer(data, name="data")
servo.command("adopt")(adopt)
servo.command("configure")(configure)
servo.command("restore")(restore)
servo.command("calibrate")(calibrate)
servo.command("calibrate-imu")(calibrate_imu)
servo.command("identify")(identify)
app.add_typer(servo, name="servo")
app.command("emulate")(emulate)
app.add_typer(log, name="log")
app.add_typer(train, name="train")
app.command("personalize")(personalize)
app.command("evaluate")(evaluate)
app.command("export")(export)
robots.command("tune")(tune)
app.add_typer(robots, name="robots")
app.command("bundles")(bundles)
app.command("drivers")(drivers)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"flexmotion {version('flexmotion')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _global(
    context: typer.Context,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Log more to stderr.")] = False,
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    logging.basicConfig(
        stream=sys.stderr,
        level=logging.INFO if verbose else logging.WARNING,
        format="%(levelname)s: %(message)s",
        force=True,
    )
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def execute(arguments: Sequence[str] | None = None) -> int:
    """Run one command line (`sys.argv` if None) and return its exit code; only bugs raise."""
    try:
        code = app(args=_with_defaults(arguments), standalone_mode=False, prog_name="flexmotion")
    except FlexMotionError as error:
        return _fail(str(error), error.exit_code)
    except ParserError as error:
        return _fail(error.format_message(), BAD_USAGE)  # type: ignore[attr-defined]
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        return _fail(f"{place}{error.strerror or error}", BAD_USAGE)
    except (KeyboardInterrupt, typer.Abort):
        return _fail("interrupted", INTERRUPTED)
    return code if isinstance(code, int) else OK


_VALUE_OPTIONAL = {(command, "--mirror"): MIRROR_ADDRESS for command in ("dry-run", "run")}
"""Options of commands whose value may be left out, which Typer does not know, and that value."""


def _with_defaults(arguments: Sequence[str] | None) -> list[str]:
    """A command line in which every option of `_VALUE_OPTIONAL` has its value."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    command = next((word for word in given if not word.startswith("-")), "")
    filled = []
    for place, word in enumerate(given):
        filled.append(word)
        following = given[place + 1] if place + 1 < len(given) else "-"
        if (command, word) in _VALUE_OPTIONAL and following.startswith("-"):
            filled.append(_VALUE_OPTIONAL[command, word])
    return filled


def _fail(message: str, code: int) -> int:
    # A group called without a command has shown its help; its error has no message.
    if line := " ".join(message.split()):
        print(f"flexmotion: {line}", file=sys.stderr)
    return code
