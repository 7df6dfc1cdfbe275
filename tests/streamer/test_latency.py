"""`check latency`: what it measures, how it judges, how it reads."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from configs.robot import load_robot
from configs.stream import load_stream
from drivers.registry import create
from streamer.cli import execute
from streamer.latency import HISTOGRAM_US, LatencyResult, measure, shipped_clips, switched
from streamer.latency_text import render_latency
from streamer.plots import write_latency

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def result() -> LatencyResult:
    """Six switches on this machine, under whatever else it does, without realtime scheduling."""
    op3 = load_robot("op3")
    for _ in range(3):  # a machine whose processor is taken away meanwhile tells nothing of the program
        source, intents = switched(shipped_clips())
        found = measure(
            op3, create("sim", op3), load_stream(), source, intents, seconds=60.0, switches=6, realtime=False, load=1
        )
        if not found.faults:
            break
    return found


def test_every_switch_is_followed_and_every_stage_is_measured(result: LatencyResult) -> None:
    assert result.switches == 6 and 5 <= result.answered <= 6  # the end may overtake the last one
    assert all(stage.time is not None for stage in result.stages.values())
    assert sum(result.lateness) == result.cycles and len(result.lateness) == len(HISTOGRAM_US)
    command, effect = result.stages["target to command"].time, result.stages["target to effect"].time
    assert command is not None and effect is not None and effect.p50 >= command.p50
    assert result.violations_sent == 0 and result.faults == ()


def test_without_realtime_scheduling_it_never_passes(result: LatencyResult) -> None:
    assert result.scheduling == "other" and not result.ok
    assert any("SCHED_FIFO" in failure for failure in result.failures)


def test_the_text_names_the_failures_and_shows_the_histogram(result: LatencyResult) -> None:
    out = io.StringIO()
    Console(file=out, width=120).print(render_latency(result))
    text = out.getvalue()
    assert text.startswith("FAIL") and "target to command" in text and "8000 and more" in text and "1 hogs" in text


def test_time_that_a_host_took_is_said(result: LatencyResult) -> None:
    """Went wrong: a run on a virtual machine missed ten periods in one stall, and nothing said whose it was."""
    said = []
    for stolen_ms in (0.0, 120.0):
        out = io.StringIO()
        Console(file=out, width=200).print(render_latency(replace(result, stolen_ms=stolen_ms)))
        said.append("host of this machine took 120 ms" in out.getvalue())
    assert said == [False, True]


def test_the_picture_and_the_json(result: LatencyResult, tmp_path: Path) -> None:
    assert write_latency(tmp_path / "latency.png", result).read_bytes().startswith(PNG)
    content = json.loads(json.dumps(result.content()))
    assert content["stages"]["target to command"]["budget_p99_ms"] == 60.0 and content["ok"] is False


def test_one_clip_is_not_enough_to_switch_between(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from flexmotion.default_clip import default_clip
    from flexmotion.motion_file import save_motion

    file = tmp_path / "one.npz"
    save_motion(default_clip()[:90], file)
    assert execute(["check", "latency", "--clip", str(file)]) == 2
    assert "two or more files" in capsys.readouterr().err
