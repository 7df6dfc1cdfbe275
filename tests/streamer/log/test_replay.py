"""Replays of logs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace as changed
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import load_robot
from flexmotion.human.motion_file import save_motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.api import open_source
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.log.judged import Subject
from flexmotion.streamer.log.reader import Log, read_log
from flexmotion.streamer.log.replay import Compared, Replay, _compare, _requests, replay
from flexmotion.streamer.log.source import pack, unpack
from flexmotion.streamer.motion.clip_library import ClipLibrary
from flexmotion.streamer.motion.intents import Clip, Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.part_intents import FootPlace, Hand, HeadPlace, JointAngle, Look, Relax
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.restriction_intents import Contact, Tension, TorqueCap
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.run.requests import Request


@pytest.fixture(scope="module")
def log(logged: Any) -> Log:
    return read_log(logged.path)


def test_a_lockstep_log_with_a_target_and_a_request_replays_bit_for_bit(log: Log) -> None:
    shares: list[float] = []
    result = replay(log, Subject.of(log), shares.append)
    assert result.differing == []
    assert result.agrees and all(figure.difference in (None, 0.0) for figure in result.figures)
    assert shares[-1] == 1.0 and sorted(shares) == shares


def test_a_log_is_replayed_after_the_folder_of_its_robot_is_gone(log: Log, tmp_path: Path) -> None:
    """It was refused as of an unknown robot, although the log holds the robot's files."""
    gone = changed(log, header=log.header.model_copy(update={"robot": str(tmp_path / "op3")}), rows=log.rows[:150])
    subject = Subject.of(gone)
    assert subject.robot.joint_names == log.header.joints and log.changed_files(subject.robot) == []
    assert replay(gone, subject).differing == []
    with pytest.raises(
        ConfigError, match="there is no robot '.*op3' any more, and its files in the log are not enough"
    ):
        Subject.of(changed(gone, files={}))


def test_a_log_that_ends_early_is_compared_as_far_as_it_goes(log: Log) -> None:
    early = changed(log, rows=log.rows[:300], whole=False)
    result = replay(early, Subject.of(early))
    assert result.differing == [] and result.agrees


def test_the_replay_of_a_log_that_was_cut_off_ends_where_the_log_does(log: Log) -> None:
    """A live run's log that lacked the request for the end was replayed for ever, since its source follows targets."""
    early = changed(log, rows=log.rows[:300], events=[], whole=False)
    assert log.header.seconds is None
    shares: list[float] = []

    def count(share: float) -> None:
        shares.append(share)
        assert len(shares) < 2 * len(early.rows), "it goes on after the log's end"

    assert replay(early, Subject.of(early), count).differing == []


def test_another_seed_is_another_run(log: Log) -> None:
    other = changed(log, header=log.header.model_copy(update={"seed": 9}), rows=log.rows[:150])
    result = replay(other, Subject.of(other))
    assert {"q", "gyro"} <= set(result.differing)


def test_a_log_without_its_beginning_or_its_source_cannot_be_replayed(log: Log) -> None:
    subject = Subject.of(log)
    with pytest.raises(ConfigError, match="cannot be replayed, its first ticks are missing"):
        replay(changed(log, rows=log.rows[5:]), subject)
    model = log.header.model_copy(update={"source_parts": {"kind": "Cinema"}})
    with pytest.raises(
        ConfigError, match="a source of kind 'Cinema' is not kept in a log, expected clips, a model, a mirror"
    ):
        replay(changed(log, header=model), subject)
    with pytest.raises(ConfigError, match="source clips: the log lacks 'source/"):
        changed(log, files={}).source()


@pytest.mark.parametrize(
    ("logged_value", "replayed", "tolerance", "agrees"),
    [
        (1.0, 1.05, 0.1, True),
        (1.0, 1.2, 0.1, False),
        (1.0, 9.0, None, True),
        (None, 1.0, 0.0, True),
        (1.0, None, 0.1, False),
    ],
)
def test_figures_agree_within_their_tolerance(
    logged_value: float | None, replayed: float | None, tolerance: float | None, agrees: bool
) -> None:
    assert Compared("lag_s", logged_value, replayed, tolerance).agrees is agrees


