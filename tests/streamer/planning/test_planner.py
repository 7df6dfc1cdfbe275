from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from flexmotion.configs.errors import MotionFormatError
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.estimator import yaw_of
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.planning.planner import Planner

RETARGETER = Retargeter(load_robot("op3"), load_stream())
CLIP = default_clip()[225:330]


class RecordingSource(ClipSource):
    """Records the windows that were requested."""

    def __init__(self, motion: Motion) -> None:
        super().__init__(motion)
        self.windows: list[tuple[int, int]] = []

    def window(self, first_frame: int, frames: int) -> Motion | None:
        self.windows.append((first_frame, frames))
        return super().window(first_frame, frames)


@pytest.fixture
def source() -> RecordingSource:
    return RecordingSource(CLIP)


@pytest.fixture
def planner(source: RecordingSource) -> Planner:
    return Planner(RETARGETER, source, load_stream())


def test_without_a_plan_that_plays_it_starts_from_the_stand_pose(planner: Planner) -> None:
    planned = planner.plan(40, None)
    assert planned.plan.start_tick == 40 and not planned.source_over
    np.testing.assert_allclose(planned.plan.q[0], RETARGETER.layout.view(RETARGETER.standing()).q[0], atol=6e-3)
    assert planned.retarget_s > 0.0 and planned.sample_s >= 0.0


def test_each_plan_resumes_the_one_before(planner: Planner) -> None:
    current = planner.plan(0, None).plan
    for join in (31, 62, 93):
        later = planner.plan(join, current).plan
        np.testing.assert_allclose(later.q[0], current.q[join - current.start_tick], atol=1e-3)
        current = later


def test_a_window_that_disagrees_is_blended_in(source: RecordingSource) -> None:
    """The robot's pose and speed are continuous over the join, although the human jumps."""
    planner = Planner(RETARGETER, source, load_stream())
    current = planner.plan(0, None).plan
    moved = replace(CLIP, root_position=CLIP.root_position + [0.0, 0.1, 0.0], joints=CLIP.joints + 0.1)
    after = Planner(RETARGETER, ClipSource(moved), load_stream()).plan(150, current).plan
    assert current.human is not None and after.human is not None
    first = after.human_first_frame
    np.testing.assert_allclose(after.human.joints[:2], CLIP.joints[first : first + 2], atol=1e-12)
    np.testing.assert_allclose(after.human.joints[9:], moved.joints[first + 9 : first + len(after.human)], atol=1e-12)
    bare = replace(current, human=None)
    abrupt = Planner(RETARGETER, ClipSource(moved), load_stream()).plan(150, bare).plan
    assert abrupt.human is not None
    np.testing.assert_allclose(abrupt.human.joints[0], moved.joints[first], atol=1e-12)


@pytest.fixture(scope="module")
def redrawn() -> list[Plan]:
    """Plans of a whole walk whose windows are each off by 5 cm after a second, joined every 250 ms."""
    planner = Planner(RETARGETER, NoisySource(ClipSource(default_clip()), 0.05, 1), load_stream())
    planned = planner.plan(0, None)
    plans = [planned.plan]
    while not planned.source_over:
        planned = planner.plan(plans[-1].start_tick + 31, plans[-1])
        plans.append(planned.plan)
    return plans


def test_joins_of_plans_that_disagree_move_the_dcm_by_less_than_three_millimetres_a_tick(redrawn: list[Plan]) -> None:
    for old, new in itertools.pairwise(redrawn):
        rows = new.start_tick - old.start_tick + np.arange(19)
        apart = new.dcm[:19] - old.dcm[np.minimum(rows, len(old) - 1)]
        assert np.linalg.norm(np.diff(apart, axis=0, prepend=np.zeros((1, 2))), axis=1).max() < 3e-3


def test_a_settled_step_is_not_changed(redrawn: list[Plan]) -> None:
    settled = 0
    for old, new in itertools.pairwise(redrawn):
        for step in old.steps:
            if new.start_tick >= step.lift - step.notice_s * RETARGETER.rate and new.start_tick < step.land:
                (same,) = [s for s in RETARGETER.layout.view(new.states[0]).steps.steps() if s.side == step.side]
                assert (same.lift, same.land) == (step.lift, step.land)
                np.testing.assert_array_equal(same.target, step.target)
                settled += 1
    assert settled > 10


