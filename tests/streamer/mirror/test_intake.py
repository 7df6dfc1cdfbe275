"""What the operator is told of frames that are left out."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from benchmarks.shared.wire import SENDER
from flexmotion.importers.live_person import REASONS
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.mirror.clip_frames import clip_frames
from flexmotion.streamer.mirror.intake import Intake
from flexmotion.streamer.motion.person_channel import PersonChannel
from flexmotion.streamer.run.requests import Request, RequestChannel
from tests.streamer.mirror.mirror_frames import nested_bundle, raw_bundle, shipped

OTHER = ("127.0.0.1", 50001)
Frame = dict[str, Any]


@pytest.fixture(scope="module")
def frames() -> list[tuple[float, Frame]]:
    return [(at, json.loads(datagram)) for at, datagram in clip_frames(shipped(1.0))]


def without_knee(frame: Frame) -> Frame:
    return {**frame, "joints": {**frame["joints"], "left_knee": None}}


def in_millimetres(frame: Frame) -> Frame:
    return {**frame, "joints": {name: [1e3 * value for value in at] for name, at in frame["joints"].items()}}


def without_up(frame: Frame) -> Frame:
    return {name: value for name, value in frame.items() if name != "up"}


@pytest.mark.parametrize(
    ("change", "reason", "word"),
    [
        (without_knee, "a leg is not seen", "knees"),
        (in_millimetres, "no human", "units"),
        (without_up, "not upright", "`up`"),
    ],
)
def test_frames_that_are_left_out_are_named_once_and_say_what_would_be_right(
    frames: list[tuple[float, Frame]], change: Callable[[Frame], Frame], reason: str, word: str
) -> None:
    """Whoever sent millimetres, or the wrong axis up, saw a robot that stood, and no word of why."""
    notes: list[str] = []
    intake = Intake(Admission(), PersonChannel(), on_note=notes.append)
    for at, frame in frames:
        intake.take(json.dumps(change(frame)).encode(), SENDER, at)
    assert intake.person.refused[reason] == len(frames)
    (note,) = [note for note in notes if "left out" in note]
    assert reason in note and word in note and REASONS[reason] in note


@pytest.mark.parametrize(
    "datagram",
    [
        nested_bundle(600),
        raw_bundle(b"", sizes=(-4,)),
        b'{"joints": {"a": [1%b, 0, 0]}}' % (b"0" * 400),
        b'{"joints": {"a": [1, 0, 0]}, "t": 1%b}' % (b"0" * 400),
        b'{"joints": {"\\ud800": 1}}',
    ],
)
def test_a_datagram_that_nobody_can_read_is_counted_and_named(datagram: bytes) -> None:
    """One datagram ended the process that receives, or kept it busy for ever: the person was gone for the whole run."""
    channel = RequestChannel()
    told = channel.reader()
    intake = Intake(Admission(), PersonChannel(), on_note=lambda note: channel.send(Request.NOTE, note))
    intake.take(datagram, SENDER, 1.0)
    assert intake.unreadable == 1
    ((_, note),) = told.read()
    assert f"a datagram from {SENDER[0]} is no frame" in note


def test_what_the_reader_fails_at_is_told_and_the_next_frame_is_read(
    frames: list[tuple[float, Frame]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error in the library that reads OSC ended the process that receives."""
    notes: list[str] = []
    intake = Intake(Admission(), PersonChannel(), on_note=notes.append)

    def fails(_reader: object, _datagram: bytes) -> list[Any]:
        raise RecursionError("too deep")

    with monkeypatch.context() as patch:
        patch.setattr("flexmotion.streamer.mirror.vmc.VmcReader.take", fails)
        intake.take(b"/VMC", SENDER, 1.0)
    assert intake.unreadable == 1
    assert notes == [f"mirror: a datagram from {SENDER[0]} cannot be read: RecursionError: too deep"]
    intake.take(json.dumps(frames[0][1]).encode(), SENDER, 1.1)
    assert "frames (joints)" in notes[-1]


def test_a_second_sender_is_named_once(frames: list[tuple[float, Frame]]) -> None:
    notes: list[str] = []
    intake = Intake(Admission(), PersonChannel(), on_note=notes.append)
    for at, frame in frames:
        for sender in (SENDER, OTHER):
            intake.take(json.dumps(frame).encode(), sender, at)
    assert sum("second sender" in note for note in notes) == 1


def test_the_person_is_told_once_measured() -> None:
    """Nothing was told where each frame brought one pose, as over a wire that loses none."""
    notes: list[str] = []
    intake = Intake(Admission(), PersonChannel(), on_note=notes.append)
    for at, datagram in clip_frames(shipped(3.0)):
        intake.take(datagram, SENDER, at)
    assert sum("is measured" in note for note in notes) == 1


def test_the_operator_is_told_what_of_the_person_was_not_seen_yet() -> None:
    """Nothing told why a person with one hand out of the picture was not followed."""
    notes: list[str] = []
    intake = Intake(Admission(), PersonChannel(), on_note=notes.append)
    for at, datagram in clip_frames(shipped(3.0)):
        frame = json.loads(datagram)
        frame["joints"]["left_wrist"] = None
        intake.take(json.dumps(frame).encode(), SENDER, at)
    (note,) = [note for note in notes if "is measured" in note]
    assert note.endswith("without what is not seen yet: left_wrist")
