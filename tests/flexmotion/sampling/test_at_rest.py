"""The rest pose of a standing human."""

from __future__ import annotations

import numpy as np

from flexmotion.human.skeleton import JOINTS
from flexmotion.importers.default_clip import default_clip
from flexmotion.sampling.at_rest import RESTING_S, at_rest


def test_the_upper_body_moves_smoothly_to_rest_and_the_legs_are_unchanged() -> None:
    motion = default_clip()[60:180]
    rest = np.full(len(JOINTS), 0.1)
    found = at_rest(motion, rest)
    legs = [at for at, name in enumerate(JOINTS) if name.startswith(("hip", "knee", "ankle"))]
    upper = [at for at in range(len(JOINTS)) if at not in legs]
    np.testing.assert_array_equal(found.joints[:, legs], motion.joints[:, legs])
    far = np.abs(motion.joints[0, upper] - rest[upper]).max()
    assert np.abs(found.joints[0, upper] - motion.joints[0, upper]).max() < 0.01 * far
    after = round(6 * RESTING_S * motion.fps)
    left, was = (np.abs(one.joints[after:, upper] - rest[upper]).max() for one in (found, motion))
    assert left < 0.03 * was
    assert np.array_equal(at_rest(motion, motion.joints[0]).joints[0], motion.joints[0])