def test_it_requests_a_horizon_from_the_frame_at_or_before_the_join(planner: Planner, source: RecordingSource) -> None:
    current = planner.plan(0, None).plan
    planner.plan(125, current)
    lead = round(load_stream().lead_in_s * 125)
    assert source.windows == [(0, 32), (int((125 - lead) / 125 * 30), 32)]


def test_a_stop_requests_no_frames_and_stands(planner: Planner, source: RecordingSource) -> None:
    current = planner.plan(0, None).plan
    asked = len(source.windows)
    stop = planner.plan(31, current, stop=True).plan
    assert len(source.windows) == asked
    assert stop.stop_row == 0 and stop.contacts[-1].all()


def test_the_plan_that_reaches_the_end_of_the_source_says_so(planner: Planner) -> None:
    planned, joins = planner.plan(0, None), 0
    while not planned.source_over:
        joins += 31
        planned = planner.plan(joins, planned.plan)
    np.testing.assert_allclose(np.nanmax(planned.plan.source_s), CLIP.duration, atol=1 / 125)


def test_a_clip_shorter_than_the_first_plan_is_followed_to_its_end() -> None:
    """The first plan follows less than a second of the source, because of the lead-in: a clip of one second was cut."""
    short = CLIP[:31]
    planner = Planner(RETARGETER, ClipSource(short), load_stream())
    planned = planner.plan(0, None)
    while not planned.source_over:
        planned = planner.plan(planned.plan.start_tick + 31, planned.plan)
    np.testing.assert_allclose(np.nanmax(planned.plan.source_s), short.duration, atol=1 / 125)


@pytest.mark.parametrize("join", [-5, 10**6])
def test_a_join_outside_the_plan_takes_its_nearest_row(planner: Planner, join: int) -> None:
    current = planner.plan(0, None).plan
    stop = planner.plan(join, current, stop=True).plan
    nearest = current.q[0 if join < 0 else -1]
    np.testing.assert_allclose(stop.q[0], nearest, atol=6e-3)


def test_a_clip_of_one_frame_is_refused() -> None:
    with pytest.raises(MotionFormatError, match="needs at least two"):
        ClipSource(CLIP[:1])


def test_a_cut_clip_keeps_its_name_and_its_first_seconds() -> None:
    source = ClipSource(CLIP)
    cut = source.cut(1.0)
    assert cut.seconds == pytest.approx(1.0) and cut.name == source.name
    assert source.seconds == CLIP.duration
    assert ClipSource(CLIP).window(len(CLIP) - 1, 9) is None
    assert len(source.window(len(CLIP) - 5, 9) or []) == 5


@pytest.mark.parametrize("later", [0, 6, 20], ids=["as foreseen", "within the spare frames", "after them"])
def test_a_plan_that_joins_later_than_foreseen_is_the_one_made_for_then(planner: Planner, later: int) -> None:
    current = planner.plan(0, None).plan
    expected = planner.plan(90 + later, current).plan
    settled: list[int] = []

    def settle() -> tuple[int, Plan | None]:
        settled.append(90 + later)
        return 90 + later, current

    found = planner.plan(90, current, settle=settle).plan
    assert settled == [90 + later]
    assert (found.start_tick, found.human_first_frame) == (expected.start_tick, expected.human_first_frame)
    np.testing.assert_array_equal(found.q, expected.q)
    np.testing.assert_array_equal(found.states, expected.states)


def test_a_human_looks_where_the_feet_point_once_the_robot_stands(planner: Planner) -> None:
    """A turn that stopped with one foot behind took the mean of both feet for its heading: 8° fell short."""
    current = planner.plan(0, None).plan
    states = current.states.copy()
    last = RETARGETER.layout.view(states[-1])
    before = planner.human_yaw(len(current), current)
    last.feet[int(last.stance), 3] += 0.3  # the other one comes to it
    turned = planner.human_yaw(len(current), replace(current, states=states))
    assert before is not None and turned == pytest.approx(before + 0.3, abs=1e-6)


@pytest.mark.parametrize("turned", [-0.1, 0.1])
def test_a_robot_that_has_turned_beyond_its_plan_turns_back(planner: Planner, turned: float) -> None:
    """Soles slip: after a walk of 10 s the robot looked up to 7° aside of its human."""
    headings = []
    for drift in (0.0, turned):
        plan = planner.plan(0, None).plan
        for join, measured in ((31, 0.0), (62, drift)):
            plan = planner.plan(join, plan, drift=measured).plan
        headings.append(yaw_of(plan.base[plan.stop_row - 1, 3:]))
    assert headings[1] - headings[0] == pytest.approx(-turned, abs=0.02)
