"""What runs that are asked for places have in common, and their table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from benchmarks.robot.asked_run import safety, true_state, up_ticks
from benchmarks.shared.prompt_table import by_prompt, millimetres, percent, show, states, within
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace


@dataclass(frozen=True)
class Row:
    prompt: str
    state: str
    off_m: float


@dataclass(frozen=True)
class Run:
    upright: bool
    violations: int


ROWS = [Row("bow", "accepted", 0.004), Row("wave", "moved", math.nan), Row("bow", "accepted", 0.03)]


def figures(rows: Any) -> dict[str, Any]:
    return {"targets": len(rows), "near": within([row.off_m for row in rows], 0.01), "states": states(rows)}


def test_a_place_that_could_not_be_measured_is_not_within_a_bound() -> None:
    assert within([row.off_m for row in ROWS], 0.01) == pytest.approx(1 / 3)


def test_prompts_come_in_the_order_of_their_runs_and_a_row_counts_once() -> None:
    found = by_prompt(ROWS, figures)
    assert found["targets"] == 3 and list(found["prompts"]) == ["bow", "wave"]
    assert found["prompts"]["bow"] == {"targets": 2, "near": 0.5, "states": {"accepted": 2}}
    assert found["prompts"]["wave"]["states"] == {"moved": 1}


def test_the_table_has_a_row_for_each_prompt_and_one_for_all(capsys: pytest.CaptureFixture[str]) -> None:
    show(by_prompt(ROWS, figures), {"near": percent("near"), "targets too": lambda own: str(own["targets"])})
    printed = capsys.readouterr().out
    assert all(name in printed for name in ("bow", "wave", "all")) and "50%" in printed and "33%" in printed
    assert millimetres("off")({"off": 0.0123}) == "12.3 mm"


def test_after_a_fall_there_is_no_true_state() -> None:
    ticks = SimpleNamespace(
        tick=np.arange(3), true_base=np.zeros((3, 7)), true_q=np.eye(3), state=np.full(3, State.STREAMING)
    )
    ticks.state[2] = State.DAMPED
    record = cast(RunTrace, SimpleNamespace(ticks=ticks))
    found = true_state(record, 1.5)
    assert found is not None and found[1].tolist() == [0.0, 0.0, 1.0]
    assert true_state(record, 3.0) is None
    assert up_ticks(record).tolist() == [True, True, False]


def test_one_fall_or_one_goal_outside_the_envelope_fails() -> None:
    good, fell, wild = Run(True, 0), Run(False, 0), Run(True, 1)
    assert all(verdict.holds for verdict in safety([good, good]))
    assert [verdict.holds for verdict in safety([good, fell])] == [False, True]
    assert [verdict.holds for verdict in safety([good, wild])] == [True, False]
