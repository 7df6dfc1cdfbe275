from __future__ import annotations

import mujoco
import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.sim.options import Plate, SimOptions
from flexmotion.drivers.sim.world import build_model, plate_name, start_qpos


def test_mismatch_of_masses(op3: Robot) -> None:
    torso = op3.model.body_mass[op3.torso_id]
    assert build_model(op3, SimOptions(mass_scale=1.1)).body_mass.sum() == pytest.approx(1.1 * op3.mass)
    heavier = build_model(op3, SimOptions(torso_mass_scale=1.12))
    assert heavier.body_mass.sum() == pytest.approx(op3.mass + 0.12 * torso)
    np.testing.assert_allclose(heavier.body_inertia[op3.torso_id], 1.12 * op3.model.body_inertia[op3.torso_id])
    assert build_model(op3, SimOptions(total_mass=3.5)).body_mass.sum() == pytest.approx(3.5)
    with pytest.raises(ConfigError, match=r"total_mass 1.0 kg: the links without the torso weigh 1\.798 kg"):
        build_model(op3, SimOptions(total_mass=1.0))


def test_mismatch_of_friction(op3: Robot) -> None:
    model = build_model(op3, SimOptions(friction=0.6, joint_friction_scale=2.0))
    assert (model.geom_friction[:, 0] == 0.6).all()
    np.testing.assert_allclose(model.dof_frictionloss[op3.dof_address], 0.06)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (3.0, 0.0), (-2.0, 1.5)])
@pytest.mark.parametrize("pose", ["stand", "rest"])
def test_the_start_puts_both_soles_flat_on_the_floor(op3: Robot, slope: tuple[float, float], pose: str) -> None:
    options = SimOptions(slope_deg=slope)
    model = build_model(op3, options)
    data = mujoco.MjData(model)
    data.qpos[:] = start_qpos(op3, model, getattr(op3, f"{pose}_pose"), options)
    mujoco.mj_forward(model, data)
    normal = data.geom("floor").xmat.reshape(3, 3)[:, 2]
    assert np.degrees(np.arccos(normal[2])) == pytest.approx(np.hypot(*slope), abs=0.01)
    for side, foot in enumerate(op3.foot_ids):
        rotation = data.xmat[foot].reshape(3, 3)
        np.testing.assert_allclose(rotation[:, 2], normal, atol=1e-6)
        assert normal @ (data.xpos[foot] + rotation @ op3.soles[side]) == pytest.approx(0.0, abs=1e-6)


def test_a_plate_faces_the_way_of_its_normal(op3: Robot) -> None:
    plate = Plate(position=(0.3, 0.1, 0.4), normal=(-2.0, 0.0, 0.0), half_size=0.06)
    model = build_model(op3, SimOptions(plates=(plate,)))
    data, geom = mujoco.MjData(model), model.geom(plate_name(0)).id
    mujoco.mj_kinematics(model, data)
    out = data.geom_xmat[geom].reshape(3, 3)[:, 2]
    np.testing.assert_allclose(out, [-1.0, 0.0, 0.0], atol=1e-12)
    face = data.geom_xpos[geom] + model.geom_size[geom, 2] * out
    np.testing.assert_allclose(face, plate.position, atol=1e-12)
    np.testing.assert_allclose(model.geom_size[geom, :2], 0.06)


def test_a_plate_without_a_side_is_refused() -> None:
    with pytest.raises(ValueError, match="normal is .* expected a direction"):
        Plate(position=(0.3, 0.0, 0.4), normal=(0.0, 0.0, 0.0))
