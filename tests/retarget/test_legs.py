from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.retarget.leg_check import check_poses
from flexmotion.retarget.legs import CHAIN, SIDE_NAMES, Leg, Legs

ROBOT = load_robot("op3")  # hypothesis takes no fixtures
LEGS = [Leg.of(ROBOT, side) for side in SIDE_NAMES]
DATA = mujoco.MjData(ROBOT.model)
NEARLY_STRAIGHT = 0.15
"""Knee angle at the longest used length of the leg [rad]."""

AXES_MISS = 3e-4
"""Largest distance between the OP3's axes that should intersect [m]: the error of any closed form."""

shares = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6)
tilts = st.tuples(*[st.floats(-0.3, 0.3)] * 2, st.floats(-3.0, 3.0))


def sole_pose(side: int, torso: np.ndarray, rotation: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sole centre (3,) and rotation (3, 3) by MuJoCo's forward kinematics."""
    q = np.zeros(ROBOT.n)
    q[LEGS[side].indices] = angles
    DATA.qpos[:3], DATA.qpos[3:7] = torso, Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    DATA.qpos[ROBOT.qpos_address] = q
    mujoco.mj_kinematics(ROBOT.model, DATA)
    foot = DATA.xmat[ROBOT.foot_ids[side]].reshape(3, 3)
    return DATA.xpos[ROBOT.foot_ids[side]] + foot @ ROBOT.soles[side], foot.copy()


def bent(side: int, spread: list[float]) -> np.ndarray:
    """Joint angles (6,) at these shares of the limits, the knee bent."""
    indices = LEGS[side].indices
    lower, upper = ROBOT.lower[indices].copy(), ROBOT.upper[indices].copy()
    knee = CHAIN.index("knee")
    straight = lower if abs(lower[knee]) < abs(upper[knee]) else upper
    straight[knee] = NEARLY_STRAIGHT * LEGS[side].signs[knee]
    return lower + np.array(spread) * (upper - lower)


@settings(max_examples=150)
@given(side=st.sampled_from([0, 1]), spread=shares, tilt=tilts)
def test_inverse_of_forward_kinematics_for_every_pose_within_the_limits(
    side: int, spread: list[float], tilt: tuple[float, float, float]
) -> None:
    torso, rotation = np.array([0.3, -0.2, 0.25]), Rotation.from_euler("xyz", tilt).as_matrix()
    angles = bent(side, spread)
    position, foot = sole_pose(side, torso, rotation, angles)
    found, short = LEGS[side].solve(torso[None], rotation[None], position[None], foot[None])
    assert short[0] == 0.0
    reached, turned = sole_pose(side, torso, rotation, found[0])
    np.testing.assert_allclose(turned, foot, atol=1e-6)
    np.testing.assert_allclose(reached, position, atol=AXES_MISS)
    hip = torso + rotation @ LEGS[side].hip
    if (foot.T @ (hip - position) + LEGS[side].sole)[2] < 0.01:
        return  # With the hip below the ankle, the ankle has a second solution.
    # Near a straight knee, a tenth of a millimetre is a hundredth of a radian at the knee.
    np.testing.assert_allclose(found[0], angles, atol=0.02)


def test_rows_are_solved_independently() -> None:
    rows = np.array([[0.0, 0.0, 0.2], [0.01, 0.02, 0.21]])
    upright = np.tile(np.eye(3), (2, 1, 1))
    soles = np.array([[0.0, 0.05, 0.0], [0.03, 0.05, 0.0]])
    both, _ = LEGS[0].solve(rows, upright, soles, upright)
    for k in range(2):
        alone, _ = LEGS[0].solve(rows[k : k + 1], upright[:1], soles[k : k + 1], upright[:1])
        np.testing.assert_array_equal(alone[0], both[k])


@given(spread=st.tuples(shares, shares), tilt=tilts)
def test_both_legs_at_once_are_each_by_itself(
    spread: tuple[list[float], list[float]], tilt: tuple[float, float, float]
) -> None:
    """One torso, a sole each: no leg takes the other's geometry, signs or columns."""
    torso, rotation = np.array([0.3, -0.2, 0.25]), Rotation.from_euler("xyz", tilt).as_matrix()
    poses = [sole_pose(side, torso, rotation, bent(side, spread[side])) for side in (0, 1)]
    positions, feet = (np.stack(part)[:, None] for part in zip(*poses, strict=True))
    both = Legs(LEGS)
    angles, short = both.solve(torso[None], rotation[None], positions, feet)
    for side, leg in enumerate(LEGS):
        alone, missing = leg.solve(torso[None], rotation[None], positions[side], feet[side])
        np.testing.assert_allclose(angles[side], alone, atol=1e-12)
        np.testing.assert_allclose(short[side], missing, atol=1e-12)
        np.testing.assert_array_equal(both.indices[side], leg.indices)


@pytest.mark.parametrize("side", [0, 1])
def test_out_of_reach_the_leg_points_at_the_target_and_the_missing_length_is_returned(side: int) -> None:
    leg, upright = LEGS[side], np.eye(3)
    torso = np.array([0.0, 0.0, 0.5])
    ankle = torso + leg.hip + np.array([0.1, 0.0, -leg.length - 0.02])
    angles, short = leg.solve(torso[None], upright[None], (ankle + leg.sole)[None], upright[None])
    missing = np.linalg.norm(ankle - torso - leg.hip) - leg.length
    assert short[0] == pytest.approx(missing, abs=1e-12)
    reached, foot = sole_pose(side, torso, upright, angles[0])
    np.testing.assert_allclose(foot, upright, atol=1e-6)
    hip = torso + leg.hip
    towards = (reached - leg.sole - hip) / leg.length
    np.testing.assert_allclose(towards, (ankle - hip) / np.linalg.norm(ankle - hip), atol=AXES_MISS / leg.length)


def test_a_foot_at_the_hip_gives_finite_angles() -> None:
    leg = LEGS[0]
    angles, short = leg.solve(np.zeros((1, 3)), np.eye(3)[None], (leg.hip + leg.sole)[None], np.eye(3)[None])
    assert np.isfinite(angles).all()
    assert short[0] > 0.0 or leg.thigh == pytest.approx(leg.shank, abs=1e-3)


def test_both_legs_are_mirror_images() -> None:
    left, right = LEGS
    np.testing.assert_allclose(left.hip, right.hip * [1, -1, 1], atol=1e-9)
    np.testing.assert_allclose(left.sole, right.sole * [1, -1, 1], atol=1e-9)
    assert (left.thigh, left.shank) == pytest.approx((right.thigh, right.shank))
    assert left.length < left.thigh + left.shank


def edited(tmp_path: Path, old: str, new: str) -> Robot:
    """OP3 with its MJCF changed."""
    folder = tmp_path / "op3"
    shutil.copytree(ROBOTS / "op3", folder)
    file = folder / "op3.xml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    return load_robot(folder)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="l_knee" axis="0 1 0"', 'name="l_knee" axis="1 0 0"', "'l_knee' of the left leg does not turn about"),
        ('name="l_knee_link" pos="0 0 -0.11015"', 'name="l_knee_link" pos="0.02 0 -0.11015"', "left knee misses"),
    ],
)
def test_a_leg_of_another_kind_names_the_joint(tmp_path: Path, old: str, new: str, message: str) -> None:
    robot = edited(tmp_path, old, new)
    with pytest.raises(RetargetError, match=message) as error:
        Leg.of(robot, "left")
    assert "op3.yaml" in str(error.value) and "\n" not in str(error.value)
    assert Leg.of(robot, "right").thigh > 0.0


