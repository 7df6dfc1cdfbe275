"""Windows of a set, and the batches that are made of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.configs.errors import MotionFormatError  # noqa: E402
from flexmotion.training.onsets import WITHIN_S, onset  # noqa: E402
from flexmotion.training.run import Run  # noqa: E402
from flexmotion.training.window_set import WindowSet  # noqa: E402


def test_windows_are_the_clips_frames(trained: Run) -> None:
    store = trained.store()
    windows = WindowSet(store, trained.config.window, "train").draw((0,), 5, following=True)
    assert windows.following is not None
    for row in range(5):
        clip = store.clips[windows.clip[row]]
        assert clip.split == "train"
        start = clip.start + windows.first[row]
        expected = store.statistics.normalise(store.features[start : start + trained.config.window.future])
        np.testing.assert_allclose(windows.future[row], expected, atol=1e-3)


def test_the_same_seed_draws_the_same_windows(trained: Run) -> None:
    windows = WindowSet(trained.store(), trained.config.window, "train")
    first, second, other = (windows.draw((seed, 1), 16).future for seed in (5, 5, 6))
    assert torch.equal(first, second) and not torch.equal(first, other)


def test_windows_change_over_to_another_clip(trained: Run) -> None:
    windows = WindowSet(trained.store(), trained.config.window, "train")
    before, after = windows.draw((1,), 6), windows.draw((2,), 6)
    both = before.blended_into(after, 8)
    torch.testing.assert_close(both.future[:, 8:], after.future[:, 8:])
    assert (both.future[:, 0] - before.future[:, 0]).norm() < 0.1 * (after.future[:, 0] - before.future[:, 0]).norm()
    assert torch.equal(both.history, before.history) and np.array_equal(both.clip, after.clip)


def test_windows_with_those_that_follow_lie_within_their_clips(trained: Run) -> None:
    """Regression: the last window of a clip was followed by its last pose, and the model learnt to freeze."""
    windows = WindowSet(trained.store(), trained.config.window, "train")
    drawn = windows.draw((4,), 64, following=True)
    for row in range(64):
        clip = trained.store().clips[drawn.clip[row]]
        assert drawn.first[row] + 2 * trained.config.window.future <= clip.frames
    following = drawn.next(drawn.history)
    assert drawn.following is not None and torch.equal(following.future, drawn.following)
    with pytest.raises(ValueError, match="windows that follow"):
        following.next(drawn.history)


def test_onsets_are_those_of_the_index_or_of_the_moving_body(trained: Run) -> None:
    """A bow's is told by the shoulders alone: people lay their hands together before it."""
    store = trained.store()
    told = {"content": "nod", "start_s": "0.5", "end_s": "1.0", "around": "stand"}
    labels = [told, {"content": "bow"}, *({} for _ in store.clips[2:])]
    clips = [replace(clip, labels=own, captions=(), spans=()) for clip, own in zip(store.clips, labels, strict=True)]
    vars(store)["clips"] = tuple(clips)
    block, points = store.layout.blocks["positions"], store.layout.points
    shoulders = [points.index(name) for name in ("shoulder_l", "shoulder_r")]
    for clip, found, chosen in zip(clips[1:3], store.onsets[1:3], (shoulders, range(len(points))), strict=True):
        frames = min(clip.frames, round(WITHIN_S * store.layout.fps))
        places = store.features[clip.start : clip.start + frames, block].astype(np.float32).reshape(frames, -1, 3)
        assert found == onset(places[:, list(chosen)])
    assert store.onsets[0] == round(0.5 * store.layout.fps)
    assert "onsets" not in vars(store.without_variants())


def test_windows_begin_where_the_motion_of_their_clip_does(trained: Run) -> None:
    """Regression: a model that was asked for a bow stood: few windows of bows began with a stand.

    Where nothing before a window is needed, it may begin with its clip.
    """
    store, window = trained.store(), trained.config.window
    vars(store)["onsets"] = np.array([30 if clip.frames > 100 else 2 for clip in store.clips])
    windows = WindowSet(store, window, "train")
    drawn = windows.draw((7,), 64, begun=1.0)
    late = store.onsets[drawn.clip] == 30
    assert late.any() and (np.abs(drawn.first[late] - 30) <= 5).all()
    alone = windows.draw((7,), 64, begun=1.0, known=False)
    assert (np.abs(alone.first - store.onsets[alone.clip]) <= 5).all() and (alone.first >= 0).all()
    row = int(np.argmin(alone.first))
    start = store.clips[alone.clip[row]].start + alone.first[row]
    expected = store.statistics.normalise(store.features[start : start + window.future])
    np.testing.assert_allclose(alone.future[row], expected, atol=1e-3)


def test_too_short_clips_are_reported(trained: Run) -> None:
    window = trained.config.window.model_copy(update={"future": 4000})
    with pytest.raises(MotionFormatError, match="no clip of split 'train'"):
        WindowSet(trained.store(), window, "train")
