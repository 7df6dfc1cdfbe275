"""`Motion`: what a changed motion keeps, and what is refused of it."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from flexmotion.human.motion import Motion


def test_a_changed_motion_is_that_of_replace(clip: Motion) -> None:
    joints = clip.joints + 0.1
    found, expected = clip.changed(joints=joints, contacts=None), replace(clip, joints=joints, contacts=None)
    assert all(getattr(found, item.name) is getattr(expected, item.name) for item in fields(Motion))
    assert found.joints is joints and clip.joints is not joints


@pytest.mark.parametrize(
    ("changed", "error"),
    [
        ({"joints": np.zeros((3, 26))}, r"Motion.joints has shape \(3, 26\)"),
        ({"root_position": np.full((1, 3), np.nan)}, "Motion.root_position has"),
        ({"activations": np.zeros((2, 5))}, "Motion.activations has 2 frames"),
        ({"fps": 0.0}, "Motion.fps is 0.0"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_what_is_changed_is_checked(clip: Motion, changed: dict[str, object], error: str) -> None:
    with pytest.raises(ValueError, match=error):
        clip[:1].changed(**changed)


def test_fields_that_a_motion_lacks_are_refused(clip: Motion) -> None:
    with pytest.raises(TypeError, match="Motion has no angles, expected some of fps, root_position"):
        clip.changed(angles=clip.joints)


def test_a_motion_of_another_length_is_checked_whole(clip: Motion) -> None:
    """A root of 99 frames beside joints of 8 was accepted: what had changed was checked against its own length."""
    with pytest.raises(ValueError, match=r"has shape \(8, 4\), expected \(99, 4\)"):
        clip[:8].kinematics.changed(root_position=np.zeros((99, 3)))
    with pytest.raises(ValueError, match="root_position has shape"):
        clip[:8].changed(root_position=None)