def test_axes_within_a_millimetre_are_accepted(tmp_path: Path) -> None:
    robot = edited(tmp_path, 'name="l_knee_link" pos="0 0 -0.11015"', 'name="l_knee_link" pos="0.0006 0 -0.11015"')
    assert Leg.of(robot, "left").thigh == pytest.approx(LEGS[0].thigh)


def pitch_roll_yaw(tmp_path: Path) -> Robot:
    """OP3 whose left hip yaws and pitches in exchanged places, all axes through the same point as before."""
    folder = tmp_path / "op3"
    shutil.copytree(ROBOTS / "op3", folder)
    file = folder / "op3.xml"
    text = file.read_text()
    yaw, pitch = '<joint name="l_hip_yaw" axis="0 0 -1"', '<joint name="l_hip_pitch" axis="0 1 0"'
    assert yaw in text and pitch in text
    text = text.replace(yaw, "YAW").replace(pitch, f'{yaw} pos="-0.0001 -0.019 0"')
    file.write_text(text.replace("YAW", f'{pitch} pos="0 0 -0.0285"'))
    return load_robot(folder)


def test_a_leg_of_another_order_names_the_joints_found_and_expected(tmp_path: Path) -> None:
    robot = pitch_roll_yaw(tmp_path)
    with pytest.raises(RetargetError) as error:
        Leg.of(robot, "left")
    message = str(error.value)
    assert "op3.yaml: mapping.left_leg: " in message and "\n" not in message
    assert "has the joints l_hip_pitch, l_hip_roll, l_hip_yaw, l_knee, l_ank_pitch, l_ank_roll" in message
    assert message.endswith("l_hip_yaw, l_hip_roll, l_hip_pitch, l_knee, l_ank_pitch, l_ank_roll")
    assert Leg.of(robot, "right").thigh > 0.0


