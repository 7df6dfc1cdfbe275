from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.sources import ClipSource

CLIP = default_clip()
SIZE = 0.05
FRAMES = 32
FIRST = 240


@pytest.fixture
def clip() -> ClipSource:
    return ClipSource(CLIP)


def window(clip: ClipSource, size: float = SIZE, seed: int = 3, first: int = FIRST) -> Motion:
    motion = NoisySource(clip, size, seed).window(first, FRAMES)
    assert motion is not None
    return motion


def test_its_first_frame_is_the_clip_itself(clip: ClipSource) -> None:
    noisy = window(clip)
    assert len(noisy) == FRAMES
    for name in ("root_position", "root_quaternion", "joints"):
        np.testing.assert_allclose(getattr(noisy, name)[0], getattr(CLIP, name)[FIRST], atol=1e-12)


def standing(frames: int = 60) -> Motion:
    """A human who holds one pose, for which an error of timing has no effect."""
    return Motion(
        fps=30.0,
        root_position=np.tile(CLIP.root_position[FIRST], (frames, 1)),
        root_quaternion=np.tile(CLIP.root_quaternion[FIRST], (frames, 1)),
        joints=np.tile(CLIP.joints[FIRST], (frames, 1)),
        body=CLIP.body,
    )


def test_the_error_of_the_root_grows_linearly_to_its_size_at_a_second() -> None:
    still = standing()
    noisy = window(ClipSource(still), first=4)
    away = np.linalg.norm((noisy.root_position - still.root_position[:FRAMES])[:, :2], axis=1)
    np.testing.assert_allclose(away[30:], SIZE, rtol=1e-9)
    np.testing.assert_allclose(away[:31], SIZE * np.arange(31) / 30, atol=1e-12)
    np.testing.assert_array_equal(noisy.root_position[:, 2], still.root_position[:FRAMES, 2])


def test_hands_and_feet_move_by_the_same_distance_against_the_root() -> None:
    still = standing()
    for seed in range(8):
        noisy = window(ClipSource(still), seed=seed, first=4)
        true, seen = forward(still[:FRAMES]), forward(noisy)
        for name in ("hand", "heel"):
            for side in (0, 1):
                local = [
                    np.einsum("ji,j->i", k.pelvis_rotation[-1], getattr(k, name)[-1, side] - k.pelvis_position[-1])
                    for k in (true, seen)
                ]
                # Levers are measured by small angles and have a least length: the true arc is near, not equal.
                assert 0.3 * SIZE < np.linalg.norm(local[1] - local[0]) < 1.3 * SIZE


def test_the_error_of_the_heading_is_a_few_degrees() -> None:
    still = standing()
    turns = []
    for seed in range(20):
        noisy = window(ClipSource(still), seed=seed, first=4)
        turn = Rotation.from_quat(noisy.root_quaternion[-1], scalar_first=True)
        turns.append((turn * Rotation.from_quat(still.root_quaternion[0], scalar_first=True).inv()).as_rotvec())
    assert np.abs(turns).max() < np.radians(3.0) and np.abs(np.array(turns)[:, 2]).max() > np.radians(1.5)


def test_time_runs_up_to_forty_milliseconds_fast_or_slow() -> None:
    """The root of this human moves at a constant speed, so that its position is a clock."""
    still = standing(90)
    path = still.root_position + np.outer(np.arange(90) / 30.0, [0.0, 0.0, 1.0])
    steady = Motion(30.0, path, still.root_quaternion, still.joints, still.body)
    late = [window(ClipSource(steady), seed=seed, first=9).root_position[-1, 2] - path[9 + 31, 2] for seed in range(30)]
    assert 0.03 < np.abs(late).max() <= 0.04 + 1e-9
    assert min(late) < 0 < max(late)


def test_windows_disagree_and_each_is_reproducible(clip: ClipSource) -> None:
    source = NoisySource(clip, SIZE, 3)
    once, other = source.window(FIRST, FRAMES), source.window(FIRST + 8, FRAMES)
    again = source.window(FIRST, FRAMES)
    assert once is not None and other is not None and again is not None
    np.testing.assert_array_equal(once.joints, again.joints)
    assert np.abs(once.joints[8:] - other.joints[:-8]).max() > 0.01
    assert np.abs(once.joints - window(clip, seed=4).joints).max() > 0.01


def test_without_noise_it_is_the_source(clip: ClipSource) -> None:
    np.testing.assert_array_equal(window(clip, size=0.0).joints, CLIP.joints[FIRST : FIRST + FRAMES])
    source = NoisySource(clip, SIZE, 3)
    assert (source.name, source.fps) == (clip.name, clip.fps)


def test_it_ends_where_the_source_ends(clip: ClipSource) -> None:
    source = NoisySource(clip, SIZE, 3)
    last = source.window(len(CLIP) - 5, FRAMES)
    assert last is not None and len(last) == 5
    assert source.window(len(CLIP), FRAMES) is None
