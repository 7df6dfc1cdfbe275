"""The viewer: it draws the rows, and the run does not depend on it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np
import pytest
import viser
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.spatial.heading import heading
from flexmotion.streamer.api import Outcome
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.session import Clock, Session
from flexmotion.streamer.viewer.from_above import draw_from_above
from flexmotion.streamer.viewer.geometry import geom_meshes
from flexmotion.streamer.viewer.health import Health
from flexmotion.streamer.viewer.panel import render
from flexmotion.streamer.viewer.pose import MeasuredPose, PlannedPose, Pose
from flexmotion.streamer.viewer.service import HOST, Viewer, free_port
from flexmotion.streamer.viewer.view_page import ViewPage

from ...virtual_time import virtual_time
from ...waiting import HANGING_S

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


@pytest.fixture
def page(robot: Robot, telemetry: Telemetry) -> Iterator[ViewPage]:
    shown = ViewPage(robot, telemetry, HOST, free_port(18080))
    yield shown
    shown.follow(True)


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


def test_poses_in_parents_put_every_body_where_it_is(robot: Robot) -> None:
    random = np.random.default_rng(0)
    pose, model = Pose(robot), robot.model
    turn = random.normal(size=4)
    pose.place(np.array([0.3, -0.2, 0.4, *(turn / np.linalg.norm(turn))]), random.uniform(robot.lower, robot.upper))
    position, quaternion = pose.in_parents()
    place, attitude = np.zeros((model.nbody, 3)), np.tile([1.0, 0, 0, 0], (model.nbody, 1))
    for body in range(1, model.nbody):
        parent = model.body_parentid[body]
        mujoco.mju_rotVecQuat(place[body], position[body], attitude[parent])
        place[body] += place[parent]
        mujoco.mju_mulQuat(attitude[body], attitude[parent], quaternion[body])
    np.testing.assert_allclose(place, pose.data.xpos, atol=1e-9)
    np.testing.assert_allclose(np.abs((attitude * pose.data.xquat).sum(axis=1)), 1.0, atol=1e-9)


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
    assert not PlannedPose(robot).show(row)


def test_a_robot_that_never_answered_is_not_shown(robot: Robot, streaming: Row) -> None:
    row = streaming.copy()
    row["q"] = np.nan
    assert not MeasuredPose(robot).show(row)


# The page


def test_the_scene_has_every_body_and_geom_measured_and_planned(page: ViewPage, robot: Robot) -> None:
    for figure in (page.measured, page.planned):
        assert sorted(figure.frames) == list(range(1, robot.model.nbody))
        assert len(figure.meshes) == robot.model.ngeom


def test_frames_are_where_the_newest_row_has_them(page: ViewPage, robot: Robot, rows: Row) -> None:
    page.follow(False)
    position, quaternion = page.is_pose.in_parents()
    assert np.abs(page.is_pose.base - rows[-1]["true_base"]).max() == 0.0
    for body, frame in page.measured.frames.items():
        np.testing.assert_allclose(frame.position, position[body], atol=1e-4)
        np.testing.assert_allclose(frame.wxyz, quaternion[body], atol=1e-4)


def test_the_planned_robot_is_hidden_without_a_plan(robot: Robot, rows: Row, streaming: Row) -> None:
    told = Telemetry(robot.n, robot.rate_hz)
    shown = ViewPage(robot, told, HOST, free_port(18080))
    try:
        told.ticks.publish(rows[0])
        shown._draw(shown.rows.read(), 0.04)
        assert not shown.planned.root.visible
        assert not shown.balance.dcm.visible
        told.ticks.publish(streaming)
        shown._draw(shown.rows.read(), 0.04)
        assert shown.planned.root.visible
        np.testing.assert_allclose(shown.balance.dcm.position[:2], streaming["dcm"], atol=1e-6)
        np.testing.assert_allclose(shown.balance.zmp_ref.position[:2], streaming["zmp_ref"], atol=1e-6)
        np.testing.assert_allclose(shown.footprints.soles[1].position[:2], streaming["foot_ref"][1, :2], atol=1e-6)
    finally:
        shown.follow(True)


def test_soles_leave_an_outline_where_they_land(robot: Robot, make: Callable[..., RunTrace]) -> None:
    told = Telemetry(robot.n, robot.rate_hz)
    shown = ViewPage(robot, told, HOST, free_port(18080))
    try:
        walk = make().rows
        shown.footprints.take(walk[:300])
        shown.footprints.take(walk[300:])
        bears = walk["contact_ref"]
        landings = 2 + int((bears[1:] & ~bears[:-1]).sum())
        assert shown.footprints.earlier.points.shape == (4 * landings, 2, 3)
    finally:
        shown.follow(True)


def test_a_client_that_stalls_does_not_hold_the_page_up(page: ViewPage, telemetry: Telemetry, rows: Row) -> None:
    port = page.server.get_port()
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    patience = {"open_timeout": HANGING_S, "close_timeout": 0.1}  # stalled, it answers no closing frame
    with connect(f"ws://{HOST}:{port}", subprotocols=[protocol], max_queue=1, **patience):
        for row in rows[:100]:
            telemetry.ticks.publish(row)
            page._draw(page.rows.read(), 0.04)
    telemetry.ticks.publish(rows[-1])
    page._draw(page.rows.read(), 0.04)
    assert int(page.health.row["tick"]) == int(rows[-1]["tick"])  # type: ignore[index]


# Figures


def test_health_of_a_run(robot: Robot, rows: Row) -> None:
    health = Health(robot)
    assert health.state is State.OFF and np.isnan(health.work_s(99)) and not health.hardest(3)
    assert "OFF" in render("op3", health)
    late = rows.copy()
    late["lateness_s"] = np.linspace(0, 1e-3, len(late))
    health.take(late)
    window = late["lateness_s"][-int(5 * robot.rate_hz) :]
    assert health.lateness_s(99) == pytest.approx(np.percentile(window, 99))
    loads = health.hardest(3)
    torque = np.sqrt(np.mean(rows["true_torque"][-int(robot.rate_hz) :] ** 2, axis=0)) / robot.usable_torque
    assert [load.joint for load in loads] == [robot.joint_names[i] for i in np.argsort(-torque)[:3]]
    assert loads[0].share == pytest.approx(torque.max())


def test_messages_are_text_in_the_panel(robot: Robot, telemetry: Telemetry, page: ViewPage) -> None:
    telemetry.emit(3, "fault", "servo <b>l_knee</b> & co")
    page.follow(False)
    assert "servo &lt;b&gt;l_knee&lt;/b&gt; &amp; co" in render("op3", page.health)


def test_the_picture_from_above_has_left_at_the_left(robot: Robot, streaming: Row) -> None:
    row = streaming.copy()
    assert draw_from_above(row, robot).count("<polygon") == 2
    left, right = (
        float(part.split('points="')[1].split(",")[0]) for part in draw_from_above(row, robot).split("<polygon")[1:]
    )
    assert left < right
    row["base_ref"] = np.nan
    row["com_ref"] = np.nan
    assert draw_from_above(row, robot) == ""


# The service


def test_the_next_free_port_is_taken() -> None:
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert free_port(port) > port
    with pytest.raises(ConfigError, match="--view-port"):
        free_port(65536)


def _session(robot: Robot, seconds: float, clock: Clock = "lockstep") -> Session:
    driver, source = create("sim", robot, seed=0), ClipSource(choose_motion())
    return Session(robot, driver, source, load_stream(), seconds, realtime=False, clock=clock)


def test_a_run_is_the_same_with_and_without_a_viewer(robot: Robot) -> None:
    plain, viewed = _session(robot, 0.5), _session(robot, 0.5)
    viewed.services = (Viewer(robot, viewed.telemetry, port=18080),)
    one, other = plain.run(), viewed.run()
    for column in ("tick", "state", "q", "q_cmd", "dcm", "true_base"):
        np.testing.assert_array_equal(getattr(one, column), getattr(other, column))


def test_nothing_of_the_server_is_on_stdout(robot: Robot, capfd: pytest.CaptureFixture[str]) -> None:
    session = _session(robot, 0.2)
    session.services = (Viewer(robot, session.telemetry, port=18080),)
    session.run()
    assert capfd.readouterr().out == ""


def test_a_viewer_that_is_killed_only_takes_the_view_away(robot: Robot) -> None:
    session = _session(robot, 1.0, "real")
    session.services = (Viewer(robot, session.telemetry, port=18080),)
    killed: list[int] = []

    def kill(source_s: float) -> None:
        if source_s > 0.3 and not killed:
            child = next(child for child in multiprocessing.active_children() if child.name == "flexmotion-viewer")
            assert child.pid is not None
            killed.append(child.pid)
            os.kill(child.pid, signal.SIGKILL)

    session.progress = kill
    with virtual_time():
        record = session.run()
    assert killed
    note = next(event for event in record.events if "viewer" in event.message)
    assert note.message == "viewer ended (signal 9); the run goes on"
    assert record.rows["tick"][-1] > note.tick + robot.rate_hz / 2
