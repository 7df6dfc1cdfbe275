from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import ROBOTS, Robot, list_robots, load_robot
from flexmotion.configs.robot_checks import doubtful_numbers
from flexmotion.configs.servo import find_servo
from flexmotion.configs.versions import FormatVersions

Edit = Callable[[dict[str, Any]], Any]


def set_joint(index: int, **fields: object) -> Edit:
    return lambda content: content["joints"][index].update(fields)


def joint_named(content: dict[str, Any], name: str) -> dict[str, Any]:
    return next(joint for joint in content["joints"] if joint["name"] == name)


def test_a_shipped_robot_loads_by_name_and_by_folder(op3: Robot) -> None:
    assert "op3" in list_robots()
    assert op3.n == 20 and op3.rate_hz == 125
    assert load_robot(ROBOTS / "op3").joint_names == op3.joint_names
    assert load_robot(str(ROBOTS / "op3")).joint_names == op3.joint_names


def test_an_unknown_robot_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"unknown robot 'op4': neither a folder nor one of: .*op3"):
        load_robot("op4")


@pytest.mark.parametrize("given", [None, 7])
def test_what_is_no_name_of_a_robot_is_refused_by_name(given: Any) -> None:
    """A TypeError of a library: "expected str, bytes or os.PathLike object"."""
    with pytest.raises(ConfigError, match=rf"robot: {given}, expected the name of a robot \(op3\) or its folder"):
        load_robot(given)


def test_a_folder_without_a_robot_file_says_what_it_expected(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"expected .*\.yaml or robot\.yaml"):
        load_robot(tmp_path)
    (tmp_path / "op3.yaml").touch()
    with pytest.raises(ConfigError, match=r"or robot\.yaml, found op3\.yaml"):  # a copied folder keeps its file's name
        load_robot(tmp_path)


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (set_joint(0, name="head_pn"), "joint 'head_pn' is not a hinge of op3.xml, did you mean: head_pan"),
        (lambda c: c["joints"].pop(0), "op3.xml has joint 'head_pan' that the robot file lacks"),
        (set_joint(1, name="head_pan"), "joint 'head_pan' is listed twice"),
        (set_joint(0, servo="XM430-W35"), "joint 'head_pan': unknown servo 'XM430-W35', did you mean: XM430-W350"),
        (set_joint(1, id=19), "joint 'head_tilt': id 19 on bus 'main' already belongs to 'head_pan'"),
        (set_joint(0, bus="spare"), "joint 'head_pan': unknown bus 'spare', expected one of: main"),
        (set_joint(0, limits=[1.0, -1.0]), r"limits \[1.0, -1.0\] must be \[lower, higher\]"),
        (set_joint(0, limits=[-4.0, 1.0]), r"joint 'head_pan': limits \[-4.0, 1.0\] exceed the range of XM430-W350"),
        (set_joint(0, zero=3.0), "exceed the range of XM430-W350"),
        (set_joint(0, limits=[float("nan"), 1.0]), r"joints\.0\.limits\.0: Input should be a finite number"),
        (set_joint(0, direction=2), r"joints\.0\.direction: 2, expected 1 or -1"),
        (set_joint(0, speed=2), r"joints\.0\.speed: unknown field, expected one of: name, "),
        (lambda c: c["feet"]["left"].update(body="l_foot"), r"feet\.left\.body: no body 'l_foot' in op3\.xml"),
        (lambda c: c["hands"]["right"].update(body="r_hand"), r"hands\.right\.body: no body 'r_hand'"),
        (lambda c: c["head"].update(body="skull"), r"head\.body: no body 'skull'"),
        (lambda c: c.update(torso="l_knee_link"), "torso: body 'l_knee_link' must have the MJCF's free joint"),
        (lambda c: c.update(torso="body"), "torso: no body 'body' in op3.xml, did you mean: body_link"),
        (lambda c: c["imu"].update(body="chest"), r"imu\.body: no body 'chest'"),
        (lambda c: c["imu"].update(quaternion=[1, 1, 0, 0]), "norm 1.414, expected 1"),
        (lambda c: c["mapping"]["left_leg"].pop("knee"), r"mapping\.left_leg\.knee: missing"),
        (
            lambda c: c["mapping"]["left_leg"].update(knee="l_kne"),
            r"mapping\.left_leg\.knee: unknown joint 'l_kne', did you mean: l_knee",
        ),
        (
            lambda c: c["mapping"]["left_leg"].update(knee="r_knee"),
            r"mapping\.right_leg\.knee: joint 'r_knee' is already mapping\.left_leg\.knee",
        ),
        (lambda c: c["stand_pose"].update(l_kneee=1.0), "stand_pose: unknown joint 'l_kneee', did you mean: l_knee"),
        (lambda c: c["rest_pose"].update(l_knee=3.0), r"rest_pose\.l_knee: 3 is outside the joint's limits"),
        (lambda c: c["gait"].update(walk_hip_height=0.5), "gait: expected min_hip_height <= walk_hip_height"),
        (lambda c: c.update(mjcf="none.xml"), "mjcf: no such file"),
        # Regression: all of these were accepted without a word.
        (lambda c: c["imu"].update(bus="mian"), r"imu\.bus: unknown bus 'mian', expected one of: main"),
        (lambda c: c["imu"].update(position=[-15, 0, 60]), r"imu\.position\.0: -15, expected -3 to 3 \[?m"),
        (lambda c: c["feet"]["left"].update(half_size=[57, 38.7]), r"feet\.left\.half_size\.0: 57, expected .*0\.5"),
        (lambda c: c["feet"]["right"].update(sole=[24, -12.8, -30.5]), r"feet\.right\.sole\.0: 24, expected -3 to 3 m"),
        (lambda c: c["safety"].update(standing_margin=3), r"safety\.standing_margin: 3, expected 0 to 1\.571 rad"),
        (
            lambda c: c["safety"].update(soft_start_speed=1e6),
            r"safety\.soft_start_speed: 1e\+06 rad/s, expected at most 4\.8",
        ),
        # Regression: the run ended in a traceback, or after half a minute with "cut short in PARK" and no cause.
        (lambda c: c.update(rate_hz=1), "field rate_hz: 1, expected more than 40 and 2000 at most Hz"),
        (
            lambda c: c["safety"].update(soft_start_speed=1e-9),
            r"safety\.soft_start_speed: 1e-09 rad/s, expected at least 0\.297: .* takes 2\.96e\+09 s, and may take 10",
        ),
        (lambda c: c["safety"].update(park_s=100), r"safety\.park_s: 100, expected more than 0 and 10 at most s"),
        (lambda c: c["safety"].update(voltage_min=24), r"safety\.voltage_min: 24 V, expected less than 14\.8"),
    ],
)
def test_a_contradiction_is_named(spoiled: Callable[[Edit], Path], edit: Edit, says: str) -> None:
    with pytest.raises(ConfigError, match=says) as error:
        load_robot(spoiled(edit))
    assert "\n" not in str(error.value)
    assert "robot.yaml" in str(error.value)


