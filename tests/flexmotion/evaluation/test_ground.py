"""The judge of ground forces finds what is wrong with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.biomechanics.dynamics import dynamics
from flexmotion.evaluation.ground import judge_ground
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.spatial.gravity import GRAVITY


@pytest.fixture(scope="module")
def walk() -> Motion:
    found = dynamics(default_clip()[240:330])
    return replace(found.motion, pressure_centres=found.centres)


def test_forces_from_a_recording_pass(walk: Motion) -> None:
    figures = judge_ground(walk).figures
    assert figures["residual_force"] < 2.0
    assert figures["residual_moment"] < 1.0
    assert figures["ground_impossible"] < 5.0
    # Recorded motion passes the edge of the soles by some centimetres.
    judged = judge_ground(walk)
    assert np.quantile(judged.beyond[6:-6][judged.loaded[6:-6]], 0.95) < 0.06


def test_a_missing_force_is_the_residual(walk: Motion) -> None:
    assert walk.wrenches is not None
    less = walk.wrenches.copy()
    less[:, 0, 1] -= 0.1 * walk.body.mass * GRAVITY
    change = judge_ground(replace(walk, wrenches=less)).residual - judge_ground(walk).residual
    assert change[:, :3] == pytest.approx(np.tile([0.0, 0.1, 0.0], (len(walk), 1)), abs=1e-9)


def test_accelerations_move_the_zero_moment_point(walk: Motion) -> None:
    time = np.arange(len(walk)) / walk.fps
    jerked = walk.root_position + 0.02 * np.sin(2 * np.pi * 3.0 * time)[:, None] * [0.0, 1.0, 0.0]
    figures = judge_ground(replace(walk, root_position=jerked)).figures
    assert figures["zmp_outside"] > 40.0 and figures["residual_force"] > 20.0


@pytest.mark.parametrize("change", [[0.0, 0.0, -3.0], [1.5, 0.0, 0.0]])
def test_forces_that_no_ground_gives_are_found(walk: Motion, change: list[float]) -> None:
    assert walk.wrenches is not None
    wrong = walk.wrenches.copy()
    wrong[..., :3] += np.array(change) * walk.wrenches[..., 2:3]
    judged = judge_ground(replace(walk, wrenches=wrong))
    assert judged.impossible[walk.wrenches[..., 2] > 100.0].all()


def test_a_centre_beside_the_sole_is_found(walk: Motion) -> None:
    assert walk.pressure_centres is not None
    beside = judge_ground(replace(walk, pressure_centres=walk.pressure_centres + [0.3, 0.0, 0.0]))
    assert beside.figures["ground_impossible"] == 100.0


def test_what_it_needs(walk: Motion) -> None:
    with pytest.raises(ValueError, match="wrenches and centres"):
        judge_ground(walk.kinematics)
    with pytest.raises(ValueError, match="more than 12 frames"):
        _ = judge_ground(walk[:12]).figures
