"""Roll-outs, with a sampler that records what it is asked for."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from benchmarks.model.roll_out import SEEDS, Cue, always, roll_out
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition

WINDOW = 32


@dataclass
class Walker:
    """Continues its history by a millimetre a frame; records history length, text and seed of each call."""

    standstill: Motion
    fps: float = 30.0
    remembers: int = 10
    asked: list[tuple[int, str | None, int]] = field(default_factory=list)

    def standing(self) -> Motion:
        return self.standstill

    def sample(self, history: Motion, condition: Condition, seed: int) -> Motion:
        self.asked.append((len(history), condition.text, seed))
        made = self.standstill[:1]
        ahead = 1e-3 * np.arange(1, WINDOW + 1)[:, None] * [1.0, 0.0, 0.0]
        return replace(
            made,
            root_position=history.root_position[-1] + ahead,
            root_quaternion=np.repeat(made.root_quaternion, WINDOW, axis=0),
            joints=np.repeat(made.joints, WINDOW, axis=0),
        )


@pytest.fixture
def walker(circling) -> Walker:
    return Walker(circling(12))


def test_one_prompt(walker: Walker) -> None:
    made = roll_out(walker, always("walk"), 3.0, seed=2)
    assert len(made.motion) == 90
    np.testing.assert_allclose(np.diff(made.motion.root_position[:, 0]), 1e-3)
    assert made.joins.tolist() == [32, 64] and not made.cued.any()
    # Each window gets the frames that the sampler remembers, and its own seed.
    assert walker.asked == [(12, "walk", 2 * SEEDS), (10, "walk", 2 * SEEDS + 1), (10, "walk", 2 * SEEDS + 2)]


def test_a_window_is_cut_at_the_next_cue(walker: Walker) -> None:
    cues = [Cue(0.0, Condition("walk")), Cue(1.5, Condition("turn")), Cue(2.0, Condition("stand"))]
    made = roll_out(walker, cues, 3.5, seed=0)
    assert made.joins.tolist() == [32, 45, 60, 92] and made.cued.tolist() == [False, True, True, False]
    assert [text for _, text, _ in walker.asked] == ["walk", "walk", "turn", "stand", "stand"]
    np.testing.assert_allclose(np.diff(made.motion.root_position[:, 0]), 1e-3)


@pytest.mark.parametrize("times", [(), (0.5,), (0.0, 2.0, 1.0), (0.0, 0.01)])
def test_cues_out_of_order(walker: Walker, times: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="growing numbers from 0"):
        roll_out(walker, [Cue(at, Condition()) for at in times], 3.0, seed=0)
