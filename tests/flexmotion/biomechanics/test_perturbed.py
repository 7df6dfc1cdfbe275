"""The simulated human: bounds, reproducibility, equations of motion, falls."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.biomechanics.dynamics import dynamics
from flexmotion.biomechanics.external_load import ExternalLoad
from flexmotion.biomechanics.force_error import SMALLEST
from flexmotion.biomechanics.ground_reaction import GROUND
from flexmotion.biomechanics.inverse_dynamics import effort
from flexmotion.biomechanics.simulation.perturbation import LOADED_SEGMENTS, Perturbation, PerturbationRanges, drawn
from flexmotion.biomechanics.simulation.reference import Floor, corner_positions, reference
from flexmotion.biomechanics.simulation.tracking_model import TRACKING, tracking_model
from flexmotion.biomechanics.simulation.variant import PULL, PerturbedMotion, TrackingFailedError, perturbed, projected
from flexmotion.biomechanics.smoothing import CUTOFF, smoothing_spline
from flexmotion.biomechanics.sole import sole_grid
from flexmotion.biomechanics.strength import STRENGTH
from flexmotion.human.human_model import human_model
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.spatial.gravity import GRAVITY

FRAMES = 52
"""Standing and waving at the begin of the shipped clip."""

WALK = slice(246, 300)
"""Steps of the shipped clip."""

INNER = slice(EDGE, -EDGE)
PUSH = Perturbation(
    push=0.06, direction=np.pi / 2, start_s=0.5, duration_s=0.2, carried=(("hand_l", 2.0), ("hand_r", 1.0))
)


@pytest.fixture(scope="module")
def calm(clip: Motion) -> PerturbedMotion:
    return perturbed(clip[:FRAMES], 0, perturbation=Perturbation())


@pytest.fixture(scope="module")
def pushed(clip: Motion) -> PerturbedMotion:
    return perturbed(clip[:FRAMES], 0, perturbation=PUSH)


@pytest.fixture(scope="module")
def sloped(clip: Motion) -> PerturbedMotion:
    return perturbed(clip[:FRAMES], 0, perturbation=Perturbation(slope=(0.05, -0.03)))


def root_residual(answer: PerturbedMotion, loads: tuple[ExternalLoad, ...]) -> np.ndarray:
    """Force and moment about the centre of mass that ground and loads leave, (T, 6) [body weights, x m]."""
    found = answer.dynamics
    assert found.motion.wrenches is not None
    left = effort(found.segments, found.motion.body, loads).about(found.segments.centre)
    for side in range(2):
        force, moment = found.motion.wrenches[:, side, :3], found.motion.wrenches[:, side, 3:]
        arm = found.centres[:, side] - found.segments.centre
        left -= np.concatenate([force, np.cross(arm, force) + moment], axis=1)
    return left / (found.motion.body.mass * GRAVITY)


def low_passed(answer: PerturbedMotion) -> np.ndarray:
    """Wrenches of the simulation at the frame rate, before projection, (T, 2, 6)."""
    every = round(TRACKING.rate / answer.dynamics.motion.fps)
    return np.asarray(smoothing_spline(answer.simulation.wrenches, TRACKING.rate, CUTOFF)[::every])


def test_angles_return_from_the_ball_joints_of_the_tracking_model(clip: Motion) -> None:
    tracked = tracking_model(clip.body)
    again = tracked.motion(tracked.qpos(clip), clip)
    assert again.joints == pytest.approx(clip.joints, abs=1e-9)
    assert again.root_quaternion == pytest.approx(clip.root_quaternion, abs=1e-9)


def test_the_tracking_model_weighs_as_much_as_the_human(clip: Motion) -> None:
    tracked = tracking_model(clip.body)
    expected = human_model(clip.body).model.body_mass.sum()
    assert tracked.model.body_mass.sum() == pytest.approx(expected)
    carrying = tracked.carrying({"hand_l": 2.0})
    assert carrying.model.body_mass.sum() == pytest.approx(expected + 2.0)
    assert tracked.model.body_mass.sum() == pytest.approx(expected), "the cached model was changed"


def test_assistance_and_torques_are_within_their_bounds_in_every_step(pushed: PerturbedMotion) -> None:
    body = pushed.dynamics.motion.body
    control, weight = pushed.simulation.control, body.mass * GRAVITY
    bound = TRACKING.assistance * weight * (1 + 1e-9)
    assert np.linalg.norm(control[:, :3], axis=1).max() <= bound
    assert np.linalg.norm(control[:, 3:6], axis=1).max() <= bound * body.segments.leg
    limits = tracking_model(body).limits
    assert (np.abs(control) <= limits * (1 + 1e-9)).all()
    assert limits[6:].max() == pytest.approx(max(STRENGTH.values()) * body.mass)
    assert pushed.assistance.shape == (len(pushed.dynamics.motion), 2)
    assert pushed.assistance[:, 0].max() * weight == pytest.approx(np.linalg.norm(control[:, :3], axis=1).max())


def test_a_loaded_foot_that_was_recorded_above_the_floor_is_planted(clip: Motion) -> None:
    """A foot that was to carry a quarter of the weight stayed 6 mm above the floor, and a bow fell within 1.5 s."""
    joints = clip.joints[:30].copy()
    joints[:] = joints[:1]
    for side, angle in (("l", 25.0), ("r", 18.0)):
        for joint, share in (("hip_flexion", 1.0), ("knee_flexion", 2.0), ("ankle_dorsiflexion", 1.0)):
            joints[:, JOINTS.index(f"{joint}_{side}")] = np.radians(share * angle)
    still = replace(
        clip[:30],
        joints=joints,
        root_position=np.repeat(clip.root_position[:1], 30, axis=0),
        root_quaternion=np.repeat(clip.root_quaternion[:1], 30, axis=0),
    )
    height = soles(still, still.root_position).min(axis=2)[:, 1]
    found = dynamics(replace(still, root_position=still.root_position - [[0.0, 0.0, height[0]]]))
    assert found.motion.contacts is not None and found.motion.contacts.all()
    tracked = tracking_model(clip.body)
    planted = reference(tracked, found, Floor(np.zeros(2), np.zeros(3)), {})
    lowest = soles(still, planted.qpos[:: planted.substeps]).min(axis=2)
    recorded = soles(still, tracked.qpos(found.motion)).min(axis=2)
    assert recorded[:, 0].min() > 0.015
    assert np.abs(lowest).max() < 0.003


def soles(motion: Motion, states: np.ndarray) -> np.ndarray:
    """Heights of the corners of left and right sole, (T, 2, 4), at roots or states of the tracking model."""
    tracked = tracking_model(motion.body)
    qpos = tracked.qpos(replace(motion, root_position=states)) if states.shape[1] == 3 else states
    data, heights = mujoco.MjData(tracked.linear), []
    for state in qpos:
        data.qpos[:] = state
        mujoco.mj_kinematics(tracked.linear, data)
        heights.append(corner_positions(tracked, data)[..., 2])
    return np.array(heights)


def test_reproducible_from_the_seed(clip: Motion) -> None:
    ranges = PerturbationRanges(push_s=(0.1, 0.12), settle_s=0.2, push=(0.01, 0.05))
    first, again, other = (perturbed(clip[:24], seed, ranges) for seed in (3, 3, 4))
    assert np.array_equal(first.dynamics.motion.joints, again.dynamics.motion.joints)
    assert np.array_equal(first.simulation.control, again.simulation.control)
    assert first.description() == again.description()
    assert first.perturbation != other.perturbation


@pytest.mark.parametrize("direction", [0.0, 2.5])
def test_a_push_moves_the_trunk_in_its_direction(clip: Motion, calm: PerturbedMotion, direction: float) -> None:
    push = Perturbation(push=0.05, direction=direction, start_s=0.2, duration_s=0.2)
    answer = perturbed(clip[:28], 0, perturbation=push)
    torso = human_model(clip.body).body_index["torso"]
    at = round(0.4 * clip.fps)
    moved = answer.dynamics.segments.com[at, torso] - calm.dynamics.segments.com[at, torso]
    along = moved[:2] @ [np.cos(direction), np.sin(direction)]
    assert along > 0.001
    assert along > 0.7 * np.linalg.norm(moved[:2])


def test_labels_obey_the_equations_of_motion_up_to_the_assistance(pushed: PerturbedMotion) -> None:
    """Without the loads the same labels leave at least the weight of what is carried."""
    found = pushed.dynamics
    assert [load.segment for load in found.loads] == list(LOADED_SEGMENTS)
    residual = root_residual(pushed, found.loads)
    force = np.linalg.norm(residual[:, :3], axis=1)
    assert found.residual[:, 0] == pytest.approx(force)
    assert (force[INNER] <= pushed.assistance[INNER, 0] + 0.005).all()
    unloaded = np.linalg.norm(root_residual(pushed, ())[:, :3], axis=1)
    carried = 3.0 / found.motion.body.mass
    assert np.median(unloaded[INNER]) > 0.8 * carried > 5 * np.median(force[INNER])


def test_the_loads_are_the_push_and_the_carried_masses(pushed: PerturbedMotion) -> None:
    forces = {load.segment: load.force for load in pushed.dynamics.loads}
    weight = pushed.dynamics.motion.body.mass * GRAVITY
    middle = round((PUSH.start_s + PUSH.duration_s / 2) * pushed.dynamics.motion.fps)
    assert forces["torso"][middle, 1] == pytest.approx(PUSH.push * weight, rel=0.15)
    # The low-pass filter spreads the push, but keeps its impulse.
    impulse = forces["torso"][:, 1].sum() / pushed.dynamics.motion.fps
    assert impulse == pytest.approx(PUSH.push * weight * PUSH.duration_s * 2 / np.pi, rel=0.05)
    assert np.median(forces["hand_l"][:, 2]) == pytest.approx(-2.0 * GRAVITY, rel=0.05)
    assert np.median(forces["hand_r"][:, 2]) == pytest.approx(-1.0 * GRAVITY, rel=0.05)


def test_applied_torques_are_those_of_inverse_dynamics(calm: PerturbedMotion) -> None:
    """Hinges of knee and ankle; ball joints have other axes."""
    motion = calm.dynamics.motion
    assert motion.torques is not None
    tracked = tracking_model(motion.body)
    for name in ("knee_flexion_l", "ankle_dorsiflexion_r"):
        column = int(tracked.model.joint(name).dofadr[0]) - 6
        index = human_model(motion.body)
        row = 6 + list(index.dof_index[6:]).index(index.model.joint(name).dofadr[0])
        error = motion.torques[INNER, row] - calm.applied[INNER, column]
        assert np.sqrt(np.mean(error**2)) < 0.02 * motion.body.mass


def test_standing_forces_are_the_weight(calm: PerturbedMotion) -> None:
    motion = calm.dynamics.motion
    assert motion.wrenches is not None and motion.contacts is not None
    total = motion.wrenches[INNER, :, 2].sum(axis=1)
    assert np.median(total) == pytest.approx(motion.body.mass * GRAVITY, rel=0.01)
    assert motion.contacts[INNER].all()
    assert calm.dynamics.point_forces.sum(axis=2) == pytest.approx(motion.wrenches[..., :3])


def test_a_slope_is_a_tilted_floor_under_vertical_gravity(sloped: PerturbedMotion) -> None:
    found = sloped.dynamics
    assert np.linalg.norm(root_residual(sloped, ())[INNER, :3], axis=1) == pytest.approx(
        found.residual[INNER, 0], abs=1e-9
    )
    assert (found.residual[INNER, 0] <= sloped.assistance[INNER, 0] + 0.005).all()
    left, right = (found.centres[INNER, side] for side in range(2))
    rise = (left - right)[:, :2] @ sloped.perturbation.slope
    assert (left - right)[:, 2] == pytest.approx(rise, abs=1e-6)
    assert np.abs(rise).max() > 0.0005


def test_a_push_that_throws_the_human_is_reported_not_kept(clip: Motion) -> None:
    push = Perturbation(push=1.5, direction=0.0, start_s=0.3, duration_s=0.3)
    with pytest.raises(TrackingFailedError, match="lost the motion at") as caught:
        perturbed(clip[:FRAMES], 0, perturbation=push)
    assert not all(caught.value.windows)


def test_drawn_perturbations_are_within_their_ranges() -> None:
    ranges = PerturbationRanges()
    found = [drawn(4.0, 70.0, np.random.default_rng(seed), ranges) for seed in range(300)]
    assert all(ranges.push[0] <= one.push <= ranges.push[1] for one in found)
    assert all(ranges.settle_s <= one.start_s and one.end_s <= 4.0 - ranges.settle_s + 1e-9 for one in found)
    assert all(np.hypot(*one.slope) <= np.tan(ranges.slope) for one in found)
    assert max(sum(one.masses.values()) for one in found) <= ranges.carried * 70.0
    assert 0.15 < np.mean([np.hypot(*one.slope) > 0 for one in found]) < 0.35
    assert 0.4 < np.mean([bool(one.carried) for one in found]) < 0.6
    short = drawn(0.8, 70.0, np.random.default_rng(0), ranges)
    assert short.push == 0.0


def test_a_recording_above_the_floor_is_planted(clip: Motion) -> None:
    """Regression: a human who hovered by 3 cm fell on to the floor in the first step of the simulation."""
    hovering = replace(clip[:24], root_position=clip[:24].root_position + [0.0, 0.0, 0.03])
    answer = perturbed(hovering, 0, perturbation=Perturbation())
    weight = clip.body.mass * GRAVITY
    assert answer.simulation.wrenches[:, :, 2].sum(axis=1).max() < 1.5 * weight
    assert answer.simulation.penetration.max() < 0.005


@pytest.fixture(scope="module")
def walking(clip: Motion) -> PerturbedMotion:
    return perturbed(clip[WALK], 0, perturbation=Perturbation())


def test_feet_push_at_the_floor_within_their_friction_and_soles(walking: PerturbedMotion) -> None:
    """Regression: low-passed impacts pulled at the floor by .14 body weights, 16 cm beside the sole."""
    found = walking.dynamics
    assert found.motion.wrenches is not None
    force, moment = found.motion.wrenches[..., :3], found.motion.wrenches[..., 3:]
    weight = found.motion.body.mass * GRAVITY
    low = low_passed(walking)
    assert low[..., 2].min() < -0.01 * weight, "nothing pulls before the projection"
    assert force[..., 2].min() >= 0.0
    assert (np.linalg.norm(force[..., :2], axis=-1) <= 0.8 * force[..., 2] + 1e-6).all()
    assert np.abs(moment[..., :2]).max() < 1e-9
    index = human_model(found.motion.body).body_index
    feet = [index[f"calcaneus_{side}"] for side in SIDES]
    turned = np.einsum("tsij,pj->tspi", found.segments.rotation[:, feet], sole_grid(found.motion.body))
    grid = found.segments.position[:, feet, None] + turned
    assert np.abs(found.centres[..., 2]).max() < 1e-9
    for frame, side in np.argwhere(force[..., 2] > 0):
        outline = ConvexHull(grid[frame, side, :, :2])
        away = outline.equations[:, :2] @ found.centres[frame, side, :2] + outline.equations[:, 2]
        assert away.max() < 1e-6
    acting = np.einsum("tspi,tsp->tsi", grid, found.point_forces[..., 2])[..., :2]
    assert acting == pytest.approx(found.centres[..., :2] * force[..., 2:], abs=1e-6 * weight)


def test_what_the_projection_takes_is_residual_and_error(walking: PerturbedMotion) -> None:
    """Regression: labels of the simulation claimed an error of .005 body weights in every frame."""
    found = walking.dynamics
    assert found.motion.wrenches is not None and found.motion.torques is not None
    weight = found.motion.body.mass * GRAVITY
    residual = root_residual(walking, found.loads)
    assert np.linalg.norm(residual[:, :3], axis=1) == pytest.approx(found.residual[:, 0])
    assert np.linalg.norm(residual[:, 3:], axis=1) == pytest.approx(found.residual[:, 1])
    assert found.motion.torques[:, :3] / weight == pytest.approx(residual[:, :3], abs=1e-9)
    low = low_passed(walking)
    taken = np.linalg.norm(low[..., :3] - found.motion.wrenches[..., :3], axis=-1) / weight
    assert (found.force_error >= taken).all()
    assert np.array_equal(walking.pulled, (low[..., 2] < -PULL * weight).any(axis=1))
    strikes = np.abs(np.diff(walking.simulation.wrenches[:, :, 2], axis=0)).max(axis=0) > 0.2 * weight
    assert (found.force_error.max(axis=0)[strikes] > 5 * SMALLEST).all() and strikes.any()


def test_a_foot_in_the_air_has_no_force(clip: Motion) -> None:
    """A lobe of the filter after take-off is a force of a foot that touches nothing."""
    body, floor = clip.body, Floor(np.zeros(2), np.zeros(3))
    grid = np.tile(sole_grid(body) - [0.0, 0.0, sole_grid(body)[0, 2]], (3, 2, 1, 1))
    grid[:, 0, :, 2] += [[0.0], [0.04], [0.2]]
    wrenches = np.zeros((3, 2, 6))
    wrenches[..., 2] = 30.0
    # A centre of pressure 1 m ahead of the heel, and friction beyond the cone.
    wrenches[..., 4], wrenches[..., 0] = -30.0, 60.0
    found, centres = projected(wrenches, floor, grid, 0.8)
    assert found[:, 0, 2] == pytest.approx([30.0, 30.0, 0.0])
    assert found[:, 1, 2] == pytest.approx(30.0)
    assert found[:, 1, 0] == pytest.approx(24.0)
    assert centres[:, 1, 0] == pytest.approx(grid[0, 1, :, 0].max())
    assert centres[2, 0, 0] == pytest.approx(grid[2, 0, :, 0].mean())


def test_the_reference_has_the_ground_settings_of_the_set(clip: Motion) -> None:
    """Regression: the reference of a simulated variant had default settings, whatever those of the build."""
    other = replace(GROUND, steady=0.0, side_pivot=0.1)
    first, again = (perturbed(clip[:24], 0, perturbation=Perturbation(), ground=ground) for ground in (GROUND, other))
    assert not np.allclose(first.simulation.control, again.simulation.control, atol=0.1)
