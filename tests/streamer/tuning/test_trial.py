"""A trial: what a candidate's numbers break counts as a fall, and a clip that cannot be measured on is refused."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.streamer.motion.intents import Text, Velocity
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.tuning.clip_list import TuningClip
from flexmotion.streamer.tuning.figures import AskedWay
from flexmotion.streamer.tuning.trial import Question, Trial, asked_way, try_out
from flexmotion.streamer.tuning.variant import variant, write_variant

OP3 = load_robot("op3").file
CLEARANCE = ("gait", "clearance")


def clip(*intents: Text | Velocity, seconds: float | None = 3.0) -> TuningClip:
    items = tuple(Item(float(place), intent) for place, intent in enumerate(intents))
    return TuningClip("walking", "some motion", "text", items, seconds, perturbed=False, digest="")


def test_a_clip_that_is_followed_has_figures_and_the_same_every_time(tmp_path: Path) -> None:
    trial = Trial(OP3, ((CLEARANCE, 0.015),), clip(Velocity(0.6, 0.0, 0.0), seconds=2.0), AskedWay(way_m=1.0), 5)
    run = try_out(trial)
    assert run.failure is None and run.upright and run.lasted == 1.0
    assert run.way_share is not None and run.way_share > 0.2
    assert None not in (run.heading_deg, run.arm_deg, run.trunk_deg, run.heat)
    assert try_out(trial) == run


@pytest.mark.parametrize(
    ("values", "told"),
    [
        (((CLEARANCE, -0.01),), "ConfigError: .*robot.yaml: field gait.clearance: "),
        (((("gait", "walk_hip_height"), 0.5),), "ConfigError: .* walk_hip_height <= stand_hip_height"),
        (((CLEARANCE, 0.2),), "RetargetError: "),
        (((("gait", "gone"), 0.2),), "ConfigError: .*field gait.gone: not in the file"),
    ],
)
def test_numbers_that_break_the_robot_cost_as_a_fall(values: tuple, told: str) -> None:
    run = try_out(Trial(OP3, values, clip(Velocity(0.6, 0.0, 0.0)), AskedWay(way_m=1.0), 0))
    assert (run.upright, run.lasted, run.way_share) == (False, 0.0, None)
    assert run.failure is not None
    assert re.match(told, run.failure)


def test_the_way_that_is_asked_is_that_of_a_human_who_is_not_slowed() -> None:
    ways = [asked_way(Question(OP3, clip(Velocity(speed, 0.0, 0.0)), 1)) for speed in (0.5, 1.1)]
    assert all(isinstance(way, AskedWay) and way.way_m is not None for way in ways)
    slow, fast = (way.way_m for way in ways if isinstance(way, AskedWay))
    # OP3's pace is 0.9 m/s of the human: a fast walk is asked whole.
    assert slow is not None and fast is not None and 1.2 * slow < fast < 3.5


def test_arcs_and_gestures_have_no_way() -> None:
    for words in ("turn left", "wave with the right hand"):
        assert asked_way(Question(OP3, clip(Text(words)), 1)) == AskedWay(way_m=None)


@pytest.mark.parametrize(
    ("one", "told"),
    [
        (clip(Text("bake a cake")), "some motion: refused: "),
        (clip(Text("walk two steps")), "some motion: its end is not known before the run"),
        (clip(Text("walk forward"), seconds=None), "some motion: its end is not known before the run; give seconds"),
    ],
)
def test_motion_that_cannot_be_measured_on_is_refused_with_the_reason(one: TuningClip, told: str) -> None:
    answer = asked_way(Question(OP3, one, 0))
    assert isinstance(answer, str) and answer.startswith(told)


def test_a_variant_differs_in_its_numbers_alone_and_a_copy_is_complete(tmp_path: Path) -> None:
    values = {CLEARANCE: 0.02, ("gait", "zmp_feedback", 1): 0.03}
    with variant(OP3, values) as changed:
        gait = changed.gait
        folder = changed.folder
    assert (gait.clearance, gait.zmp_feedback[1]) == (0.02, 0.03) and not folder.exists()
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot" / "old.txt").write_text("of an earlier result")
    written = write_variant(OP3, values, tmp_path / "robot")
    assert written.gait == gait
    names = {path.name for path in (tmp_path / "robot").iterdir()}
    assert names == {"robot.yaml", *(path.name for path in OP3.parent.iterdir() if path.is_file())} - {"op3.yaml"}
    assert not any(path.is_symlink() for path in (tmp_path / "robot").iterdir())
    lines = zip(OP3.read_text().splitlines(), (tmp_path / "robot" / "robot.yaml").read_text().splitlines(), strict=True)
    assert [after.strip() for before, after in lines if before != after] == [
        "clearance: 0.02",
        "zmp_feedback: [0.045, 0.03]",
    ]
