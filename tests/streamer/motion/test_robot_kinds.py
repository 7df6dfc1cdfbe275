"""A robot that was judged does what it passed, and refuses every other kind of motion by name, however it is asked."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer import BadParameter

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.repertoire import offered_kinds
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.judged import Judged
from flexmotion.configs.repertoire import FILE, RobotRepertoire
from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.streamer import api
from flexmotion.streamer.cli import execute
from flexmotion.streamer.commands.choice import choose_source
from flexmotion.streamer.log.header import robot_files
from flexmotion.streamer.log.source import pack, unpack
from flexmotion.streamer.motion.hearing import Hearing
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace

TILT = "tilt your head to the right"
REFUSED = "robot op3 cannot tilt your head to the right (robot/kinds: 0 of 5 runs did, 80 % pass)"


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def source(op3: Robot) -> ModelSource:
    found = api.open_source(op3, Text("stand still"))
    assert isinstance(found, ModelSource)
    return found


@pytest.fixture(scope="module")
def hearing(op3: Robot, source: ModelSource) -> Hearing:
    return Hearing(source.sampler, human_pace(op3, source.body))


@pytest.mark.parametrize(
    "say",
    [
        TILT,
        "tilt your head twice to the right",
        "wave, then tilt your head to the right",
        "tilt your head to the right, then wave",
        "tilt your head to the right while waving",
        "walk two metres and tilt your head to the right at the same time",
    ],
)
def test_a_tilt_of_the_head_is_refused_by_a_robot_that_cannot(hearing: Hearing, say: str) -> None:
    """A tilt of OP3's head, which has no joint for it, was accepted and PASS, and ran to its limit if counted."""
    heard = hearing(Text(say)).heard
    assert heard.state == "refused" and REFUSED in str(heard.reason) and "stands still" in str(heard.reason)


def test_what_a_robot_cannot_is_refused_beside_a_walk_that_is_under_way(hearing: Hearing) -> None:
    walk = hearing(Text("walk forward"))
    heard = hearing(Text("tilt your head to the right meanwhile"), walk, walk).heard
    assert heard.state == "refused" and REFUSED in str(heard.reason)


def test_a_refusal_says_what_bundle_and_robot_offer_together(source: ModelSource, op3: Robot) -> None:
    offered = source.sampler.requests.kinds
    assert offered == offered_kinds(source.sampler.bundle, op3.repertoire)
    assert set(offered_kinds(source.sampler.bundle)) - set(offered) == {"tilt-head-right", "tilt-head-left"}
    told = str(source.sampler.prompt(TILT).warning)
    assert told.endswith(f", … (flexmotion bundles --robot op3 lists all {len(offered)})")
    assert "tilt" not in told.partition("; try: ")[2] and source.sampler.prompt(TILT).refused == "tilt-head-right"


@pytest.mark.parametrize(
    ("say", "left_out", "who"),
    [
        ("walk while tilting your head to the right", "while tilting your head to the right", REFUSED),
        ("walk with your head tilted to the right", "with your head tilted to the right", REFUSED),
        ("walk two metres while tilting your head right, then bow", "while tilting your head right", REFUSED),
        ("walk while kicking", "while kicking", "this model cannot kick yet"),
        ("walk with your head tilted and wave", "with your head tilted", REFUSED),
        ("walk with a tilted head", "with a tilted head", REFUSED),
        ("bow while leaning your head", "while leaning your head", REFUSED),
    ],
)
def test_what_is_left_out_beside_a_walk_is_told_with_who_cannot_do_it(
    hearing: Hearing, say: str, left_out: str, who: str
) -> None:
    """A tilt of OP3's head beside a walk was told as done; a kick beside it was left out, and nobody said why."""
    heard = hearing(Text(say)).heard
    assert heard.state == "partly" and heard.dropped == (left_out,)
    assert f"{left_out!r} is left out: {who}" in heard.notes


def test_why_a_part_of_a_refused_sentence_was_left_out_was_not_told(hearing: Hearing) -> None:
    heard = hearing(Text(f"kick while {TILT.replace('tilt', 'tilting')}")).heard
    note = f"'while tilting your head to the right' is left out: {REFUSED}"
    assert heard.state == "refused" and heard.notes == (note,)
    assert "this model cannot kick yet" in str(heard.told()) and str(heard.told()).endswith(f"; {note}")