@pytest.mark.parametrize(("aside", "agree"), [(0.05, True), (0.12, False)])
def test_runs_that_went_elsewhere_do_not_agree(log: Log, aside: float, agree: bool) -> None:
    """Of a live run that went .29 m to the left, and whose replay went .17 m, the last line was "the runs agree"."""
    logged = Subject.of(log).report(log, log.record())
    went = logged.motion.robot_went
    assert went is not None
    elsewhere = went.model_copy(update={"left_m": went.left_m + aside})
    replayed = logged.model_copy(update={"motion": logged.motion.model_copy(update={"robot_went": elsewhere})})
    assert Replay(_compare(logged, replayed, exact=False), ["q"]).agrees is agree


def test_a_noisy_source_comes_back_as_it_was(log: Log) -> None:
    noisy = NoisySource(log.source(), 0.05, 7)
    again = unpack(*pack(noisy), log.path)
    before, after = noisy.window(10, 30), again.window(10, 30)
    assert before is not None and after is not None
    np.testing.assert_array_equal(after.joints, before.joints)
    assert again.name == noisy.name and again.fps == noisy.fps


def test_a_model_comes_back_with_the_clips_that_targets_may_name(bundle: Path, tmp_path: Path) -> None:
    """They were not in the log: a clip that the run followed was refused in its replay."""
    save_motion(default_clip()[225:285], tmp_path / "steps.npz")
    clips = [tmp_path / "steps.npz"]
    source = open_source(load_robot("op3"), Text("stand still"), bundle=bundle, clips=clips)
    parts, files = pack(source)
    windows = []
    for one in (source, unpack(parts, files, tmp_path)):
        assert isinstance(one, ModelSource) and one.clips == ("steps.npz",)
        one.turn_to(Target(1, 0, Clip("steps.npz")), 0, None)
        windows.append(one.window(0, 40))
    before, after = windows
    assert before is not None and after is not None
    np.testing.assert_array_equal(after.joints, before.joints)
    np.testing.assert_array_equal(after.root_position, before.root_position)
    with pytest.raises(ConfigError, match=r"source model: the log lacks 'source/steps\.npz\.npz'"):
        unpack(parts, {}, tmp_path)
    del parts["clips"]
    former = unpack(parts, {}, tmp_path)
    assert isinstance(former, ModelSource) and former.clips == ()


def test_requests_for_single_joints_are_made_again_with_their_joints(log: Log) -> None:
    """Their names made no request of the event, and a replay left them out."""
    asked = [Event(40, "request", "LIMP l_el,head_pan"), Event(90, "request", "STOP"), Event(91, "request", "of old")]
    made = _requests(changed(log, events=asked))
    assert made == [(40, Request.LIMP, "l_el,head_pan"), (90, Request.STOP, "")]


def test_requests_of_one_tick_are_made_in_one_tick_again(logged_session: Callable[..., Any], tmp_path: Path) -> None:
    """A replay made one request a tick: a CLEAR in the tick of a STOP does not release it, a tick later it did."""
    made = logged_session(tmp_path / "together.mcap", stay=True)
    with made.session as session:
        session.advance(1.5)
        session.ask(Request.STOP)
        session.advance(1.5)
        for request in (Request.STOP, Request.CLEAR):
            session.ask(request)
        session.advance(0.5)
        session.finish()
    log = read_log(made.path)
    assert [event.tick for event in log.events if event.message in ("STOP", "CLEAR")] == [188, 376, 376]
    assert replay(log, Subject.of(log)).differing == []


def test_a_run_that_is_armed_disarmed_and_armed_again_is_the_same_run_again(
    logged_session: Callable[..., Any], tmp_path: Path
) -> None:
    """Torque went on with the first tick of the replay, which ended where the robot was first disarmed."""
    made = logged_session(tmp_path / "armed.mcap", armed=False, attended=True, stay=True)
    with made.session as session:
        for request, seconds in ((Request.ARM, 1.0), (Request.DISARM, 3.5), (Request.ARM, 0.5)):
            session.advance(0.1)
            session.ask(request)
            session.advance(seconds)
        assert session.state.ladder is not State.OFF
        session.finish()
    log = read_log(made.path)
    assert (log.header.armed, log.header.attended, log.header.stay) == (False, True, True)
    assert log.rows["state"][5] == State.OFF
    assert replay(log, Subject.of(log)).differing == []


