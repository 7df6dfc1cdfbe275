"""A gesture of arms or head beside another motion: over a walk, and from window to window."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.beside import Beside, columns_of, fits_beside
from flexmotion.sampling.led_path import KNOWN, led_along

from ...standing_human import standing

WINDOW = 24


@pytest.fixture(scope="module")
def human() -> Motion:
    return standing(4.0)


def names(kind: str) -> set[str]:
    return {JOINTS[column] for column in columns_of(kind)}


def test_a_gesture_of_one_hand_leaves_the_other_arm_to_the_walk() -> None:
    right = names("wave-right-hand")
    assert {"shoulder_flexion_r", "elbow_flexion_r", "forearm_pronation_r"} <= right
    assert all(name.endswith("_r") for name in right)
    assert names("wave-left-hand") == {name[:-1] + "l" for name in right}
    assert names("clap") == right | names("wave-left-hand")
    assert names("nod") == {"neck_extension", "neck_bending", "neck_rotation"} == names("look-left"), "one head"


@pytest.mark.parametrize(
    ("gesture", "kind", "fits"),
    [
        ("wave-right-hand", "walk", True),
        ("nod", "walk-turn-left", True),
        ("nod", "wave-right-hand", True),
        ("wave-right-hand", "bow", True),
        ("wave-right-hand", "stand", True),
        ("clap", "wave-left-hand", False),  # the same arm
        ("look-left", "nod", False),  # the same head
        ("punch", "walk", False),  # a blow
        ("bow", "walk", False),  # the trunk bows
        ("squat", "walk", False),
        ("stand", "walk", False),
        ("wave-right-hand", "dance-short", False),  # it may move any limb
    ],
)
def test_only_what_arms_and_head_make_fits_beside_what_leaves_them_free(gesture: str, kind: str, fits: bool) -> None:
    assert fits_beside(gesture, kind) is fits


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), rate=st.floats(-3.0, 3.0), turns=st.integers(-1, 1), known=st.integers(1, KNOWN))
def test_joints_come_to_the_path_from_where_they_are(
    human: Motion, seed: int, rate: float, turns: int, known: int
) -> None:
    """Angles and speeds go on, whole turns of an arm stay, and no other joint moves."""
    rng, columns = np.random.default_rng(seed), columns_of("wave-right-hand")
    path = rng.uniform(-1.0, 1.0, len(columns)) + rate * np.arange(KNOWN + WINDOW)[:, None] / human.fps
    before = human[:KNOWN].joints.copy()
    before[:, columns] = rng.uniform(-1.0, 1.0, len(columns)) + 2 * np.pi * turns
    last = replace(human[:KNOWN], joints=before)[KNOWN - known :]
    window = human[KNOWN : KNOWN + WINDOW]
    led = led_along(window, last, path, columns).joints
    others = [column for column in range(len(JOINTS)) if column not in columns]
    np.testing.assert_array_equal(led[:, others], window.joints[:, others])
    arm = np.concatenate([last.joints[:, columns], led[:, columns]])
    ahead = np.diff(arm, axis=0)[known - 1]
    speed = (last.joints[-1, columns] - last.joints[-2, columns]) if known == KNOWN else path[1] - path[0]
    assert np.abs(ahead - speed).max() < 0.06, "speeds go on"
    far = np.abs(led[:, columns] - path[KNOWN:])
    off = np.abs(far - 2 * np.pi * np.round(far / (2 * np.pi)))
    assert (off[-1] < 0.25 * off[0] + 0.05).all()


def test_two_windows_of_a_gesture_are_as_one(human: Motion) -> None:
    times = np.arange(-KNOWN, 2 * WINDOW) / human.fps
    path = np.tile(human.joints[0], (len(times), 1))
    path[:, JOINTS.index("neck_extension")] = 0.3 * np.sin(6.0 * (times + KNOWN / human.fps))
    columns = columns_of("nod")
    first = Beside(path[: KNOWN + WINDOW], columns).kept(human[KNOWN : KNOWN + WINDOW], human[:KNOWN])
    second = Beside(path[WINDOW:], columns).kept(human[KNOWN + WINDOW : KNOWN + 2 * WINDOW], first)
    whole = np.concatenate([first.joints, second.joints])[:, columns]
    assert np.abs(np.diff(whole, n=2, axis=0)).max() < 0.02, "no jerk where they meet"
