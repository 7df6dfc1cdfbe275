"""The judges of `mirror/clips` and the wire."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.mirror.clips import feet_delays, foreseen_errors, held_out, lifts, paired
from benchmarks.shared.wire import over_the_wire
from flexmotion.configs.errors import ConfigError
from flexmotion.human.contacts import ContactDetector
from flexmotion.human.kinematics import forward
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.motion.prediction import HeldSpeed

FRAMES = [(0.033 * number, bytes([number])) for number in range(200)]


def test_the_wire_loses_and_reorders_as_it_is_told() -> None:
    arrive = over_the_wire(FRAMES, begin_s=2.0, lost=0.2, jitter_s=0.03, seed=0)
    assert 140 < len(arrive) < 180
    assert [at for at, _ in arrive] == sorted(at for at, _ in arrive)
    numbers = [datagram[0] for _, datagram in arrive]
    assert numbers != sorted(numbers) and all(
        at >= 2.0 + 0.033 * number for (at, _), number in zip(arrive, numbers, strict=True)
    )
    assert over_the_wire(FRAMES, begin_s=2.0, lost=0.2, jitter_s=0.03, seed=0) == arrive


def test_only_held_out_files_are_taken(tmp_path: Path) -> None:
    names = [f"clip_{number}.bvh" for number in range(100)]
    for name in names:
        (tmp_path / name).touch()
    found = held_out(tmp_path, 100)
    assert 2 <= len(found) <= 25
    assert held_out(tmp_path, 2) == [found[0], found[-1]]
    with pytest.raises(ConfigError, match="no held-out"):
        held_out(tmp_path / "none", 1)


def test_the_robots_steps_are_those_of_the_human_somewhat_later() -> None:
    motion = default_clip()[225:330]
    contacts, _ = ContactDetector().detect(forward(motion), motion.fps)
    human = lifts(contacts, motion.fps, 0.2)
    assert len(human) >= 2
    record = RunTrace(rate_hz=125.0, joint_names=("a",))
    record.append(blank(TickRow.dtype(joints=1), 125 * 6))
    record.source_s[:] = np.arange(len(record.source_s)) / 125.0
    record.contact_ref[:] = True
    for side, at in human[1:]:
        lift = round((1.0 + at + 0.3) * 125)
        record.contact_ref[lift : lift + 20, side] = False
    delays, dropped = feet_delays(motion, record, 1.0)
    assert feet_delays(default_clip()[100:130], record, 1.0) == ([], 0)  # no steps
    assert dropped == 1 and delays == pytest.approx([0.3] * (len(human) - 1), abs=0.01)


def test_each_step_of_the_robot_is_of_one_of_the_human() -> None:
    # A robot that stepped ever sooner than its human was called .79 s late: one step was .203 s early, where the
    # measure ended, and the next one was taken for it.
    sooner = paired([4.57, 5.63, 6.73, 7.83], [4.54, 5.55, 6.527, 7.52, 8.51])
    assert sooner == pytest.approx([-0.03, -0.08, -0.203, -0.31])
    assert paired([1.0, 2.1, 3.2], [1.9, 3.0, 4.1]) == pytest.approx([0.9] * 3)  # and not the next one, early
    assert paired([1.0, 2.0], [2.1]) == pytest.approx([0.1])
    assert paired([0.908, 1.819], [1.831, 1.943]) == pytest.approx([0.923, 0.124])  # in their order
    assert paired([1.0], [0.5, 2.3]) == [] and paired([], [1.0]) == [] and paired([1.0], []) == []


def test_an_even_motion_is_foreseen_by_its_speed() -> None:
    still = default_clip()[:60]
    even = replace(
        still,
        root_position=np.linspace(0.0, 1.0, 60)[:, None] * [1.0, 0.0, 0.0],
        root_quaternion=np.tile(still.root_quaternion[:1], (60, 1)),
        joints=np.tile(still.joints[:1], (60, 1)),
    )
    errors = foreseen_errors(even, HeldSpeed(even.fps, dies_s=1e3))
    assert len(errors) and errors.max() < 0.01
    assert foreseen_errors(even, HeldSpeed(even.fps, dies_s=0.1))[:, -1].min() > 0.2


def test_predictors_of_other_histories_are_compared_at_the_same_moments() -> None:
    # The model was asked from frame 11 on, held speed from frame 4 on: their ratio was of other moments.
    clip = default_clip()[:80]
    short, long = HeldSpeed(clip.fps), HeldSpeed(clip.fps)
    long.remembers = 19
    errors = [foreseen_errors(clip, predictor, first=19) for predictor in (short, long)]
    np.testing.assert_array_equal(errors[0], errors[1])
    assert len(errors[0]) and len(foreseen_errors(clip, short)) > len(errors[0])