@pytest.mark.parametrize("say", ["walk carrying a box", "walk with your fists up", "walk with your eyes closed"])
def test_a_phrase_that_only_sounds_like_what_is_not_offered_is_not_told_as_it(hearing: Hearing, say: str) -> None:
    heard = hearing(Text(say)).heard
    assert heard.state == "partly" and not any("left out" in note for note in heard.notes)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"kinds": {"wallk": 1, "nod": 1}}, "field kinds.wallk: no kind of motion is called so, did you mean: walk"),
        ({"kinds": {"run": 1}, "done_as": {"run": "wolk"}}, "field done_as.wolk: no kind of motion is called so"),
        ({"kinds": {"run": 1}, "done_as": {"runs": "walk"}}, "field done_as.runs: no kind of motion is called so"),
    ],
)
def test_a_misspelt_kind_took_that_kind_away_without_a_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: dict[str, dict[str, object]], says: str
) -> None:
    """`walk` renamed to `wallk` was accepted, and walks were refused."""
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    judged = {"judge": "robot/kinds", "samples": 5, "share": 1.0, "least": 0.8}
    kinds = dict.fromkeys(content["kinds"], judged)
    (folder / FILE).write_text(json.dumps({**content, "kinds": kinds}))
    with pytest.raises(ConfigError, match=f"{FILE}: {says}"):
        api.open_source(load_robot(folder), Text("walk"))
    for command in (["robots", str(folder)], ["bundles", "--robot", str(folder)]):
        assert execute(command) != 0
        out = capsys.readouterr()
        assert says.partition(",")[0] in " ".join((out.out + out.err).split())