def test_forward_kinematics_alone_refuses_a_leg_of_another_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flexmotion.retarget.legs.check_order", lambda *_: None)
    with pytest.raises(RetargetError, match=r"left leg: the closed form misses the sole's pose at l_hip_yaw .* mm and"):
        Leg.of(pitch_roll_yaw(tmp_path), "left")


def test_a_joint_between_those_of_the_mapping_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "op3"
    shutil.copytree(ROBOTS / "op3", folder)
    model, settings = folder / "op3.xml", folder / "op3.yaml"
    ankle = '<joint name="l_ank_roll" axis="1 0 0" range="-0.7 0.7"/>'
    toe = '<joint name="l_toe" axis="0 1 0" range="-0.7 0.7"/>'
    model.write_text(model.read_text().replace(ankle, ankle + toe))
    joint = "  - {name: l_toe, servo: XM430-W350, id: 30, limits: [-0.6, 0.6]}"
    settings.write_text(settings.read_text().replace("\nfeet:", f"\n{joint}\nfeet:"))
    with pytest.raises(RetargetError, match="l_ank_pitch, l_ank_roll, l_toe; expected"):
        Leg.of(load_robot(folder), "left")


@pytest.mark.parametrize(("part", "by"), [("thigh", 0.004), ("shank", -0.004)])
def test_a_closed_form_with_a_wrong_length_is_refused(part: str, by: float) -> None:
    leg = LEGS[0]
    wrong = replace(leg, **{part: getattr(leg, part) + by})
    with pytest.raises(RetargetError, match="left leg: the closed form misses"):
        check_poses(ROBOT, "left", leg.indices, leg.signs, leg.knee_range, wrong.solve)
    check_poses(ROBOT, "left", leg.indices, leg.signs, leg.knee_range, leg.solve)


def test_a_stand_that_is_higher_than_the_legs_is_refused(tmp_path: Path) -> None:
    """A robot file that stood at 0.3 m on legs of 0.22 m was found to be in order, and nothing named the field."""
    folder = tmp_path / "op3"
    shutil.copytree(ROBOTS / "op3", folder)
    settings = folder / "op3.yaml"
    settings.write_text(settings.read_text().replace("stand_hip_height: 0.203", "stand_hip_height: 0.3"))
    with pytest.raises(
        RetargetError, match=r"field gait.stand_hip_height: 0.3 m, but the left leg of the model reaches 0.2198 m"
    ):
        Leg.of(load_robot(folder), "left")


def test_a_knee_that_bends_backward_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "op3"
    shutil.copytree(ROBOTS / "op3", folder)
    file = folder / "op3.yaml"
    text = file.read_text().replace("name: l_knee, servo: XM430-W350, id: 14, limits: [0, 2.4]",
                                    "name: l_knee, servo: XM430-W350, id: 14, limits: [-2.4, 0]")  # fmt: skip
    file.write_text(text.replace("l_knee: 0.7893", "l_knee: -0.7893").replace("l_knee: 2.37", "l_knee: -2.37"))
    with pytest.raises(
        RetargetError, match=r"joint 'l_knee' of the left leg: limits \[-2.40, 0.00\] rad bend the knee"
    ):
        Leg.of(load_robot(folder), "left")