def test_a_tilt_of_fall_in_degrees_is_refused(spoiled: Callable[[Edit], Path]) -> None:
    """`fall_tilt: 45` was accepted without a word: a robot on its back did not count as fallen, and kept its torque."""
    with pytest.raises(ConfigError, match=r"field safety\.fall_tilt: 45, expected 0\.3 to 1\.571 rad"):
        load_robot(spoiled(lambda content: content["safety"].update(fall_tilt=45)))


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (
            lambda c: c["safety"].update(voltage_min=12.5),
            "field safety.voltage_min: 12.5 V, expected less than 12, the",
        ),
        (lambda c: c["gait"]["pace"].update(reached=0.9), "field gait.pace.reached: 0.9 m/s, expected at most 0.23"),
    ],
)
def test_a_number_that_is_hardly_meant_is_told(spoiled: Callable[[Edit], Path], edit: Edit, says: str) -> None:
    """These were run without a word: a robot that parks at once, a speed that is never used."""
    (told,) = doubtful_numbers(load_robot(spoiled(edit)))
    assert says in told


def test_the_shipped_robots_have_no_doubtful_number() -> None:
    assert [doubtful_numbers(load_robot(name)) for name in list_robots()] == [()] * len(list_robots())


def test_a_file_without_version_is_read_as_version_1(spoiled: Callable[[Edit], Path]) -> None:
    robot = load_robot(spoiled(lambda content: content.pop("version")))
    assert robot.config.version == 1


@pytest.mark.parametrize(
    ("version", "says"),
    [
        (
            2,
            "robot file of version 2, this release reads 1: the file is too new: install the FlexMotion release",
        ),
        (
            0,
            "robot file of version 0, this release reads 1: the file is too old: change it as docs/drivers.md",
        ),
        ("1", r"field version: '1', expected a whole number; this release reads 1"),
        (True, r"field version: True, expected a whole number"),
        (None, r"field version: None, expected a whole number"),
    ],
)
def test_a_version_that_is_not_read_is_refused(spoiled: Callable[[Edit], Path], version: object, says: str) -> None:
    def edit(content: dict[str, Any]) -> None:
        content.update(version=version, field_of_another_version=1)

    folder = spoiled(edit)
    with pytest.raises(ConfigError, match=says) as error:
        load_robot(folder)
    assert str(error.value).startswith(str(folder / "robot.yaml")) and "\n" not in str(error.value)


def test_the_versions_that_are_read_are_named_with_the_migration() -> None:
    versions = FormatVersions(kind="robot file", oldest=2, newest=4, migration="run `flexmotion migrate`")
    for version in (2, 3, 4):
        versions.check(version, "robot.yaml")
    with pytest.raises(ConfigError, match="version 1, this release reads 2 to 4: the file is too old: run `flex"):
        versions.check(1, "robot.yaml")
    with pytest.raises(ConfigError, match="version 5, this release reads 2 to 4: the file is too new"):
        versions.check(5, "robot.yaml")


