"""Ground forces on both feet add up to what the motion needs, near those that a model predicts."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.biomechanics.ground_reaction import GROUND
from flexmotion.human.body import Body
from flexmotion.sampling.ground_share import GroundShare, ground_share
from flexmotion.sampling.soles import Soles

WEIGHT = 700.0
BODY = Body()
RNG = np.random.default_rng(5)


def soles(frames: int, yaw: float = 0.3) -> Soles:
    """Feet flat on the floor, 30 cm apart, the left one 10 cm ahead and turned out."""
    lattice = np.stack(np.meshgrid(np.linspace(-0.07, 0.17, 4), np.linspace(-0.045, 0.045, 3), indexing="ij"), axis=-1)
    lattice = lattice.reshape(12, 2)
    origin = np.array([[0.1, 0.15], [0.0, -0.15]])
    axes = np.array([[[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]] for a in (yaw, -yaw)])
    points = origin[:, None] + np.einsum("sij,pj->spi", axes, lattice)

    def all_frames(value: np.ndarray) -> np.ndarray:
        return np.repeat(value[None], frames, axis=0)

    return Soles(all_frames(origin), all_frames(axes), lattice, all_frames(points), np.zeros((frames, 2, 12)))


def shared(
    zmp: np.ndarray,
    force: np.ndarray,
    usable: np.ndarray,
    left: float = 0.5,
    twist: np.ndarray | float = 0.0,
) -> tuple[Soles, GroundShare]:
    under = soles(len(zmp))
    moment = np.stack([zmp[:, 1] * force[:, 2], -zmp[:, 0] * force[:, 2], np.broadcast_to(twist, len(zmp))], axis=1)
    predicted = np.zeros((len(zmp), 2, 6))
    predicted[:, 0, 2], predicted[:, 1, 2] = left * WEIGHT, (1 - left) * WEIGHT
    centres = np.zeros((len(zmp), 2, 3))
    centres[..., :2] = under.origin
    return under, ground_share(force, moment, under, usable, predicted, centres, WEIGHT)


def total(found: GroundShare) -> tuple[np.ndarray, np.ndarray]:
    force = found.wrenches[..., :3]
    return force.sum(axis=1), (np.cross(found.centres, force) + found.wrenches[..., 3:]).sum(axis=1)


def inside(under: Soles, frames: int) -> np.ndarray:
    """Points within the region of both feet."""
    share = RNG.dirichlet(np.full(24, 0.3), frames)
    return np.einsum("tp,tpi->ti", share, under.points.reshape(frames, 24, 2))


def vertical(frames: int, aside: float = 0.0) -> np.ndarray:
    force = np.zeros((frames, 3))
    force[:, 0], force[:, 2] = aside * WEIGHT, WEIGHT
    return force


def test_any_zero_moment_point_under_the_feet_is_met() -> None:
    frames = 300
    zmp = inside(soles(frames), frames)
    force = vertical(frames, 0.1)
    under, found = shared(zmp, force, np.ones((frames, 2, 12), bool), left=0.3)
    given, moment = total(found)
    assert given == pytest.approx(force, abs=1e-6)
    off = np.linalg.norm(np.stack([-moment[:, 1], moment[:, 0]], axis=1) / WEIGHT - zmp, axis=1)
    assert np.quantile(off, 0.99) < 1e-3 and off.max() < 5e-3
    # No centre of pressure leaves its sole.
    turn = under.axes.swapaxes(-1, -2)
    local = (turn @ (found.centres[..., :2] - under.origin)[..., None])[..., 0]
    loaded = found.wrenches[..., 2] > 1.0
    assert (local[loaded] <= under.lattice.max(axis=0) + 1e-9).all()
    assert (local[loaded] >= under.lattice.min(axis=0) - 1e-9).all()


@pytest.mark.parametrize("left", [0.2, 0.5, 0.7])
def test_the_models_shares_are_kept_where_the_centres_can_make_up_for_them(left: float) -> None:
    under = soles(1)
    zmp = (left * under.origin[:, 0] + (1 - left) * under.origin[:, 1]) + [0.01, 0.005]
    _, found = shared(zmp, vertical(1), np.ones((1, 2, 12), bool), left=left)
    assert found.wrenches[0, :, 2] / WEIGHT == pytest.approx([left, 1 - left], abs=1e-4)


def test_a_point_outside_is_met_as_nearly_as_the_soles_allow() -> None:
    usable = np.zeros((1, 2, 12), bool)
    usable[:, 1] = True
    under, found = shared(np.array([[1.0, -0.15]]), vertical(1), usable)
    assert found.wrenches[0, 0, 2] == 0.0 and found.wrenches[0, 1, 2] == WEIGHT
    assert found.centres[0, 1, 0] <= under.points[0, 1, :, 0].max() + 1e-9
    assert found.centres[0, 1, 0] > 0.1


def test_forces_stay_within_friction() -> None:
    force = vertical(1, 2.0)
    _, found = shared(np.zeros((1, 2)), force, np.ones((1, 2, 12), bool))
    size = np.linalg.norm(found.wrenches[..., :2], axis=-1)
    assert (size <= GROUND.friction * found.wrenches[..., 2] + 1e-9).all()
    assert total(found)[0][0, 0] == pytest.approx(GROUND.friction * WEIGHT)


@pytest.mark.parametrize("twist", [10.0, -60.0])
def test_a_moment_about_the_vertical_is_shared(twist: float) -> None:
    """60 N·m are more than friction under the soles gives: the feet push in opposite directions."""
    _, found = shared(np.array([[0.05, 0.0]]), vertical(1), np.ones((1, 2, 12), bool), twist=twist)
    assert total(found)[1][0, 2] == pytest.approx(twist, abs=1e-6)


def test_nothing_pulls_and_feet_in_the_air_carry_nothing() -> None:
    pulled = vertical(2)
    pulled[0, 2] = -100.0
    usable = np.ones((2, 2, 12), bool)
    usable[1] = False
    _, found = shared(np.zeros((2, 2)), pulled, usable)
    assert not found.wrenches.any()


def test_mirrored_motions_get_mirrored_forces() -> None:
    frames = 60
    under, flip = soles(frames), np.array([1.0, -1.0, 1.0])
    usable = RNG.random((frames, 2, 12)) < 0.7
    force = RNG.normal([0.0, 0.0, WEIGHT], [60.0, 60.0, 100.0], (frames, 3))
    zmp, twist = inside(under, frames), RNG.normal(0.0, 30.0, frames)
    moment = np.stack([zmp[:, 1] * force[:, 2], -zmp[:, 0] * force[:, 2], twist], axis=1)
    predicted = RNG.normal([0.0, 0.0, 0.5 * WEIGHT, 0.0, 0.0, 0.0], [50.0, 50.0, 150.0, 0.0, 0.0, 0.0], (frames, 2, 6))
    centres = np.zeros((frames, 2, 3))
    centres[..., :2] = under.origin + RNG.normal(0.0, 0.03, (frames, 2, 2))
    # Points of a sole from right to left where they were from left to right: its lattice is its own mirror image.
    other = np.arange(12).reshape(4, 3)[:, ::-1].ravel()
    mirrored = Soles(
        under.origin[:, ::-1] * flip[:2],
        under.axes[:, ::-1] * flip[:2, None] * flip[:2],
        under.lattice,
        under.points[:, ::-1][:, :, other] * flip[:2],
        under.height[:, ::-1][:, :, other],
    )
    found = ground_share(force, moment, under, usable, predicted, centres, WEIGHT)
    opposite = ground_share(
        force * flip,
        moment * -flip,
        mirrored,
        usable[:, ::-1][:, :, other],
        predicted[:, ::-1] * np.concatenate([flip, -flip]),
        centres[:, ::-1] * flip,
        WEIGHT,
    )
    assert opposite.wrenches[:, ::-1] * np.concatenate([flip, -flip]) == pytest.approx(found.wrenches, abs=1e-6)
    assert opposite.centres[:, ::-1] * flip == pytest.approx(found.centres, abs=1e-9)
    assert found.wrenches[..., 2].min() >= 0.0
