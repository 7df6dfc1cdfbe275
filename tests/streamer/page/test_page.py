"""What a page is sent: geometry, poses, the human, curves, figures, messages."""

from __future__ import annotations

import base64
import json
from typing import Any

import mujoco
import numpy as np
import pytest

from flexmotion.configs.envelope import Envelope
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.human.kinematics import forward
from flexmotion.spatial.heading import heading
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.motion.heard import Heard, HeardChannel
from flexmotion.streamer.motion.human_channel import POINTS, HumanChannel, points_of
from flexmotion.streamer.outcome import Outcome
from flexmotion.streamer.page.advice import advice, headline
from flexmotion.streamer.page.body import BONES, page_robot
from flexmotion.streamer.page.curves import Curves, margin_mm
from flexmotion.streamer.page.feed import Feed
from flexmotion.streamer.page.geometry import geom_meshes
from flexmotion.streamer.page.health import MOST_LOAD, Health, load
from flexmotion.streamer.page.pictures import Pictures, beside
from flexmotion.streamer.page.pose import MeasuredPose, PlannedPose

Row = np.ndarray[Any, Any]


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def rows(outcome: Outcome) -> Row:
    return outcome.record.rows


@pytest.fixture(scope="module")
def streaming(rows: Row) -> Row:
    """A row with a plan."""
    return rows[rows["state"] == State.STREAMING][60]


@pytest.fixture
def telemetry(robot: Robot, rows: Row) -> Telemetry:
    told = Telemetry(robot.n, robot.rate_hz)
    for row in rows:
        told.ticks.publish(row)
    return told


# Geometry and poses


def test_every_kind_of_geom_has_its_size_and_place() -> None:
    model = mujoco.MjModel.from_xml_string(
        """
        <mujoco>
          <asset><mesh name="wedge" vertex="0 0 0  .3 0 0  0 .2 0  0 0 .1"/></asset>
          <worldbody>
            <geom type="plane" size="1 1 .1"/>
            <geom type="box" size=".1 .2 .3" pos="1 2 3" euler="90 0 0"/>
            <geom type="sphere" size=".1"/>
            <geom type="ellipsoid" size=".1 .2 .3"/>
            <geom type="cylinder" size=".1 .3"/>
            <geom type="capsule" size=".1 .3" euler="0 90 0"/>
            <geom type="mesh" mesh="wedge"/>
            <geom type="box" size=".1 .2 .3" group="3"/>
            <geom type="box" size=".1 .2 .3" rgba="1 1 1 0"/>
          </worldbody>
        </mujoco>
        """
    )
    meshes = {mesh.geom: mesh for mesh in geom_meshes(model)}
    assert sorted(meshes) == [1, 2, 3, 4, 5, 6]
    sizes = {1: (0.2, 0.6, 0.4), 2: (0.2,) * 3, 3: (0.2, 0.4, 0.6), 4: (0.2, 0.2, 0.6), 5: (0.8, 0.2, 0.2)}
    for geom, size in sizes.items():
        corners = meshes[geom].vertices
        np.testing.assert_allclose(np.ptp(corners, axis=0), size, atol=2e-3)
        np.testing.assert_allclose((corners.max(axis=0) + corners.min(axis=0)) / 2, model.geom_pos[geom], atol=1e-6)
    np.testing.assert_allclose(sorted(np.ptp(meshes[6].vertices, axis=0)), [0.1, 0.2, 0.3], atol=1e-6)


def test_a_simulated_robot_is_shown_where_it_is(robot: Robot, streaming: Row) -> None:
    pose = MeasuredPose(robot)
    assert pose.show(streaming)
    np.testing.assert_array_equal(pose.base, streaming["true_base"])
    np.testing.assert_allclose(pose.com, streaming["true_com"], atol=2e-3)


