"""A group of options is a dataclass; each of its fields is an option of the command."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.stream import Gateway
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.cli import execute
from flexmotion.streamer.commands.option_groups import RunOptions, grouped
from flexmotion.streamer.gateway.ports import any_free, bound
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.report.metrics import STANDS_AGAIN_S


@dataclass(frozen=True)
class Speed:
    """A group with options of every kind: required, with a default, repeatable."""

    speed: Annotated[float, typer.Option("--speed", min=0.0, help="How fast.")]
    unit: Annotated[str, typer.Option("--unit")] = "m/s"
    names: Annotated[list[str], typer.Option("--name")] = field(default_factory=list)


def command(options: Speed, loud: Annotated[bool, typer.Option("--loud")] = False) -> None:
    """Print the options."""
    typer.echo(f"{options} {loud}")


@pytest.fixture(scope="module")
def app() -> typer.Typer:
    app = typer.Typer()
    app.command()(grouped(command))
    return app


def test_fields_are_options_with_their_defaults(app: typer.Typer) -> None:
    result = CliRunner().invoke(app, ["--speed", "2"])
    assert result.stdout == "Speed(speed=2.0, unit='m/s', names=[]) False\n"
    result = CliRunner().invoke(app, ["--loud", "--name", "a", "--unit", "km/h", "--speed", "1", "--name", "b"])
    assert result.stdout == "Speed(speed=1.0, unit='km/h', names=['a', 'b']) True\n"


def test_bounds_and_requirements_of_fields_hold(app: typer.Typer) -> None:
    assert CliRunner().invoke(app, ["--speed", "-1"]).exit_code == 2
    assert CliRunner().invoke(app, []).exit_code == 2


def test_help_shows_every_field_and_the_commands_text(app: typer.Typer) -> None:
    shown = CliRunner().invoke(app, ["--help"]).stdout
    assert "Print the options." in shown and "How fast." in shown
    assert all(name in shown for name in ("--speed", "--unit", "--name", "--loud"))


def test_a_group_in_a_union_is_an_error_where_it_is_declared() -> None:
    # Went wrong: it was not expanded, and the command had one option of no use.
    def wrong(options: Speed | None = None) -> None:
        """Do nothing."""

    with pytest.raises(TypeError, match="wrong: options: a group of options cannot be optional or in a union"):
        grouped(wrong)


def test_a_whole_clip_leaves_time_to_catch_up_and_a_part_of_it_ends_at_its_time() -> None:
    """A run stopped with the last frame: a robot that lagged behind could not go on to the human's place."""
    clip = ClipSource(default_clip())
    assert RunOptions().streamed_s(clip, stay=False) == clip.seconds + STANDS_AGAIN_S
    assert RunOptions(seconds=2.0).streamed_s(clip.cut(2.0), stay=False) == pytest.approx(2.0, abs=1.0 / clip.fps)
    assert RunOptions(seconds=2.0).streamed_s(clip, stay=True) is None


def test_a_used_port_is_told_before_anything_is_loaded() -> None:
    """It was tested once the model was loaded, many seconds later."""
    settings = Gateway()
    with bound("127.0.0.1", 0) as used:
        port = int(used.getsockname()[1])
        for option in ("web_port", "stop_port"):
            ports = {"web_port": any_free(), "stop_port": any_free()} | {option: port}
            with pytest.raises(
                ConfigError, match=f"--{option.replace('_', '-')}: 127.0.0.1:{port} cannot be listened on"
            ):
                RunOptions(web=True, **ports).check_ports(settings)
            RunOptions(**ports).check_ports(settings)  # does not listen


def test_a_video_without_a_report_is_refused_before_the_run(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["dry-run", "--seconds", "1", "--video"]) == 2
    assert "--report DIR" in capsys.readouterr().err
