"""The root's path is shifted so that the zero-moment point lies under the soles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.sampling.balance import BALANCE, STILL, Needs, acceleration, horizontal_shift
from flexmotion.sampling.soles import OUTWARD
from flexmotion.sampling.walking import Walks
from flexmotion.spatial.gravity import GRAVITY

FRAMES, KNOWN, FPS = 40, 8, 30.0
BESIDE, HEIGHT = 0.12, 0.9
"""Distance of the centre of mass from the middle of a sole that is .1 m long and wide, and its height [m]."""


def standing_beside() -> tuple[Needs, np.ndarray]:
    """A body that stands still beside its sole, and the bounds of that."""
    centre = np.tile([BESIDE, 0.0, HEIGHT], (FRAMES, 1))
    force = np.tile([0.0, 0.0, GRAVITY], (FRAMES, 1))
    still = np.zeros((FRAMES, 3))
    needs = Needs(KNOWN, FPS, root=centre, planned=still, force=force, moment=np.cross(centre, force), centre=centre)
    corners = 0.05 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    return needs, np.tile((corners @ OUTWARD).max(axis=0), (FRAMES, 1))


def zmp(needs: Needs, shift: np.ndarray) -> np.ndarray:
    """In the world, along x, (N,) [m]."""
    moved = needs.shifted(np.pad(shift, ((0, 0), (0, 1))))
    return np.asarray(-moved.moment[:, 1] / moved.force[:, 2])


def test_a_body_is_brought_over_feet_that_stay() -> None:
    # Feet were taken to move along with the shift: legs that brought them back left the body where it fell.
    needs, bounds = standing_beside()
    along = horizontal_shift(needs, bounds)
    over = horizontal_shift(needs, bounds, np.ones(FRAMES))
    assert not over[:KNOWN].any() and not along[:KNOWN].any()
    late = slice(KNOWN + 15, FRAMES - 2)
    assert zmp(needs, over)[late].max() < 0.06
    assert zmp(needs, along)[late].max() > 0.08


def test_a_body_that_is_to_stand_gives_up_balance_rather_than_fall() -> None:
    # A body at the edge of its sole fell over it: its zero-moment point was kept inside, and the pendulum fell away
    # from that. A bow that was asked for a minute went 60 m.
    needs, bounds = standing_beside()
    falls = horizontal_shift(needs, bounds, np.ones(FRAMES))
    stands = horizontal_shift(needs, bounds, np.ones(FRAMES), stands=True)

    def capture_point(shift: np.ndarray) -> float:
        place = BESIDE + shift[:, 0]
        return float(place[-1] + (place[-1] - place[-4]) * FPS / 3 * np.sqrt(HEIGHT / GRAVITY))

    assert capture_point(falls) > 0.5
    assert abs(capture_point(stands)) < 0.05
    # Feet that move along do not hold a body: nothing changes.
    along = [horizontal_shift(needs, bounds, np.zeros(FRAMES), stands=on) for on in (True, False)]
    np.testing.assert_array_equal(*along)
    assert zmp(needs, stands)[FRAMES - 10 : FRAMES - 2].max() < 0.06


def test_a_body_that_is_still_stays_where_it_stands() -> None:
    # People whose zero-moment point was 3 to 5 cm inside their soles were moved to and fro by 5 mm while they nodded.
    needs, bounds = standing_beside()
    inside = bounds + BESIDE + 0.035 - 0.05  # soles whose edge is .035 m ahead of the centre of mass
    still, swaying = (horizontal_shift(needs, inside, np.ones(FRAMES), own, stands=True) for own in (STILL, BALANCE))
    assert np.abs(still).max() < 1e-6
    assert np.abs(swaying).max() > 0.005


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_a_body_that_walks_on_ends_over_the_middle_of_its_feet_at_its_speed(speed: float) -> None:
    # A walk whose end was left free, or whose shift was to end there, ran away in one of five seeds: asked for .3 m/s
    # it went 5.5 m in 8 s.
    needs, bounds = standing_beside()
    walks = Walks(velocity=np.array([speed, 0.0]), place=np.zeros(2))
    shift = horizontal_shift(needs, bounds, np.ones(FRAMES), walks=walks)[:, 0]
    velocity = (shift[-1] - shift[-4]) * FPS / 3
    assert BESIDE + shift[-1] + (velocity - speed) * np.sqrt(HEIGHT / GRAVITY) == pytest.approx(0.0, abs=0.01)


def test_a_body_over_no_sole_is_not_brought_anywhere() -> None:
    needs, bounds = standing_beside()
    nowhere = np.full_like(bounds, -1e3)
    np.testing.assert_array_equal(
        horizontal_shift(needs, nowhere, np.ones(FRAMES), stands=True),
        horizontal_shift(needs, nowhere, np.ones(FRAMES)),
    )


def test_feet_that_move_along_need_no_word() -> None:
    needs, bounds = standing_beside()
    np.testing.assert_array_equal(horizontal_shift(needs, bounds), horizontal_shift(needs, bounds, np.zeros(FRAMES)))


def test_a_shift_adds_its_acceleration_and_takes_the_forces_along() -> None:
    rng = np.random.default_rng(3)
    root, planned, force, moment, centre = rng.normal(size=(5, FRAMES, 3))
    needs, shift = Needs(KNOWN, FPS, root, planned, force, moment, centre), rng.normal(size=(FRAMES, 3))
    found, more = needs.shifted(shift), acceleration(shift, FPS)
    assert found.root == pytest.approx(root + shift) and found.centre == pytest.approx(centre + shift)
    assert found.force == pytest.approx(force + more)
    # The moment about the centre of mass is that of before.
    about = found.moment - np.cross(found.centre, found.force)
    assert about == pytest.approx(moment - np.cross(centre, force), abs=1e-6)


def test_a_still_body_stays_where_its_region_has_no_edge() -> None:
    needs, bounds = standing_beside()
    assert np.abs(horizontal_shift(needs, np.full_like(bounds, 10.0))).max() < 1e-9
    assert np.abs(horizontal_shift(needs, bounds)).max() > 0.01


def test_mirrored_bodies_are_balanced_alike() -> None:
    needs, bounds = standing_beside()
    flip, frames = np.array([-1.0, 1.0, 1.0]), np.ones(FRAMES)
    mirrored = replace(
        needs, root=needs.root * flip, force=needs.force * flip, moment=needs.moment * -flip, centre=needs.centre * flip
    )
    order = [int(np.argmin(np.linalg.norm(OUTWARD.T - flip[:2] * way, axis=1))) for way in OUTWARD.T]
    found, other = horizontal_shift(needs, bounds, frames), horizontal_shift(mirrored, bounds[:, order], frames)
    assert other * flip[:2] == pytest.approx(found, abs=1e-9)
