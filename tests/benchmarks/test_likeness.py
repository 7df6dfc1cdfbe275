"""Figures and verdicts of the benchmark of likeness, and its two lists of clips."""

from __future__ import annotations

import hashlib

from benchmarks.robot.likeness import LISTS, LikenessRun, figures_of, verdicts
from benchmarks.shared.clips import ClipList, ListedClip
from benchmarks.shared.likeness_figures import LikenessFigures


def run(kind: str = "gestures", *, upper: float = 10.0, swings: int = 0, pitch: float = 40.0) -> LikenessRun:
    figures = LikenessFigures(upper, 12.0, swings, pitch, 50.0, 50.0)
    return LikenessRun(ListedClip(kind, "clip", 0), figures, upright=True, plan_ms=10.0, self_collisions=1)


def test_figures_are_means_over_runs_and_sums_of_events() -> None:
    found = figures_of([run(upper=10.0, swings=1), run(upper=20.0, swings=2)])
    assert found["upper_arm_deg"] == 15.0 and found["spurious_swings"] == 3 and found["self_collisions"] == 2
    assert found["pitch_share"] == 0.8


def test_gestures_alone_are_judged_by_direction_and_all_by_swings() -> None:
    assert all(verdict.holds for verdict in verdicts([run(pitch=45.0), run("walks", upper=60.0, pitch=45.0)]))
    failed = [v.sentence.split(":")[0] for v in verdicts([run(upper=21.0), run("walks", swings=1)]) if not v.holds]
    assert failed == ["upper arms of gestures", "spurious swings", "pitch of the trunk over what balance allows"]


def test_the_lists_are_apart_by_the_hash_of_the_name() -> None:
    for half, (first, last) in {"tuning": ("0", "7"), "reporting": ("8", "f")}.items():
        clips = ClipList(LISTS[half]).clips
        digits = {hashlib.sha256(clip.name.encode()).hexdigest()[0] for clip in clips}
        assert clips and all(first <= digit <= last for digit in digits)
