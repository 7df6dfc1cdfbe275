"""Points of the soles: which the ground can act at, and how far they reach."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.biomechanics.segment_motion import segment_motion
from flexmotion.biomechanics.sole import sole_grid
from flexmotion.human.human_model import human_model
from flexmotion.human.skeleton import SIDES
from flexmotion.importers.default_clip import default_clip
from flexmotion.sampling.soles import NOWHERE, OUTWARD, Soles


@pytest.fixture(scope="module")
def walked() -> Soles:
    motion = default_clip()[100:160]
    return Soles.of(motion.body, segment_motion(motion))


def test_points_are_those_of_the_feet(walked: Soles) -> None:
    motion = default_clip()[100:160]
    segments, index = segment_motion(motion), human_model(motion.body).body_index
    for side, name in enumerate(SIDES):
        foot = index[f"calcaneus_{name}"]
        turned = np.einsum("tij,pj->tpi", segments.rotation[:, foot], sole_grid(motion.body))
        wanted = segments.position[:, foot, None] + turned
        assert walked.points[:, side] == pytest.approx(wanted[..., :2], abs=1e-12)
        assert walked.height[:, side] == pytest.approx(wanted[..., 2], abs=1e-12)
    # A point is where its coordinates on the sole say.
    flat = walked.origin[:, :, None] + np.einsum("tfij,pj->tfpi", walked.axes, walked.lattice)
    assert walked.points == pytest.approx(flat, abs=1e-12)


def test_a_region_reaches_as_far_as_its_farthest_usable_point(walked: Soles) -> None:
    usable = np.random.default_rng(1).random(walked.height.shape) < 0.3
    usable[4] = False
    found = walked.bounds(usable)
    for t in range(len(found)):
        points = walked.points[t][usable[t]]
        wanted = (points @ OUTWARD).max(axis=0) if len(points) else np.full(len(OUTWARD.T), NOWHERE)
        assert found[t] == pytest.approx(wanted, abs=1e-12)


def test_feet_in_contact_count_alone_where_they_are_low(walked: Soles) -> None:
    contacts = np.random.default_rng(2).random((len(walked.height), 2)) < 0.5
    reach = float(np.quantile(walked.height, 0.2))
    found, low = walked.usable(contacts, reach), walked.height < reach
    assert len(np.unique(low.reshape(len(low), 2, -1).any(axis=2), axis=0)) > 1
    for t in range(len(found)):
        stands = low[t] & contacts[t, :, None]
        np.testing.assert_array_equal(found[t], stands if stands.any() else low[t])