def test_a_real_robot_stands_on_its_planned_feet_with_its_measured_tilt(robot: Robot, streaming: Row) -> None:
    row = streaming.copy()
    row["true_base"] = np.nan
    row["tilt"] = 0.06, -0.04
    row["contact_ref"] = True, False
    pose = MeasuredPose(robot)
    assert pose.show(row)
    np.testing.assert_allclose(pose.soles[0], row["foot_ref"][0, :3], atol=1e-9)
    assert heading(pose.base[3:]) == pytest.approx(heading(row["base_ref"][3:]))
    up = np.zeros(3)
    mujoco.mju_rotVecQuat(up, np.array([0.0, 0, 1]), pose.base[3:])
    assert np.arccos(up[2]) == pytest.approx(np.hypot(0.06, 0.04), rel=0.01)


def test_a_real_robot_without_a_plan_stays_on_the_floor(robot: Robot, streaming: Row) -> None:
    row = streaming.copy()
    row["true_base"] = row["base_ref"] = np.nan
    row["q"] = robot.rest_pose
    pose = MeasuredPose(robot)
    assert pose.show(row)
    assert pose.soles[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    assert not PlannedPose(robot).show(row, pose)


def test_a_robot_that_never_answered_is_not_shown(robot: Robot, streaming: Row) -> None:
    row = streaming.copy()
    row["q"] = np.nan
    assert not MeasuredPose(robot).show(row)


# Pictures


def parts(robot: Robot, picture: bytes) -> dict[str, np.ndarray]:
    """A picture's parts by name, as the page takes them apart."""
    bodies = robot.model.nbody
    sizes = {"time": (1,), "measured": (bodies, 7), "planned": (bodies, 7), "human": (len(POINTS), 3), "feet": (2, 5)}
    sizes |= {"zmp_ref": (2,), "zmp": (2,), "dcm": (2,), "com": (3,), "odometry": (3,)}
    numbers, found = np.frombuffer(picture, "<f4"), {}
    for name, shape in sizes.items():
        count = int(np.prod(shape))
        found[name], numbers = numbers[:count].reshape(shape), numbers[count:]
    assert not len(numbers)
    return found


def test_a_picture_has_every_body_where_it_is(robot: Robot, streaming: Row) -> None:
    streaming = streaming.copy()
    streaming["true_base"], streaming["q"] = streaming["base_ref"], streaming["q_ref"]
    found = parts(robot, Pictures(robot, None).of(streaming))
    data = mujoco.MjData(robot.model)
    data.qpos[:7], data.qpos[robot.qpos_address] = streaming["true_base"], streaming["q"]
    mujoco.mj_kinematics(robot.model, data)
    for name in ("measured", "planned"):
        np.testing.assert_allclose(found[name][:, :3], data.xpos, atol=1e-5)
        np.testing.assert_allclose(found[name][:, 3:], data.xquat, atol=1e-5)
    assert found["time"] == pytest.approx(streaming["tick"] / robot.rate_hz)
    np.testing.assert_allclose(found["feet"][:, :4], streaming["foot_ref"], atol=1e-6)
    np.testing.assert_array_equal(found["feet"][:, 4] > 0.5, streaming["contact_ref"])
    # A click on the floor becomes a place in the odometry: it must be that of this very picture.
    np.testing.assert_allclose(found["odometry"], streaming["odometry"], atol=1e-6)
    np.testing.assert_allclose(found["zmp"], streaming["zmp_ref"] + streaming["zmp_shift"], atol=1e-6)
    assert np.isnan(found["human"]).all()  # nobody sends one


def test_the_planned_robot_stands_on_the_feet_of_the_simulated_one(robot: Robot, streaming: Row) -> None:
    """After a minute of walking it stood .4 m beside the robot, turned by 60°: the feet had slipped."""
    row, turn = streaming.copy(), np.array([np.cos(0.5), 0.0, 0.0, np.sin(0.5)])
    row["true_base"][:2] = row["base_ref"][:2] + [0.4, -0.3]
    mujoco.mju_mulQuat(row["true_base"][3:], turn, np.array(row["base_ref"][3:]))
    row["q"] = row["q_ref"]
    row["q"][robot.joint_names.index("l_el")] += 0.3  # an arm lags
    found = parts(robot, Pictures(robot, None).of(row))
    feet, arm = list(robot.foot_ids), robot.model.body("l_el_link").id
    np.testing.assert_allclose(found["planned"][feet], found["measured"][feet], atol=1e-4)
    assert np.abs(found["planned"][arm, 3:] - found["measured"][arm, 3:]).max() > 0.05
    soles = MeasuredPose(robot)
    soles.show(row)
    bears = row["contact_ref"]
    np.testing.assert_allclose(found["feet"][bears, :2], soles.soles[bears, :2], atol=0.005)
    centre = row["zmp_ref"] - row["base_ref"][:2]
    np.testing.assert_allclose(
        np.linalg.norm(found["zmp_ref"] - row["true_base"][:2]), np.linalg.norm(centre), atol=1e-4
    )


def test_a_robot_without_a_plan_has_no_planned_picture(robot: Robot, streaming: Row) -> None:
    row = streaming.copy()
    row["base_ref"] = np.nan
    found = parts(robot, Pictures(robot, None).of(row))
    assert np.isnan(found["planned"]).all() and np.isfinite(found["measured"]).all()


def test_the_human_is_seen_as_it_was_planned(robot: Robot, streaming: Row) -> None:
    motion = choose_motion()[:60]
    humans, pictures = HumanChannel(), None
    assert not humans.watched
    pictures = Pictures(robot, humans)
    row = streaming.copy()
    row["source_s"] = 20.5 / motion.fps
    pictures.of(row)
    assert humans.watched  # the planner sends it from now on
    humans.publish(7, motion, 0)
    shown = parts(robot, pictures.of(row))["human"]
    points = points_of(motion)
    expected = 0.5 * (points[20] + points[21])
    lengths = [
        np.linalg.norm(one[POINTS.index("left_hip")] - one[POINTS.index("left_knee")]) for one in (shown, expected)
    ]
    sizes = [np.linalg.norm(one[POINTS.index("vertex")] - one[POINTS.index("pelvis")]) for one in (shown, expected)]
    assert lengths[0] / lengths[1] == pytest.approx(sizes[0] / sizes[1], rel=1e-3)  # one scale
    row["source_s"] = np.nan  # the robot stops: its human stays
    np.testing.assert_array_equal(parts(robot, pictures.of(row))["human"], shown)
    row["state"] = State.FAULT  # the run with it is over: it stood frozen in its step beside a robot armed anew
    assert np.isnan(parts(robot, pictures.of(row))["human"]).all()


def test_points_are_those_of_the_kinematics() -> None:
    motion = choose_motion()[:5]
    points, found = points_of(motion), forward(motion)
    assert points.shape == (5, len(POINTS), 3)
    np.testing.assert_allclose(points[:, POINTS.index("right_hand")], found.hand[:, 1], atol=1e-5)
    np.testing.assert_allclose(points[:, POINTS.index("left_toe")], found.toe[:, 0], atol=1e-5)
    named = {name for bone in BONES for name in bone} - {"neck"}
    assert named <= set(POINTS)


def test_a_human_stands_to_the_left_of_the_robot_and_looks_where_it_looks() -> None:
    """The human faces y in its world; the robot faces -x at (1, 2)."""
    points = np.zeros((len(POINTS), 3))
    points[POINTS.index("left_hip")], points[POINTS.index("right_hip")] = [-0.1, 5.0, 0.9], [0.1, 5.0, 0.9]
    points[POINTS.index("right_hand")] = [0.0, 5.5, 1.0]  # ahead of it
    shown = beside(points, 0.5, np.pi, np.array([1.0, 2.0, 0.3, 1, 0, 0, 0]), 1.0)
    centre = 0.5 * (shown[POINTS.index("left_hip")] + shown[POINTS.index("right_hip")])
    np.testing.assert_allclose(centre, [1.0, 2.0 - 0.9, 0.45], atol=1e-9)
    np.testing.assert_allclose(shown[POINTS.index("right_hand")] - centre, [-0.25, 0.0, 0.05], atol=1e-9)


# Figures


def test_the_balance_margin_is_the_way_to_the_nearest_edge(robot: Robot, streaming: Row) -> None:
    row = streaming.copy()
    row["contact_ref"], row["zmp_shift"] = (True, False), 0.0
    row["foot_ref"][0] = 1.0, 2.0, 0.0, np.pi / 2
    half = np.array([[0.06, 0.03], [0.06, 0.03]])
    row["zmp_ref"] = 1.0, 2.0
    assert margin_mm(row, half) == pytest.approx(30.0)
    row["zmp_ref"] = 1.02, 2.05  # turned by 90 degrees: across is x
    assert margin_mm(row, half) == pytest.approx(10.0)
    row["zmp_ref"] = 1.0, 2.07
    assert margin_mm(row, half) == pytest.approx(-10.0)
    row["contact_ref"] = False
    assert margin_mm(row, half) is None


def test_curves_are_ten_a_second_and_know_what_is_unknown(robot: Robot, rows: Row) -> None:
    curves = Curves(robot)
    late = rows.copy()
    late["lateness_s"], late["work_s"] = 1e-3, 2e-3
    late["q"][:12] = np.nan
    new = curves.take(late[:100]) + curves.take(late[100:])
    assert len(new) == len(late) // 12
    assert new[0][1] is None and new[0][4] == pytest.approx(3.0)
    times = np.array([sample[0] for sample in new])
    np.testing.assert_allclose(np.diff(times), 12 / robot.rate_hz, atol=1e-3)
    error = rows["q"][12:24] - rows["q_ref"][12:24]
    assert new[1][1] == pytest.approx(np.degrees(np.sqrt(np.nanmean(error**2))), abs=1e-3)


def test_health_of_a_run(robot: Robot, rows: Row) -> None:
    health = Health(robot)
    assert health.state is State.OFF and np.isnan(health.work_s(99)) and not health.hardest(3)
    late = rows.copy()
    late["lateness_s"] = np.linspace(0, 1e-3, len(late))
    health.take(late)
    window = late["lateness_s"][-int(5 * robot.rate_hz) :]
    assert health.lateness_s(99) == pytest.approx(np.percentile(window, 99))
    loads = health.hardest(3)
    last = rows[-int(robot.rate_hz) :]
    envelope = Envelope.of(robot).at(last["voltage"], last["temperature"])
    share = np.sqrt(np.mean(envelope.load(last["true_torque"], last["qd"]) ** 2, axis=0))
    assert [load.joint for load in loads] == [robot.joint_names[i] for i in np.argsort(-share)[:3]]
    assert loads[0].share == pytest.approx(share.max())


def test_load_is_of_the_envelope_at_the_measured_supply(robot: Robot, rows: Row) -> None:
    low = rows[-5:].copy()
    low["true_torque"], low["qd"], low["temperature"] = 1.0, 0.0, 25.0
    low["voltage"] = 0.5 * robot.nominal_voltage
    envelope = Envelope.of(robot)
    assert load(envelope, low) == pytest.approx(np.full((5, robot.n), 1.0 / (0.5 * robot.stall_torque[0])))


def test_a_servo_at_its_temperature_limit_is_the_hardest_and_is_sent_as_json(robot: Robot, rows: Row) -> None:
    """It gives no torque, so its load was infinite: no browser could read the curves, and the list hid the joint."""
    knee, hot = robot.index("l_knee"), rows.copy()
    hot["temperature"] = 40.0
    hot["temperature"][:, knee] = robot.servos[knee].temperature_limit
    hot["true_torque"][:, knee] = 0.1
    health = Health(robot)
    health.take(hot)
    assert [one.joint for one in health.hardest(1)] == ["l_knee"]
    assert health.hardest(1)[0].share == pytest.approx(MOST_LOAD)
    told = Telemetry(robot.n, robot.rate_hz)
    feed = Feed(robot, told, None, HeardChannel())
    for row in hot:
        told.ticks.publish(row)
    _, texts = feed.update()

    def unreadable(constant: str) -> None:
        raise AssertionError(f"no JSON: {constant}")

    new, figures = (json.loads(text, parse_constant=unreadable) for text in texts)
    assert {sample[2] for sample in new["samples"]} == {MOST_LOAD}
    assert figures["hardest"][0] == ["l_knee", MOST_LOAD]
    (opened,) = (json.loads(text, parse_constant=unreadable) for text in feed.opened())
    assert opened["samples"] == new["samples"]


def test_a_page_gets_the_last_half_minute_and_then_what_is_new(robot: Robot, rows: Row, telemetry: Telemetry) -> None:
    heard, item = HeardChannel(), Heard(item=0, asked="walk", state="accepted")
    telemetry.emit(125, "fault", "READY -> FAULT: bus lost: no joint has answered for 6 reads")
    heard.publish(Heard(id=5, asked="<b>wave</b>", state="refused", reason="no"))
    feed = Feed(robot, telemetry, None, heard, [item], {5: "joystick"}.get)
    told = [json.loads(text) for text in feed.opened()]
    assert [one["type"] for one in told] == ["curves", "event", "heard", "heard"]
    assert told[0]["begin"] and len(told[0]["samples"]) == len(rows) // 12
    assert told[1]["time_s"] == 1.0 and "cable" in told[1]["advice"]
    assert [(one["source"], one["asked"]) for one in told[2:]] == [("script", "walk"), ("joystick", "<b>wave</b>")]
    assert feed.update() == (None, [])
    telemetry.ticks.publish(rows[-1])
    picture, _ = feed.update()
    assert picture is not None
    np.testing.assert_allclose(parts(robot, picture)["time"], rows[-1]["tick"] / robot.rate_hz)


def test_what_a_page_knows_of_the_robot_is_json_with_every_mesh(robot: Robot) -> None:
    known = json.loads(json.dumps(page_robot(robot, "sim", None, ("walk.bvh", "bow.bvh"))))
    assert known["clips"] == ["bow.bvh", "walk.bvh"]
    assert len(known["meshes"]) == len(geom_meshes(robot.model)) and known["joints"] == list(robot.joint_names)
    for mesh in known["meshes"]:
        vertices = np.frombuffer(base64.b64decode(mesh["vertices"]), "<f4").reshape(-1, 3)
        faces = np.frombuffer(base64.b64decode(mesh["faces"]), "<u4")
        assert faces.max() < len(vertices) and 0 < mesh["body"] < len(known["bodies"])


@pytest.mark.parametrize(
    ("message", "told"),
    [
        ("STREAMING -> FAULT: bus lost: no joint has answered for 6 reads", "cable"),
        ("servo of l_knee (id 14) reports hardware error 0x20", "reboot"),
        ("e-stop: frozen by an operator", "clear the fault, then arm"),
        ("fall: torso tilted past the robot's limit", "supply off"),
        ("ARM: the torso is tilted by 80°: the robot lies; put it into its rest pose by hand", "then arm it"),
        ("OFF -> READY", None),
    ],
)
def test_a_fault_says_what_to_do(message: str, told: str | None) -> None:
    found = advice(message)
    assert (found is None) if told is None else (found is not None and told in found)


def test_a_simulated_robot_has_no_cables_to_check() -> None:
    """On a busy machine the simulation was late, and the page told the user to check the servos' cable and supply."""
    lost = "STREAMING -> HOLD: bus lost: no joint has answered for 6 reads"
    busy = f"{lost} (the loop itself woke 23 ms late: this machine was busy with something else)"
    for message in (lost, busy):
        told = str(advice(message, simulated=True))
        assert "too busy to simulate" in told and "cable" not in told
        assert headline(message, simulated=True) == "The simulation fell behind"
    assert "too busy" in str(advice(busy)) and "Check the servos' cable" in str(advice(lost))
    assert headline("e-stop: frozen by an operator") == "Emergency stop pressed"
    assert headline("OFF -> READY") is None
