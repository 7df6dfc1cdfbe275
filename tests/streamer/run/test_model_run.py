"""A model as the source of whole runs: from the command line to the log, and replayed from it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.sampling.pace import Pace
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.api import open_session, open_source
from flexmotion.streamer.cli import execute
from flexmotion.streamer.commands.choice import choose_source, choose_switched
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.intents import Clip, Intent, Stop, Text, Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.planning.offline import retarget_offline
from flexmotion.streamer.report.report import TIMING_KEYS
from flexmotion.streamer.run.played_human import human_motion
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

from ..stub_sampler import StubSampler

WALK, TURN = Text("walk forward"), Text("turn left")
HOLD_WITHIN_S = 2.5
"""After a target that stops the robot holds within this time [s of the loop]."""
MOST_TICKS = 5000
"""Bound against hanging."""


def session(*items: Item, seconds: float | None = 3.0) -> Session:
    """A session that follows the stub sampler, whose human glides: the robot makes no steps."""
    robot = load_robot("op3")
    source = ModelSource(StubSampler(), items, "model:stub", seconds=seconds)  # type: ignore[arg-type]
    return Session(robot, create("sim", robot, seed=0), source, load_stream(), seconds)


When = Callable[[ControlLoop], bool]
Act = Intent | Request


def driven(run: Session, *acts: tuple[When, Act]) -> tuple[RunTrace, list[int]]:
    """A run with targets and requests, each sent once its condition holds, after the one before.

    Returns:
        Its record, and the tick before which each was sent.
    """
    ticks: list[int] = []

    def operate() -> Request | None:
        loop = run.loop
        assert loop is not None and loop.tick_count < MOST_TICKS, f"act {len(ticks)} was never sent"
        if len(ticks) == len(acts) or not acts[len(ticks)][0](loop):
            return None
        act = acts[len(ticks)][1]
        ticks.append(loop.tick_count)
        if isinstance(act, Request):
            return act
        run.targets.send(act)
        return None

    run.next_request = operate
    return run.run(), ticks


def rising(loop: ControlLoop) -> bool:
    return loop.ladder.state is State.READY


def follows(target: int, ticks: int = 0) -> When:
    """The robot streams a plan that follows this target (0: the script), and has for so many ticks."""
    seen: list[int] = []

    def met(loop: ControlLoop) -> bool:
        if loop.ladder.state is State.STREAMING and int(loop.telemetry.row.target) == target:
            seen.append(loop.tick_count)
        return len(seen) > ticks

    return met


def holds(loop: ControlLoop) -> bool:
    return loop.ladder.state is State.HOLD


def test_a_script_plays_to_its_end_and_the_human_motion_is_known() -> None:
    run = session(Item(0.0, Velocity(0.0, 0.0, 0.2)), Item(1.5, Text("stand still")))
    record = run.run()
    assert State(record.state[-1]) is State.OFF
    played = record.source_s[np.isfinite(record.source_s)]
    assert played[-1] == pytest.approx(3.0, abs=0.05)
    human = human_motion(run.source, record)
    assert human is not None and human.duration == pytest.approx(played[-1], abs=0.05)
    # The torso follows the human's turn, which ended half-way.
    yaw = 2 * np.arctan2(record.base_ref[:, 6], record.base_ref[:, 3])
    assert np.nanmax(yaw) == pytest.approx(0.3, abs=0.1)


def test_targets_are_followed_and_a_stop_can_be_continued_from() -> None:
    run = session(Item(0.0, Text("stand still")), seconds=None)
    turning = Velocity(0.0, 0.0, 0.3)
    record, (first, stop, third, _) = driven(
        run,
        (follows(0, ticks=100), turning),
        (follows(1, ticks=100), Stop()),
        (holds, turning),
        (follows(3, ticks=100), Request.END),
    )
    target, lead = record.ticks.target, 8
    assert [int(number) for number in np.unique(target)] == [0, 1, 2, 3]
    assert int(np.argmax(target == 1)) - first <= lead and int(np.argmax(target == 3)) - third <= lead
    changes = np.flatnonzero(np.diff(record.state)) + 1
    states = [State(state) for state in record.state[changes]]
    assert states == [State.STREAMING, State.HOLD, State.STREAMING, State.HOLD, State.PARK, State.OFF]
    assert stop < changes[1] < third and changes[1] - stop <= HOLD_WITHIN_S * record.rate_hz
    assert changes[2] - third <= lead
    assert record.underruns == 0 and not [event for event in record.events if event.kind == "fault"]
    assert human_motion(run.source, record) is None  # targets came in between


def test_a_run_that_ends_before_the_source_begins_has_no_human() -> None:
    """A robot that fell in the lead-in, before the first frame, ended in a traceback."""
    run = session(Item(0.0, WALK), seconds=None)
    record, _ = driven(run, (rising, Request.END))
    assert not np.isfinite(record.source_s).any() and human_motion(run.source, record) is None


def test_a_target_that_is_too_fast_is_reported_during_the_run() -> None:
    robot, pace = load_robot("op3"), Pace(0.3, 0.3, 0.1, 0.2)
    source = ModelSource(StubSampler(), [Item(0.0, Text("stand still"))], "model:stub", pace=pace)  # type: ignore[arg-type]
    run = Session(robot, create("sim", robot, seed=0), source, load_stream())
    record, _ = driven(run, (follows(0), Velocity(0.0, 0.0, 0.4)), (follows(1), Request.END))
    notes = [event.message for event in record.events if event.kind == "note"]
    assert len(notes) == 1 and "velocity [0.0, 0.0, 0.4] is slowed to a human's 0.2 rad/s turning left" in notes[0]
    assert int(record.ticks.target[-1]) == 1


def test_a_source_that_switches_between_prompts_is_slowed_too() -> None:
    op3 = load_robot("op3")
    source, _ = choose_switched(op3, (), None, None, seed=0)
    assert isinstance(source, ModelSource) and source.pace == human_pace(op3, source.body)


def test_a_target_that_cannot_be_followed_is_reported_and_the_run_continues() -> None:
    run = session(Item(0.0, Text("stand still")), seconds=None)
    record, (sent, ended) = driven(run, (follows(0), Clip("walk.bvh")), (follows(0, ticks=100), Request.END))
    assert (record.state[sent:ended] == State.STREAMING).all()
    notes = [event.message for event in record.events if event.kind == "note"]
    assert notes == ["clip: 'walk.bvh' is unknown; this run takes none; start it with --clips FILE"]
    assert not record.ticks.target.any() and State(record.state[-1]) is State.OFF


def test_a_model_is_retargeted_offline_to_its_end() -> None:
    run = session(Item(0.0, TURN), seconds=1.5)
    trajectory = retarget_offline(run.robot, run.source, run.settings)  # type: ignore[arg-type]
    assert np.nanmax(trajectory.source_s) == pytest.approx(1.5, abs=0.05)


# ---------------------------------------------------------------- with a trained model


def dry_run(*arguments: str) -> int:
    return execute(["dry-run", *arguments])


def test_a_prompt_from_the_command_line_gives_the_same_run_twice(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--prompt", "wave with the right hand", "--bundle", str(bundle), "--seconds", "2", "--seed", "5", "--json"]
    assert dry_run(*asked, "--report", str(tmp_path)) == 0
    first = json.loads(capsys.readouterr().out)
    assert first["source"] == "prompt:wave with the right hand" and first["planner"]["sample_ms"]["max"] > 0.0
    assert dry_run(*asked) == 0
    second = json.loads(capsys.readouterr().out)
    assert [key for key in first if first[key] != second[key] and key not in TIMING_KEYS] == []
    # The log names the bundle, and a replay samples the same motion from it.
    assert execute(["log", "replay", str(tmp_path / "run.mcap"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["equal"] is True


def test_without_options_the_shipped_model_plays_the_shipped_script(
    bundle: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    op3 = load_robot("op3")
    monkeypatch.setattr("flexmotion.bundles.shipped.FOLDER", bundle)
    source = choose_source(op3, seed=2)
    assert isinstance(source, ModelSource) and source.name == "model:default" and source.seed == 2
    assert source.seconds is not None and 15.0 <= source.seconds <= 25.0
    intents = [item.intent for item in source.items]
    assert Text("walk forward") in intents and Text("turn left") in intents
    assert choose_source(op3, prompt="wave").seconds == 10.0
    assert choose_source(op3, prompt="wave", seconds=30.0).seconds == 30.0
    assert choose_source(op3, prompt="wave", endless=True).seconds is None
    monkeypatch.setattr("flexmotion.bundles.shipped.FOLDER", tmp_path)
    assert choose_source(op3).name == "default" and choose_source(op3, seconds=1.0).seconds == pytest.approx(1.0)


def test_a_motion_slowed_to_the_robots_speed_is_reported_and_replayed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Velocities that a robot cannot follow were requested without a note; the robot came a third of the way."""
    script = tmp_path / "fast.yaml"
    script.write_text("- {at: 0, velocity: [2, 0, 0]}\n- {at: 2, text: stand still}\n- {at: 3, stop: true}\n")
    assert dry_run("--script", str(script), "--json", "--log", str(tmp_path / "run.mcap")) == 0
    found = capsys.readouterr()
    assert "note: velocity [2, 0, 0] is slowed to a human's 0.9 m/s ahead, so that the robot can follow" in found.err
    assert execute(["log", "show", str(tmp_path / "run.mcap")]) == 0
    assert "is slowed to a human's 0.9 m/s ahead" in capsys.readouterr().out.replace("\n", " ")
    assert "stand still" not in found.err and json.loads(found.out)["motion"]["human_went"]["ahead_m"] < 0.7
    assert execute(["log", "replay", str(tmp_path / "run.mcap"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["equal"] is True


def test_a_log_can_be_read_where_its_bundle_is_not(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = shutil.copytree(bundle, tmp_path / "bundle")
    log = tmp_path / "run.mcap"
    dry_run("--prompt", "stand", "--bundle", str(copy), "--seconds", "0.5", "--log", str(log))
    shutil.rmtree(copy)
    capsys.readouterr()
    assert execute(["log", "show", str(log), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["source"] == "prompt:stand"
    assert execute(["log", "replay", str(log)]) == 2
    assert "no bundle there" in capsys.readouterr().err


@pytest.mark.parametrize(("asked", "code"), [("stand", 0), ("fly to the moon", 1)])
def test_who_is_asked_to_stand_needs_no_plans(
    asked: str, code: int, bundle: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A prompt to stand, or one that was refused, ended after 5 s in the fault "planner: no plan for 5 s"."""
    assert dry_run("--prompt", asked, "--bundle", str(bundle), "--seconds", "7", "--json") == code
    safety = json.loads(capsys.readouterr().out)["safety"]
    assert safety["faults"] == [] and safety["final_state"] == "OFF"


def test_a_damaged_bundle_is_one_line(bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    copy = shutil.copytree(bundle, tmp_path / "bundle")
    (copy / "denoiser.onnx").write_bytes(b"no network")
    for command in (["dry-run", "--prompt", "wave"], ["check", "torque"], ["check", "latency"]):
        assert execute([*command, "--bundle", str(copy)]) == 2
        error = capsys.readouterr().err
        assert "denoiser.onnx: differs from the manifest (hash)" in error and error.count("\n") == 1


def test_a_new_wording_is_reported_with_the_prompt_it_is_taken_for(
    bundle: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """For "do a backflip" the robot walked backward, and no message said why."""
    dry_run("--prompt", "please walk on ahead of you", "--bundle", str(bundle), "--seconds", "0.5", "--json")
    told = capsys.readouterr().err
    sampler = Sampler(Bundle(bundle))
    heard = sampler.prompt("please walk on ahead of you")
    assert heard.known and f"'please walk on ahead of you' is heard as {heard.kind}" in told


def test_words_that_look_like_markup_do_not_end_a_run(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A closing tag in a note raised in the middle of a run, and the robot was parked."""
    log = tmp_path / "run.mcap"
    words = "please stand where you are [/] [fast]"
    assert dry_run("--prompt", words, "--bundle", str(bundle), "--seconds", "0.5", "--log", str(log)) == 0
    assert f"{words!r} is heard as stand" in capsys.readouterr().err
    assert execute(["log", "show", str(log)]) == 0
    assert "[/] [fast]" in capsys.readouterr().out


def test_words_without_meaning_are_reported_before_the_robot_moves(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "talk.yaml"
    script.write_text("- {at: 0, text: xyzzy plugh qwrtzp}\n- {at: 0.5, stop: true}\n")
    dry_run("--script", str(script), "--bundle", str(bundle), "--json")
    out, err = capsys.readouterr()
    assert json.loads(out)["source"] == "script:talk.yaml"
    said = "note: 'xyzzy plugh qwrtzp' is not understood by this model (it hears English), it stands still; try: "
    assert said in err


def test_a_refused_prompt_does_not_pass_and_the_report_says_why(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A dry run whose prompt was refused printed PASS, and its JSON did not say what was heard."""
    asked = ["--prompt", "throw a punch", "--bundle", str(bundle), "--seconds", "0.5"]
    assert dry_run(*asked, "--json", "--report", str(tmp_path)) == 1
    (answer,) = json.loads(capsys.readouterr().out)["targets"]
    assert (answer["asked"], answer["state"], answer["heard_as"]) == ("throw a punch", "refused", None)
    assert "this model cannot punch yet" in answer["reason"]
    assert dry_run(*asked) == 1
    told = capsys.readouterr().out.replace("\n", " ")
    assert "FAIL" in told and "refused: 'throw a punch'" in told
    assert dry_run(*asked, "--allow-refused", "--json") == 0
    assert json.loads(capsys.readouterr().out)["options"]["allow_refused"] is True
    # The log holds the answer too.
    assert execute(["log", "show", str(tmp_path / "run.mcap"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["heard"][0]["state"] == "refused"


def test_a_part_that_is_dropped_does_not_pass_either(bundle: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        dry_run("--prompt", "walk two steps to the kitchen", "--bundle", str(bundle), "--seconds", "0.5", "--json") == 1
    )
    (answer,) = json.loads(capsys.readouterr().out)["targets"]
    assert answer["state"] == "partly" and answer["dropped"] == ["to the kitchen"] and answer["certainty"] > 0.45


def test_a_sequence_ends_when_the_robot_has_done_it(bundle: Path, capsys: pytest.CaptureFixture[str]) -> None:
    prompt = "wait for one second, then turn 45 degrees to the left"
    assert dry_run("--prompt", prompt, "--bundle", str(bundle), "--json") == 0
    report = json.loads(capsys.readouterr().out)
    wait, turn = report["targets"][0]["steps"]
    assert wait["end"] == turn["end"] == "done" and wait["measured"] == pytest.approx(1.0, abs=0.05)
    # What the robot's own odometry says is what the simulation says.
    went = report["motion"]["robot_went"]
    assert abs(went["turned_rad"] - np.pi / 4) < np.radians(15.0)
    assert turn["measured"] == pytest.approx(went["turned_rad"], abs=np.radians(10.0))
    assert report["duration_s"] < 30.0 and report["motion"]["human_went"] is None


def test_a_session_answers_each_target(bundle: Path) -> None:
    with open_session("op3", source=open_source(load_robot("op3"), Text("stand still"), bundle=bundle)) as run:
        run.advance(5.0)
        first = run.send(Text("two steps back"))
        run.advance(0.5)
        second = run.send(Text("throw a punch"))
        run.advance(0.5)
        answers = {heard.id: heard for heard in run.heard}
        run.finish()
    assert answers[0].asked == "stand still" and answers[0].state == "accepted"
    assert answers[first.id].heard_as == "walk-back" and answers[first.id].steps[0].end == "superseded"
    assert answers[second.id].state == "refused" and answers[second.id].tick is not None


def test_slower_and_faster_change_how_fast_the_shipped_robot_walks(bundle: Path) -> None:
    """Went wrong: "faster" of a human at .74 m/s was .9, with the robot at .177 m/s before and after.

    What hearing takes for the robot's own speed (`gait.pace.reached`) is that of the shipped robot file, so it is the
    robot that is measured: with four seeds .22 to .24, .09 to .15 and .17 to .22 m/s.
    """
    robot = load_robot("op3")
    assert robot.gait.pace is not None and robot.gait.pace.reached is not None
    speeds = list[float]()
    source = open_source(robot, Text("stand still"), bundle=bundle, seed=1)
    with open_session(robot, source=source, seed=1) as run:
        for words in ("walk forward", "slower", "faster"):
            run.send(Text(words))
            run.advance(5.0)  # until the robot is at it
            begin = run.state.torso[:2].copy()
            run.advance(4.0)
            speeds.append(float(np.hypot(*(run.state.torso[:2] - begin))) / 4.0)
    walk, slower, faster = speeds
    assert walk == pytest.approx(robot.gait.pace.reached, rel=0.2)
    assert slower < 0.8 * walk and faster > 1.25 * slower
