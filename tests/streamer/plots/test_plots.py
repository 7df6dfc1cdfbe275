"""Pictures: they can be drawn from any record, and equal records give equal bytes."""

from __future__ import annotations

import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest

from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.control.tick_row import blank
from flexmotion.streamer.outcome import Outcome
from flexmotion.streamer.plots.filmstrip import FRAMES, draw_filmstrip, moments
from flexmotion.streamer.plots.footsteps import scaled_path, stances
from flexmotion.streamer.plots.panels import joint_columns
from flexmotion.streamer.plots.pictures import write_plots
from flexmotion.streamer.plots.solid import Camera, shapes
from flexmotion.streamer.plots.style import save, styled
from flexmotion.streamer.plots.timeline import draw_timeline
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures

PNG = b"\x89PNG\r\n\x1a\n"


def test_every_picture_is_a_png(pictures: list[Path]) -> None:
    assert [file.stem for file in pictures] == ["robot", "footsteps", "timeline", "tracking", "torque", "effort"]
    assert all(file.read_bytes().startswith(PNG) for file in pictures)


def test_equal_runs_look_equal(outcome: Outcome, pictures: list[Path], tmp_path: Path) -> None:
    with styled():
        again = save(draw_filmstrip(outcome.record, outcome.robot, outcome.motion), tmp_path / "robot.png")
    assert again.read_bytes() == pictures[0].read_bytes()


@pytest.mark.parametrize("ticks", [0, 50])
def test_a_run_without_truth_or_without_a_tick_can_be_drawn(ticks: int, outcome: Outcome, tmp_path: Path) -> None:
    blind = RunTrace(outcome.record.rate_hz, outcome.record.joint_names)
    blind.append(blank(blind.rows.dtype, ticks))
    blind.q[:], blind.q_ref[:] = outcome.robot.stand_pose, outcome.robot.stand_pose
    for file in write_plots(tmp_path, blind, outcome.robot, outcome.figures, outcome.motion):
        assert file.read_bytes().startswith(PNG)


def test_every_joint_has_one_panel_and_legs_come_first(outcome: Outcome) -> None:
    columns = joint_columns(outcome.robot)
    assert sorted(joint for column in columns for joint in column) == list(range(outcome.robot.n))
    assert outcome.robot.joint_names[columns[0][0]].startswith("l_hip")
    assert outcome.robot.joint_names[columns[1][0]].startswith("r_hip")


def test_stances_are_runs_of_contact_at_their_median_place() -> None:
    contact = np.array([[1, 1], [1, 0], [1, 0], [1, 1]], bool)
    feet = np.zeros((4, 2, 4))
    feet[3, 1] = [0.1, -0.05, 0.0, 0.2]
    found = stances(contact, feet)
    assert [(s.side, s.start, s.stop) for s in found] == [(0, 0, 4), (1, 0, 1), (1, 3, 4)]
    assert (found[2].x, found[2].y, found[2].yaw) == pytest.approx((0.1, -0.05, 0.2))


def test_human_path_starts_at_the_robot_and_turns_with_it() -> None:
    t = np.array([0.0, 1.0])
    human = HumanTrack(t, np.array([[5.0, 5.0, 1.0], [6.0, 5.0, 1.0]]), np.zeros(2))
    facing_left = np.array([0.2, 0.3, 0.25, np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    assert scaled_path(human, t, facing_left, 0.25) == pytest.approx(np.array([[0.2, 0.3], [0.2, 0.55]]))


def test_moments_are_spread_over_what_was_followed(record: RunTrace, figures: RobotFigures) -> None:
    ticks = moments(record, np.ones(record.used, bool))
    playing = np.flatnonzero(np.isfinite(record.source_s))
    assert len(ticks) == FRAMES
    assert (ticks[0], ticks[-1]) == (playing[0], playing[-1])
    assert len(moments(record, np.zeros(record.used, bool))) == 0


def test_camera_axes_are_a_right_handed_frame() -> None:
    camera = Camera.at(-55, 12)
    assert camera.axes @ camera.axes.T == pytest.approx(np.eye(3))
    assert np.linalg.det(camera.axes) == pytest.approx(1)
    assert camera.project(np.array([0.0, 0.0, 1.0]))[1] > 0.9


def test_shapes_enclose_their_geoms() -> None:
    kinds = ["sphere", "capsule", "cylinder", "ellipsoid", "box"]
    sizes = [".1 .1 .1", ".1 .2 .2", ".1 .2 .2", ".1 .2 .3", ".1 .2 .3"]
    geoms = "".join(f'<geom type="{kind}" size="{size}"/>' for kind, size in zip(kinds, sizes, strict=True))
    hidden = '<geom type="sphere" size="1" group="3"/><geom type="plane" size="1 1 1"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}{hidden}</worldbody></mujoco>")
    hulls = shapes(model)
    assert len(hulls) == len(kinds)
    extents = [hull.corners.max(axis=0) for hull in hulls]
    expected = [(0.1, 0.1, 0.1), (0.1, 0.1, 0.3), (0.1, 0.1, 0.2), (0.1, 0.2, 0.3), (0.1, 0.2, 0.3)]
    for extent, size in zip(extents, expected, strict=True):
        assert extent == pytest.approx(size, rel=0.03)


def test_events_before_what_is_kept_of_a_run_take_no_room(record: RunTrace, figures: RobotFigures) -> None:
    """A long run ended with matplotlib's "constrained_layout not applied": texts of events stood far beside it."""
    record.rows["tick"] += 100_000
    record.forgotten = 100_000
    record.events.extend(Event(500 * n, "request", "NOTE") for n in range(12))
    with styled(), warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = draw_timeline(record, figures)
        figure.canvas.draw()
    assert figure.axes[-1].get_xlim() == pytest.approx(record.period_s, abs=0.01)