def test_where_to_look_up_what_a_robot_does_was_told_without_the_robot(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "my robot"))
    (folder / "op3.yaml").rename(folder / "robot.yaml")
    judged = {"judge": "robot/kinds", "samples": 5, "share": 1.0, "least": 0.8}
    (folder / FILE).write_text(json.dumps({"kinds": {"bow": judged}}))
    with pytest.raises(BadParameter, match=f"flexmotion bundles --robot '{folder}'` lists what they do"):
        choose_source(load_robot(folder))
    (folder / FILE).unlink()
    assert execute(["robots", str(folder)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "all are offered (python -m benchmarks robot/kinds --robot '" in told and "my robot' --write)" in told


def test_what_the_model_cannot_is_refused_as_the_models(source: ModelSource) -> None:
    assert "this model cannot kick yet" in str(source.sampler.prompt("kick").warning)


def test_a_kind_that_no_judge_saw_at_a_judged_robot_is_not_offered(bundle: Path) -> None:
    passed = Judged(judge="robot/kinds", samples=5, share=1.0, least=0.8)
    mine = RobotRepertoire("mine", "/robots/mine", {"walk": passed, "bow": passed.model_copy(update={"share": 0.2})})
    sampler = Sampler(Bundle(bundle), robot=mine)
    assert sampler.requests.kinds == ("stand", "walk")
    told = {say: str(sampler.prompt(say).warning) for say in ("nod", "bow")}
    judge = "python -m benchmarks robot/kinds --robot /robots/mine --write"
    assert f"robot mine cannot nod (not judged: {judge} --kind nod), it stands still" in told["nod"]
    assert "robot mine cannot bow (robot/kinds: 1 of 5 runs did, 80 % pass), it stands still" in told["bow"]


def test_a_robot_that_was_never_judged_is_offered_all(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    (folder / FILE).unlink()
    found = api.open_source(load_robot(folder), Text(TILT))
    assert isinstance(found, ModelSource) and found.heard_items[0].heard_as == "tilt-head-right"
    assert found.sampler.requests.kinds == offered_kinds(found.sampler.bundle)


def test_a_live_target_that_the_robot_cannot_do_is_refused_and_nothing_moves(op3: Robot) -> None:
    with api.open_session(op3, source=api.open_source(op3, Text("stand still"))) as session:
        session.advance(2.5)
        target = session.send(Text("tilt your head twice to the right"))
        session.advance(0.5)
        (heard,) = [one for one in session.heard if one.id == target.id]
        assert heard.state == "refused" and REFUSED in str(heard.reason)


def test_a_dry_run_of_what_the_robot_cannot_do_fails(capsys: pytest.CaptureFixture[str]) -> None:
    """A tilt of the head was PASS with likeness 100 %."""
    assert execute(["dry-run", "--prompt", TILT, "--seconds", "0.5", "--json"]) == 1
    (heard,) = json.loads(capsys.readouterr().out)["targets"]
    assert heard["state"] == "refused" and REFUSED in heard["reason"]


def test_a_replay_refuses_what_the_robot_of_the_run_could_not(source: ModelSource) -> None:
    parts, files = pack(source)
    again, former = (unpack(json.loads(json.dumps(one)), files, Path("log")) for one in (parts, _before(parts)))
    assert isinstance(again, ModelSource) and isinstance(former, ModelSource)
    assert again.sampler.prompt(TILT).warning == source.sampler.prompt(TILT).warning
    assert former.sampler.prompt(TILT).kind == "tilt-head-right"


def _before(parts: dict[str, object]) -> dict[str, object]:
    """The parts of a log of an earlier version."""
    return {name: value for name, value in parts.items() if name != "repertoire"}


@pytest.mark.parametrize("robot", ["op3", ROBOTS / "op3", load_robot("op3")], ids=["name", "folder", "robot"])
def test_a_sampler_takes_a_robot_as_a_session_does_and_says_why_it_stands(robot: Robot | Path | str) -> None:
    """A name was an AttributeError, and the docstring said that `sample` refuses by name what it stands still for."""
    sampler = api.open_sampler(robot=robot)
    assert REFUSED in str(sampler.prompt(TILT).warning)
    windows = [sampler.sample(sampler.standing(), Condition(text=text), 1) for text in (TILT, "stand still")]
    assert np.array_equal(windows[0].joints, windows[1].joints)


@pytest.mark.parametrize("robot", ["op3", ROBOTS / "op3"], ids=["name", "folder"])
def test_a_source_and_a_driver_take_a_robot_by_its_name(robot: Path | str) -> None:
    """An AttributeError, "'str' object has no attribute 'gait'"; of a driver, "no attribute 'compile'"."""
    source = api.open_source(robot, Text("stand still"))
    assert isinstance(source, ModelSource) and source.pace == human_pace(load_robot("op3"), source.body)
    assert api.open_driver("sim", robot).name == "sim"
    with pytest.raises(ConfigError, match="unknown robot 'op4'"):
        api.open_source("op4", Text("stand still"))


def test_a_sampler_of_an_unknown_robot_names_those_that_there_are() -> None:
    with pytest.raises(ConfigError, match="op3"):
        api.open_sampler(robot="op4")


def test_a_log_says_that_what_the_robot_was_judged_to_do_has_changed(op3: Robot) -> None:
    """Targets for head and arm of a replay follow the robot's own file."""
    assert f"robot/{FILE}" in robot_files(op3)


def test_commands_show_what_a_robot_does(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["robots", "op3"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "Does 50 of 52 kinds of motion as judged; flexmotion bundles --robot op3 lists them" in told
    assert "At its pace it does run as walk, dash as walk" in told
    assert "Refuses by name: tilt-head-right (robot/kinds: 0 of 5 runs did, 80 % pass); tilt-head-left (" in told
    assert execute(["robots", "op3", "--json"]) == 0
    kinds = json.loads(capsys.readouterr().out)["kinds"]
    assert kinds["run"]["done_as"] == "walk" and kinds["walk"]["done_as"] is None
    assert kinds["walk"]["offered"] is True and kinds["tilt-head-left"]["offered"] is False
    for robot, tilts in (([], True), (["--robot", "op3"], False)):
        assert execute(["bundles", "default", *robot, "--json"]) == 0
        (found,) = json.loads(capsys.readouterr().out)
        assert ("tilt-head-left" in found["kinds"]) is tilts and "walk" in found["kinds"]