@pytest.mark.parametrize(
    "text", ["<mujoco><worldbody>", "<mujoco><worldbody><body><geom/></body></worldbody></mujoco>"]
)
def test_a_bad_mjcf_is_named(spoiled: Callable[[Edit], Path], text: str) -> None:
    folder = spoiled(lambda content: None)
    (folder / "op3.xml").write_text(text)
    with pytest.raises(ConfigError, match=r"op3\.xml"):
        load_robot(folder)


def test_joints_without_armature_have_that_of_their_servo(spoiled: Callable[[Edit], Path]) -> None:
    """An MJCF without `armature`, as any URDF converts, was accepted, and blew up in simulation.

    The run ended in "servo of L_SP measures a speed that cannot be". Written figures stay, each on its own.
    """
    folder = spoiled(lambda content: None)
    mjcf = folder / "op3.xml"
    text = mjcf.read_text()
    assert text.count('<joint armature="0.045" frictionloss="0.03" damping="0"/>') == 1
    mjcf.write_text(
        text.replace('<joint armature="0.045" frictionloss="0.03" damping="0"/>', "").replace(
            '<joint name="l_knee"', '<joint name="l_knee" armature="0.02"'
        )
    )
    robot = load_robot(folder)
    armature, friction = (dofs[robot.dof_address] for dofs in (robot.model.dof_armature, robot.model.dof_frictionloss))
    written = np.array([name == "l_knee" for name in robot.joint_names])
    servo = find_servo("XM430-W350")
    np.testing.assert_allclose(armature, np.where(written, 0.02, servo.armature))
    np.testing.assert_allclose(friction, servo.frictionloss)
    assert not robot.model.dof_armature[:6].any()  # the torso is free


def test_the_order_of_the_robot_file_may_differ_from_the_mjcf(spoiled: Callable[[Edit], Path], op3: Robot) -> None:
    robot = load_robot(spoiled(lambda content: content["joints"].reverse()))
    assert robot.joint_names == op3.joint_names[::-1]
    np.testing.assert_array_equal(robot.stand_pose, op3.stand_pose[::-1])
    np.testing.assert_array_equal(robot.qpos_address, op3.qpos_address[::-1])
    for name, qpos, dof in zip(robot.joint_names, robot.qpos_address, robot.dof_address, strict=True):
        assert robot.model.joint(name).qposadr[0] == qpos
        assert robot.model.joint(name).dofadr[0] == dof


def test_arrays_are_read_only(op3: Robot) -> None:
    for name in ("lower", "upper", "kp", "stand_pose", "rest_pose", "tick_rad", "soles", "qpos_address"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(op3, name)[0] = 0


def test_a_joint_of_its_own_gain_is_softer(spoiled: Callable[[Edit], Path], op3: Robot) -> None:
    robot = load_robot(spoiled(lambda content: joint_named(content, "l_el").update(p_gain=400)))
    index = robot.index("l_el")
    assert robot.kp[index] == pytest.approx(op3.kp[index] / 2)
    assert robot.kp[index + 1] == op3.kp[index + 1]


@pytest.mark.parametrize(("direction", "zero"), [(1, 0.0), (-1, 0.0), (1, 0.3), (-1, -0.3)])
def test_ticks_round_trip_within_half_a_tick(spoiled: Callable[[Edit], Path], direction: int, zero: float) -> None:
    robot = load_robot(spoiled(lambda c: joint_named(c, "l_knee").update(direction=direction, zero=zero)))
    knee = robot.index("l_knee")
    for position in np.random.default_rng(0).uniform(robot.lower, robot.upper, (200, robot.n)):
        ticks = robot.to_ticks(position)
        assert (ticks == np.rint(ticks)).all() and (ticks >= 0).all() and (ticks <= 4095).all()
        assert np.abs(robot.from_ticks(ticks) - position).max() <= 0.5 * robot.tick_rad[0] + 1e-12
        servo_angle = (ticks[knee] - 2048) * robot.tick_rad[knee]
        assert servo_angle == pytest.approx(direction * position[knee] + zero, abs=robot.tick_rad[knee])


def test_goals_beyond_the_servo_stop_at_its_last_tick(op3: Robot) -> None:
    assert (op3.to_ticks(np.full(op3.n, 9.0)) == 4095).all()
    assert (op3.to_ticks(np.full(op3.n, -9.0)) == 0).all()


def test_compile_takes_an_edit_and_leaves_the_robot_alone(op3: Robot) -> None:
    def edit(spec: mujoco.MjSpec) -> None:
        spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1])

    assert op3.compile(edit).ngeom == op3.model.ngeom + 1
    assert op3.compile().ngeom == op3.model.ngeom


def test_lookups_name_the_known_ones(op3: Robot) -> None:
    assert op3.servo("l_knee").name == "XM430-W350"
    assert [op3.joint_names[i] for i in op3.chain("head").values()] == ["head_pan", "head_tilt"]
    with pytest.raises(ConfigError, match="unknown joint 'knee'"):
        op3.index("knee")
    with pytest.raises(ConfigError, match="mapping has no 'tail', it has: left_leg"):
        op3.chain("tail")
