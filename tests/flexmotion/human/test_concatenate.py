"""Motions joined one after another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.human.concatenate import concatenate
from flexmotion.importers.default_clip import default_clip


def test_parts_give_the_whole_motion_for_any_sign_of_their_quaternions() -> None:
    motion = default_clip()[:60]
    second = motion[20:60]
    whole = concatenate([motion[:20], motion[:0], replace(second, root_quaternion=-second.root_quaternion)])
    for name in ("root_position", "root_quaternion", "joints"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(motion, name))


def test_fields_that_a_part_lacks_are_dropped() -> None:
    motion = default_clip()[:20]
    touching = replace(motion, contacts=np.ones((20, 2), bool))
    assert concatenate([touching, motion]).contacts is None
    assert concatenate([touching, motion[:0]]).contacts is not None  # a part without frames lacks nothing
    both = concatenate([touching, touching]).contacts
    assert both is not None and both.shape == (40, 2)


def test_no_parts_and_different_frame_rates_are_refused() -> None:
    motion = default_clip()[:20]
    for parts in ([], [motion, replace(motion, fps=60.0)]):
        with pytest.raises(ValueError, match="one frame rate"):
            concatenate(parts)
