"""What `model/personal` measures, on motion whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from benchmarks.model.personal import Clips, distance, overall, verdicts
from benchmarks.model.posture_distance import posture_distance, postures
from flexmotion.biomechanics.mirror import mirror
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS


def swinging(motion: Motion, joint: str, phase: float, reach: float = 0.5, middle: float = 0.0) -> Motion:
    """The motion with a joint that swings twice about an angle [rad]."""
    joints = motion.joints.copy()
    joints[:, JOINTS.index(joint)] = middle + reach * np.sin(np.linspace(0, 4 * np.pi, len(motion) + 1)[:-1] + phase)
    return replace(motion, joints=joints)


def test_postures_have_neither_phase_nor_place_nor_side(circling) -> None:
    """Frame by frame two walks of one person are as far apart as their phases."""
    walk = circling(120, 1.0, 0.0, 0.3)
    one, other = (swinging(walk, "shoulder_flexion_l", phase) for phase in (0.0, np.pi / 2))
    assert distance(one, other) > 0.03
    own = postures([one], walk.body)
    assert own.shape == (240, 48)
    for same in (other, swinging(circling(120, 0.6), "shoulder_flexion_l", 1.0), mirror(one)):
        assert posture_distance(own, postures([same], walk.body)) < 0.002
    child = replace(one, body=Body(height=1.2, mass=25.0), root_position=one.root_position)
    scaled = replace(child, root_position=one.root_position * child.body.leg / one.body.leg)
    np.testing.assert_allclose(postures([scaled], walk.body), own, atol=1e-9)


def test_another_posture_is_further_than_a_smaller_change_of_it(circling) -> None:
    walk = circling(90, 1.0)
    base, more, most = (
        postures([swinging(walk, "elbow_flexion_r", 0.0, middle=bent)], walk.body) for bent in (0.6, 0.8, 1.2)
    )
    assert 0 < posture_distance(base, more) < posture_distance(base, most)
    assert posture_distance(base, most) == pytest.approx(posture_distance(most, base))


def test_clips_apart_are_known_of_two(circling) -> None:
    one = postures([circling(30)], circling(30).body)
    assert Clips([one], True, False).apart is None
    assert Clips([one, one + 0.1, one + 0.3], True, False).apart == pytest.approx(0.2)


def rows(normal: float = 0.0, after: float = 1.0, done: float = 0.9):
    shown = {"clips": "shown", "normal_cm": 0.0, "personal_cm": 12.0, "before_cm": 4.0, "after_cm": after}
    unseen = {"clips": "", "normal_cm": normal, "personal_cm": 6.0}
    return {"walk": {**shown, "done_before": 1.0, "done": 1.0}, "nod": {**unseen, "done_before": 0.9, "done": done}}


def held(found) -> list[bool]:
    return [verdict.holds for verdict in verdicts(found)]


def test_all_must_be_as_before_nearer_and_done() -> None:
    """Moved is not learnt: another motion that is not hers was counted as learnt before."""
    assert held(overall(rows(), 0.0)) == [True, True, True]
    assert held(overall(rows(), 1e-9)) == [False, True, True]
    assert held(overall(rows(normal=1e-6), 0.0)) == [False, True, True]
    assert held(overall(rows(after=3.9), 0.0)) == [True, False, True]
    assert held(overall(rows(done=0.2), 0.0)) == [True, True, False]
