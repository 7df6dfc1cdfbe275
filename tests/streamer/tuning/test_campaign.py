"""A campaign: it finds what is better, goes on where it was stopped, and refuses the folder of another one."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.tuning.campaign import Plan, begin, report, search
from flexmotion.streamer.tuning.result import TuningResult
from flexmotion.streamer.tuning.result_files import JSON, write_result
from flexmotion.streamer.tuning.state import FILE, CampaignState

from .formula import BEST, FormulaMeasurer

Plans = Callable[..., Plan]


def campaign(plan: Plan, folder: Path, measurer: FormulaMeasurer | None = None) -> CampaignState:
    """A whole campaign with its result."""
    folder.mkdir(exist_ok=True)
    measurer = measurer or FormulaMeasurer()
    state = begin(plan, folder, measurer)
    for found in search(plan, folder, state, measurer, lambda line: None):
        state = found
    state = report(plan, folder, state, measurer)
    write_result(plan, state, folder)
    return state


def test_it_finds_better_numbers_and_says_so_on_both_lists(plan: Plans, tmp_path: Path) -> None:
    state = campaign(plan(generations=12), tmp_path / "a")
    assert state.best.cost < 0.3 * state.start.cost
    for name, value in BEST.items():
        assert state.best.numbers[name] == pytest.approx(value, rel=0.2)
    result = TuningResult.model_validate_json((tmp_path / "a" / JSON).read_bytes())
    assert result.finished and result.better_elsewhere
    assert result.reporting is not None and result.reporting.after.mean.way_share == state.best.runs[0].way_share


@pytest.mark.parametrize("batch", [1, 3, 5])
def test_stopped_and_started_again_equals_uninterrupted(plan: Plans, batch: int, tmp_path: Path) -> None:
    campaign(plan(), tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        campaign(plan(), tmp_path / "parts", FormulaMeasurer(interrupt=batch))
    rest = FormulaMeasurer()
    campaign(plan(), tmp_path / "parts", rest)
    assert rest.batches == 1 + 4 + 2 - batch  # nothing is measured twice
    for name in (FILE, JSON, "tuning.md", "robot/robot.yaml"):
        assert (tmp_path / "parts" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_more_generations_go_on(plan: Plans, tmp_path: Path) -> None:
    campaign(plan(generations=2), tmp_path / "longer")
    campaign(plan(generations=4), tmp_path / "longer")
    campaign(plan(generations=4), tmp_path / "whole")
    assert (tmp_path / "longer" / FILE).read_bytes() == (tmp_path / "whole" / FILE).read_bytes()


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"seed": 4}, "seed (3; here 4)"),
        ({"population": 6}, "population (5; here 6)"),
        (
            {"numbers": ("gait.clearance",)},
            "gait.clearance 0.01015 to 0.03045; here gait.clearance 0.01015 to 0.03045)",
        ),
        ({"clips": "third.yaml"}, "clips (walking: velocity 0.5, 0, 0 2 s"),
    ],
)
def test_another_campaign_in_its_folder_is_refused_with_what_differs(
    plan: Plans, lists: Path, changed: dict[str, object], told: str, tmp_path: Path
) -> None:
    campaign(plan(), tmp_path / "a")
    before = (tmp_path / "a" / FILE).read_bytes()
    if "clips" in changed:
        (lists / "third.yaml").write_text("walking: [{velocity: [0.7, 0, 0], seconds: 2}]\n")
        changed = {"clips": lists / "third.yaml"}
    with pytest.raises(ConfigError, match="was begun with another") as caught:
        campaign(plan(**changed), tmp_path / "a")
    assert told in str(caught.value)
    assert (tmp_path / "a" / FILE).read_bytes() == before


def test_a_folder_with_other_files_is_refused(plan: Plans, tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "notes.txt").write_text("mine")
    with pytest.raises(ConfigError, match=r"holds no campaign, but notes\.txt"):
        campaign(plan(), tmp_path / "a")


def test_a_damaged_state_names_file_and_field(plan: Plans, tmp_path: Path) -> None:
    campaign(plan(), tmp_path / "a")
    content = json.loads((tmp_path / "a" / FILE).read_text())
    content["best"]["cost"] = "low"
    (tmp_path / "a" / FILE).write_text(json.dumps(content))
    with pytest.raises(ConfigError, match=r"state\.json: field best\.cost: "):
        campaign(plan(), tmp_path / "a")


def test_a_state_of_another_search_is_refused(plan: Plans, tmp_path: Path) -> None:
    campaign(plan(), tmp_path / "a")
    content = json.loads((tmp_path / "a" / FILE).read_text())
    content["generations"][1][0]["numbers"]["gait.clearance"] = 0.0222
    (tmp_path / "a" / FILE).write_text(json.dumps(content))
    with pytest.raises(ConfigError, match="generation 2 is not what this search asks for"):
        campaign(plan(), tmp_path / "a")


def test_candidates_that_cannot_run_cost_as_falls(plan: Plans, tmp_path: Path) -> None:
    measurer = FormulaMeasurer()
    measurer.breaks_below = 0.014  # the file has 0.015
    state = campaign(plan(generations=6), tmp_path / "a", measurer)
    measured = [one for generation in state.generations for one in generation]
    failed = [one for one in measured if one.failure is not None]
    assert failed and all(one.failure == "RetargetError: no swing" and one.cost == 2.0 for one in failed)
    assert all(one.cost < 1.0 for one in measured if one.failure is None)
    assert state.best.cost <= state.start.cost < 1.0


def test_a_robot_that_cannot_run_as_it_is_is_refused(plan: Plans, tmp_path: Path) -> None:
    measurer = FormulaMeasurer()
    measurer.breaks_below = 1.0
    with pytest.raises(ConfigError, match="as it is, it cannot follow velocity 0.5, 0, 0: RetargetError: no swing"):
        campaign(plan(), tmp_path / "a", measurer)
    assert not (tmp_path / "a" / FILE).exists()


def test_the_robots_own_folder_is_no_place_for_a_campaign(plan: Plans) -> None:
    own = plan()
    with pytest.raises(ConfigError, match="is inside the robot's folder"):
        begin(own, own.robot.folder / "tuned", FormulaMeasurer())


def test_where_nothing_costs_less_the_file_is_kept(plan: Plans, tmp_path: Path) -> None:
    class Flat(FormulaMeasurer):
        def figures(self, trial):  # type: ignore[no-untyped-def]
            return super().figures(trial).model_copy(update={"way_share": 0.5})

    own = plan()
    state = campaign(own, tmp_path / "a", Flat())
    assert state.best == state.start
    text = (tmp_path / "a" / "robot" / "robot.yaml").read_text()
    assert text == own.robot.file.read_text()
    assert "they are kept" in (tmp_path / "a" / "tuning.md").read_text()
