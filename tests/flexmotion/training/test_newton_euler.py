"""Kinematics and inverse dynamics in torch against MuJoCo's."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.biomechanics.augmentation import varied  # noqa: E402
from flexmotion.biomechanics.dynamics import dynamics  # noqa: E402
from flexmotion.features.encode import body_points, encode, encode_loads  # noqa: E402
from flexmotion.features.joint_groups import BALL_COLUMNS, BALL_SIGNS, HINGE_COLUMNS  # noqa: E402
from flexmotion.features.layout import Layout  # noqa: E402
from flexmotion.features.slope import levelled  # noqa: E402
from flexmotion.human.body import Body  # noqa: E402
from flexmotion.human.human_model import SEGMENTS, human_model  # noqa: E402
from flexmotion.human.kinematics import forward  # noqa: E402
from flexmotion.human.motion import Motion  # noqa: E402
from flexmotion.human.skeleton import JOINTS  # noqa: E402
from flexmotion.spatial.gravity import GRAVITY  # noqa: E402
from flexmotion.training.human_tensors import HumanTensors  # noqa: E402
from flexmotion.training.kinematics import Pose, path, points, pose, segments  # noqa: E402
from flexmotion.training.newton_euler import Rates, angular_momentum, generalised_forces, rates  # noqa: E402
from flexmotion.training.physics import EDGE, euler_residual, world_wrenches  # noqa: E402

BODY = Body(height=1.82, mass=77.0)


def _about(axis: str, angle: torch.Tensor) -> torch.Tensor:
    c, s, o, z = torch.cos(angle), torch.sin(angle), torch.ones_like(angle), torch.zeros_like(angle)
    rows = {
        "x": ((o, z, z), (z, c, -s), (z, s, c)),
        "y": ((c, z, s), (z, o, z), (-s, z, c)),
        "z": ((c, -s, z), (s, c, z), (z, z, o)),
    }[axis]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def _pose(place: torch.Tensor, turn: torch.Tensor, joints: torch.Tensor) -> Pose:
    angles = joints[..., torch.tensor(BALL_COLUMNS)] * torch.tensor(BALL_SIGNS)
    balls = _about("y", angles[..., 0]) @ _about("x", angles[..., 1]) @ _about("z", angles[..., 2])
    pelvis = _about("z", turn[..., 2]) @ _about("y", turn[..., 1]) @ _about("x", turn[..., 0])
    return Pose(place, pelvis, balls, joints[..., torch.tensor(HINGE_COLUMNS)])


def _derivative(function: Callable[[torch.Tensor], torch.Tensor]) -> Callable[[torch.Tensor], torch.Tensor]:
    return lambda time: torch.func.jvp(function, (time,), (torch.ones_like(time),))[1]


@pytest.mark.parametrize("seed", range(4))
def test_inverse_dynamics_are_mujocos(seed: int) -> None:
    """Any state, speed, acceleration, ground force and external wrenches, exact derivatives, against `mj_inverse`."""
    rng = np.random.default_rng(seed)
    start, speed, bend = (torch.tensor(rng.normal(0, scale, 32)) for scale in (0.6, 1.0, 3.0))
    humans = HumanTensors.of([BODY], torch.float64)

    def at(time: torch.Tensor) -> Pose:
        q = (start + speed * time + 0.5 * bend * time**2)[None, None]
        return _pose(q[..., :3], q[..., 3:6], q[..., 6:])

    def momentum(time: torch.Tensor) -> torch.Tensor:
        def rotation(t: torch.Tensor) -> torch.Tensor:
            return segments(at(t), humans).rotation

        return angular_momentum(rotation(time), _derivative(rotation)(time), humans)

    now = torch.zeros((), dtype=torch.float64)
    found = segments(at(now), humans)
    moving = Rates(
        _derivative(_derivative(lambda time: segments(at(time), humans).com))(now), _derivative(momentum)(now)
    )
    wrenches, external = rng.normal(0, 300, (2, 6)), rng.normal(0, 50, (len(SEGMENTS), 6))
    branches = torch.sign(torch.cos(start[6:][torch.tensor(BALL_COLUMNS)[:, 1]]))[None, None]
    root, torques = generalised_forces(
        found, moving, humans, torch.tensor(wrenches)[None, None], branches, torch.tensor(external)[None, None]
    )

    human = human_model(BODY)
    model, data = human.model, mujoco.MjData(human.model)
    pelvis_rate = _derivative(lambda time: at(time).pelvis)
    pelvis = at(now).pelvis[0, 0].numpy()
    # Angular velocity and acceleration of the free joint are in the axes of the pelvis.
    turning, bending = pelvis_rate(now)[0, 0].numpy(), _derivative(pelvis_rate)(now)[0, 0].numpy()
    spin = pelvis.T @ turning
    spin_rate = pelvis.T @ bending - spin @ spin
    data.qpos[:3] = start[:3]
    mujoco.mju_mat2Quat(data.qpos[3:7], pelvis.ravel())
    data.qpos[human.qpos_index] = start[6:]
    for target, linear, angular, joints in (
        (data.qvel, speed[:3], spin, speed[6:]),
        (data.qacc, bend[:3], spin_rate, bend[6:]),
    ):
        target[:3] = linear
        target[3:6] = angular[2, 1], angular[0, 2], angular[1, 0]
        target[human.dof_index[6:]] = joints
    mujoco.mj_inverse(model, data)
    ground = np.zeros(model.nv)
    for side, wrench in zip("lr", wrenches, strict=True):
        ankle = data.xpos[human.body_index[f"talus_{side}"]]
        foot = human.body_index[f"calcaneus_{side}"]
        mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], ankle, foot, ground)
    for name, wrench in zip(SEGMENTS, external, strict=True):
        segment = human.body_index[name]
        mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], data.xipos[segment], segment, ground)
    expected = data.qfrc_inverse - ground
    scale = np.abs(expected).max()
    assert torques[0, 0].numpy() == pytest.approx(expected[human.dof_index[6:]], abs=1e-5 * scale)
    assert root[0, 0, :3].numpy() == pytest.approx(expected[:3], abs=1e-5 * scale)
    assert pelvis.T @ root[0, 0, 3:].numpy() == pytest.approx(expected[3:6], abs=1e-5 * scale)


def test_features_give_points_and_torques_of_the_clip(clip: Motion) -> None:
    """Points and joint torques from the features of a clip, in float32, against `biomechanics`."""
    found = dynamics(clip[240:300])
    motion = found.motion
    layout = Layout(motion.fps)
    features = torch.tensor(encode(motion, layout, found.centres))[None]
    humans = HumanTensors.of([motion.body])
    here = segments(pose(features, layout, humans), humans)

    expected = body_points(forward(motion))
    height = points(here, humans)[0, :, :, 2].numpy()
    assert height == pytest.approx(expected[..., 2], abs=1e-3)
    span = points(here, humans)[0, :, 0] - points(here, humans)[0, :, 15]
    assert span.norm(dim=-1).numpy() == pytest.approx(np.linalg.norm(expected[:, 0] - expected[:, 15], axis=-1), 1e-3)

    middle = slice(EDGE, -EDGE)
    inner = type(here)(here.rotation[:, middle], here.origin[:, middle], here.com[:, middle])
    weight = humans.mass.sum(dim=1) * 9.81
    _, yaw = path(features[..., layout.blocks["root"]], layout.fps)
    wrenches = world_wrenches(features, yaw, layout, weight, humans.leg)[:, middle]
    branches = torch.tensor(np.sign(np.cos(motion.joints[None, :, BALL_COLUMNS[:, 1]])), dtype=torch.float32)
    _, torques = generalised_forces(inner, rates(here, humans, layout.fps), humans, wrenches, branches[:, middle])
    assert motion.torques is not None
    error = torques[0].numpy() - motion.torques[middle, -len(JOINTS) :]
    assert np.sqrt(np.mean(error**2)) < 0.02 * np.abs(motion.torques[:, 6:]).max()


def test_known_loads_leave_a_small_residual(clip: Motion) -> None:
    """Regression: variants had loads that the residual did not know, 5.3 % of body weight in the mean instead of .4."""
    motion, loads = varied(clip[240:330], seed=0)
    found = dynamics(motion, loads=loads)
    motion, layout = found.motion, Layout(motion.fps)
    forces = np.stack([load.force for load in loads], axis=1)
    features = torch.tensor(encode(motion, layout, found.centres))[None]
    branches = torch.tensor(np.sign(np.cos(motion.joints[None, :, BALL_COLUMNS[:, 1]])), dtype=torch.float32)
    humans = HumanTensors.of([motion.body])
    forces = np.concatenate([forces, np.zeros((len(motion), 1, 3))], axis=1)
    known = torch.tensor(encode_loads(forces, motion).astype(np.float32))[None]
    with_loads, without = (euler_residual(features, layout, humans, branches, given) for given in (known, None))
    force, missing = (found.root[..., :3].norm(dim=-1).mean() for found in (with_loads, without))
    assert missing > 0.02 and force < 0.2 * missing
    assert with_loads.joints.abs().mean() < 0.3 * without.joints.abs().mean()
    # A window turned to another heading has the same loads in its own frame.
    turned = features.clone()
    turned[:, 0, layout.blocks["root"].start + 2] += layout.fps  # by 1 rad
    again = euler_residual(turned, layout, humans, branches, known).root[..., :3].norm(dim=-1).mean()
    assert float(again) == pytest.approx(float(force), rel=0.05)


def test_a_slope_is_gravity_in_another_direction(clip: Motion) -> None:
    """The equations of motion hold on the levelled floor as they do in the world."""
    found = dynamics(clip[240:300])
    layout, humans = Layout(found.motion.fps), HumanTensors.of([found.motion.body])
    weight = found.motion.body.mass * GRAVITY
    loads = np.random.default_rng(2).normal(0.0, 20.0, (len(found.motion), 3, 3))
    residuals = []
    for slope in ((0.0, 0.0), (0.06, -0.04)):
        level = levelled(found.motion, found.centres, loads, slope)
        motion = level.motion
        gravity = np.broadcast_to(weight * level.gravity, (len(motion), 1, 3))
        forces = np.concatenate([level.loads, gravity], axis=1)
        features = torch.tensor(encode(motion, layout, level.centres))[None]
        branches = torch.tensor(np.sign(np.cos(motion.joints[None, :, BALL_COLUMNS[:, 1]])), dtype=torch.float32)
        known = torch.tensor(encode_loads(forces, motion).astype(np.float32))[None]
        residuals.append(euler_residual(features, layout, humans, branches, known))
        if any(slope):
            without = known * torch.tensor([1.0, 1.0, 1.0, 0.0])[:, None]
            unknown = euler_residual(features, layout, humans, branches, without)
    flat, sloping = residuals
    for name in ("joints", "root"):
        size, expected = (getattr(one, name)[..., :3].norm(dim=-1) for one in (sloping, flat))
        assert size.numpy() == pytest.approx(expected.numpy(), abs=3e-3), name
    # Without it the force of the slope is missing: its angle, of the body weight.
    assert (unknown.root - sloping.root)[..., :3].norm(dim=-1).mean() == pytest.approx(np.hypot(0.06, 0.04), rel=0.02)


def test_the_loss_has_gradients_for_torques_and_forces_but_not_for_the_motion(clip: Motion) -> None:
    """Regression: the gradient through two differentiations gave motions 25 % more jerk and a larger residual."""
    found = dynamics(clip[240:300])
    layout = Layout(found.motion.fps)
    features = torch.tensor(encode(found.motion, layout, found.centres))[None].requires_grad_()
    branches = torch.tensor(np.sign(np.cos(found.motion.joints[None, :, BALL_COLUMNS[:, 1]])), dtype=torch.float32)
    residual = euler_residual(features, layout, HumanTensors.of([found.motion.body]), branches)
    (residual.root.square().mean() + residual.joints.square().mean()).backward()
    assert features.grad is not None
    changed = {name for name, block in layout.blocks.items() if features.grad[..., block].abs().max() > 0}
    assert changed == {"torques", "wrenches"}