def test_a_stepped_run_that_stands_on_after_its_clip_does_so_again(
    logged_session: Callable[..., Any], tmp_path: Path
) -> None:
    """Whether the robot stays was known once the run had begun, and no log held it: the replay ended with the clip."""
    made = logged_session(tmp_path / "stay.mcap", ClipLibrary({"wave": default_clip()[:30]}, "wave"))
    with made.session as session:
        session.advance(5.0)
        session.finish()
    log = read_log(made.path)
    assert log.header.stay is True
    assert replay(log, Subject.of(log)).differing == []


def test_targets_for_hands_and_head_are_followed_again(logged_session: Callable[..., Any], tmp_path: Path) -> None:
    made = logged_session(tmp_path / "parts.mcap")
    session = made.session
    asked = {200: Hand("left", (0.12, 0.12, 0.05), 0.7), 230: Look((1.0, 0.3, -0.2)), 260: JointAngle("r_el", 0.6)}

    def operate() -> Request | None:
        tick = 0 if session.loop is None else session.loop.tick_count
        if tick in asked:
            session.targets.send(asked.pop(tick), holds_s=2.0)
        return Request.END if tick == 400 else None

    session.next_request = operate
    session.run()
    log = read_log(made.path)
    assert [next(word for word in ("hand", "look", "joint") if word in one) for one in log.targets] == [
        "hand",
        "look",
        "joint",
    ]
    assert replay(log, Subject.of(log)).differing == []


def test_a_foot_is_placed_again(logged_session: Callable[..., Any], tmp_path: Path) -> None:
    made = logged_session(tmp_path / "feet.mcap")
    session = made.session
    asked = {200: FootPlace("left", (0.05, 0.1), 0.1, 1.0), 420: Relax("left foot")}

    def operate() -> Request | None:
        tick = 0 if session.loop is None else session.loop.tick_count
        if tick in asked:
            session.targets.send(asked.pop(tick))
        return Request.END if tick == 560 else None

    session.next_request = operate
    session.run()
    log = read_log(made.path)
    assert [set(one) & {"foot", "relax"} for one in log.targets] == [{"foot"}, {"relax"}]
    assert (~session.record.ticks.contact_ref[:, 0]).any(), "no step was made"
    assert replay(log, Subject.of(log)).differing == []


def test_a_head_is_brought_to_its_place_again(logged_session: Callable[..., Any], tmp_path: Path) -> None:
    made = logged_session(tmp_path / "head.mcap", ClipLibrary({"wave": default_clip()[:150]}, "wave"))
    session = made.session
    asked = {200: HeadPlace((0.04, None, 0.4), 0.8), 380: Relax("head place")}

    def operate() -> Request | None:
        tick = 0 if session.loop is None else session.loop.tick_count
        if tick in asked:
            session.targets.send(asked.pop(tick))
        return Request.END if tick == 560 else None

    session.next_request = operate
    session.run()
    log = read_log(made.path)
    assert [set(one) & {"head", "relax"} for one in log.targets] == [{"head"}, {"relax"}]
    heights = dict(zip(session.record.ticks.tick, session.record.ticks.true_base[:, 2], strict=True))
    assert heights[370] < heights[555] - 0.03, "the robot did not crouch, or did not rise"
    assert replay(log, Subject.of(log)).differing == []


def test_feet_that_stay_torque_caps_and_soft_arms_are_kept_again(
    logged_session: Callable[..., Any], tmp_path: Path
) -> None:
    made = logged_session(tmp_path / "restrictions.mcap")
    session = made.session
    asked = {
        150: TorqueCap("left elbow", 0.4),
        200: Hand("left", (0.12, 0.12, 0.05), 0.3),
        230: Contact("both"),
        280: Tension("both arms", 0.1),
        330: Relax("both feet"),
    }

    def operate() -> Request | None:
        tick = 0 if session.loop is None else session.loop.tick_count
        if tick in asked:
            session.targets.send(asked.pop(tick))
        return Request.END if tick == 420 else None

    session.next_request = operate
    session.run()
    log = read_log(made.path)
    known = ("hand", "contact", "torque", "tension", "relax")
    words = [next(word for word in known if word in one) for one in log.targets]
    assert words == ["torque", "hand", "contact", "tension", "relax"]
    assert replay(log, Subject.of(log)).differing == []
