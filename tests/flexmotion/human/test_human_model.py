"""The human's MuJoCo model: its parts, and what each joint's sign means."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from flexmotion.human.body import Body
from flexmotion.human.human_model import SEGMENTS, SITES, human_model
from flexmotion.human.kinematics import forward
from flexmotion.human.skeleton import DOF_COUNT, JOINTS


def test_parts():
    human = human_model(Body())
    assert set(human.body_index) == {"world", *SEGMENTS}
    assert len(SEGMENTS) == 21
    assert set(human.site_index) == set(SITES)
    assert human.model.nv == DOF_COUNT == 32
    assert sorted(human.dof_index) == list(range(32))


def test_mass_and_stature(make_standing):
    body = Body(height=1.62, mass=55.0, sex="female")
    assert human_model(body).model.body_mass.sum() == pytest.approx(55.0, rel=2e-4)
    human = forward(make_standing(body=body))
    assert human.vertex[0, 2] == pytest.approx(1.62)
    assert human.heel[0, :, 2] == pytest.approx([0, 0], abs=1e-9)
    assert human.toe[0, :, 2] == pytest.approx([0, 0], abs=1e-9)
    # The centre of mass in upright stance is at 55 to 58 % of stature (Winter 2009, chapter 4).
    assert 0.54 < human.com[0, 2] / 1.62 < 0.59


# Joint, point that moves, direction in which a positive angle moves it.
SIGNS = [
    ("lumbar_extension", "vertex", (-1, 0, 0)),
    ("lumbar_bending", "vertex", (0, -1, 0)),
    ("neck_extension", "vertex", (-1, 0, 0)),
    ("neck_bending", "vertex", (0, -1, 0)),
    *(
        (f"{joint}_{s}", f"{point}/{s}", way)
        for s in "lr"
        for joint, point, way in [
            ("hip_flexion", "ankle", (1, 0, 0)),
            ("knee_flexion", "ankle", (-1, 0, 0)),
            ("ankle_dorsiflexion", "toe", (0, 0, 1)),
            ("shoulder_flexion", "wrist", (1, 0, 0)),
            ("elbow_flexion", "hand", (1, 0, 0)),
        ]
    ),
    *(
        (f"{joint}_{s}", f"{point}/{s}", (0, way, 0))
        for s, way in (("l", -1), ("r", 1))
        for joint, point in [
            ("hip_adduction", "ankle"),
            ("hip_rotation", "toe"),
            ("shoulder_adduction", "wrist"),
        ]
    ),
]


@pytest.mark.parametrize(("joint", "point", "way"), SIGNS)
def test_signs(make_standing, joint, point, way):
    name, _, side = point.partition("/")
    points = [getattr(forward(make_standing(**angles)), name)[0] for angles in ({}, {joint: 0.1})]
    move = (points[1] - points[0])["lr".index(side)] if side else points[1] - points[0]
    assert move @ np.array(way) > 0.8 * np.linalg.norm(move) > 0


@pytest.mark.parametrize(("side", "inward"), [(0, -1.0), (1, 1.0)])
def test_rotation_and_pronation_turn_the_front_inwards(make_standing, side, inward):
    s = "lr"[side]
    bent = {f"elbow_flexion_{s}": np.pi / 2}
    turned = forward(make_standing(**bent, **{f"shoulder_rotation_{s}": 0.3})).wrist[0, side]
    assert inward * (turned - forward(make_standing(**bent)).wrist[0, side])[1] > 0.05
    palm = forward(make_standing(**{f"forearm_pronation_{s}": np.pi / 2})).hand_rotation[0, side, :, 0]
    assert palm == pytest.approx([0, inward, 0], abs=1e-9)


@pytest.mark.parametrize("joint", ["lumbar_rotation", "neck_rotation"])
def test_trunk_turns_to_the_left(make_standing, joint):
    human = forward(make_standing(**{joint: 0.2}))
    assert human.head_rotation[0, 1, 0] > 0


def test_left_and_right_mirror_each_other(make_standing):
    rng = np.random.default_rng(0)
    angles = {f"{joint[:-2]}": float(rng.uniform(-0.5, 0.5)) for joint in JOINTS if joint.endswith("_l")}
    human = forward(make_standing(**{f"{joint}_{s}": angle for joint, angle in angles.items() for s in "lr"}))
    for name in ("knee", "ankle", "toe", "heel", "elbow", "wrist", "hand"):
        left, right = getattr(human, name)[0]
        assert left == pytest.approx(right * [1, -1, 1], abs=1e-12)


def test_it_has_no_contacts_and_is_cached():
    human = human_model(Body())
    assert human is human_model(Body())
    assert not human.model.geom_contype.any()
    data = mujoco.MjData(human.model)
    mujoco.mj_forward(human.model, data)
    assert data.ncon == 0
