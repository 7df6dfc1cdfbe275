"""What can be asked of a window, and how a window is measured by it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import FlexMotionError, SamplingError
from flexmotion.features.constraint_layout import CENTRES, FORCES, PATH, PLACES, ConstraintLayout, window_values
from flexmotion.features.constraints import Constraints, end_mean
from flexmotion.features.decode import Anchor
from flexmotion.features.encode import encode
from flexmotion.features.joint_groups import ball_angles, matrix
from flexmotion.features.layout import POINTS, Layout
from flexmotion.human.body import Body
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample

LAYOUT = Layout(30.0, muscles=4)
FRAMES = 32


@pytest.fixture
def nothing() -> Constraints:
    return Constraints.none(LAYOUT, Body(), FRAMES)


def test_places_are_measured_in_the_frame_of_the_window(clip: Motion) -> None:
    motion = resample(clip, 30.0).kinematics[40:60]
    window = motion[12:]
    anchor = Anchor.after(motion[:12])
    values = window_values(encode(motion, LAYOUT)[12:].astype(float), LAYOUT, np)
    blocks = ConstraintLayout(LAYOUT).blocks
    hands = forward(window).hand[:, 1]
    turn = Rotation.from_euler("z", -anchor.yaw)
    expected = turn.apply(hands - np.append(anchor.place, 0.0)) / motion.body.leg
    first = blocks[PLACES].start + 3 * POINTS.index("hand_r")
    np.testing.assert_allclose(values[:, first : first + 3], expected, atol=1e-6)
    np.testing.assert_allclose(values[:, first : first + 3] * motion.body.leg, anchor.local(hands), atol=1e-6)
    path = turn.apply(window.root_position - np.append(anchor.place, 0.0)) / motion.body.leg
    np.testing.assert_allclose(values[:, blocks[PATH]][:, :3], path, atol=1e-6)


def test_a_window_is_measured_alike_by_numpy_and_torch(clip: Motion) -> None:
    torch = pytest.importorskip("torch")
    features = encode(resample(clip, 30.0), LAYOUT)[:64].astype(float).reshape(2, 32, -1)
    found = window_values(torch.from_numpy(features), LAYOUT, torch).numpy()
    np.testing.assert_allclose(found, window_values(features, LAYOUT, np), atol=1e-12)
    assert found.shape == (2, 32, ConstraintLayout(LAYOUT).size)


def test_centres_of_pressure_come_from_the_moments_about_the_ankles() -> None:
    features = np.zeros((1, LAYOUT.size))
    blocks = LAYOUT.blocks
    ankle = blocks["positions"].start + 3 * POINTS.index("ankle_l")
    features[0, ankle : ankle + 3] = 0.1, 0.2, 0.1
    # A vertical force of .5 that acts .05 ahead of the ankle turns it about -y.
    features[0, blocks["wrenches"].start : blocks["wrenches"].start + 6] = 0.0, 0.0, 0.5, 0.0, -0.025, 0.0
    values = window_values(features, LAYOUT, np)[0]
    columns = ConstraintLayout(LAYOUT).blocks
    np.testing.assert_allclose(values[columns[CENTRES]], [0.15, 0.2, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(values[columns[FORCES]], [0.0, 0.0, 0.5, 0.0, 0.0, 0.0])


def test_what_is_asked_is_stored_in_units_of_the_human(nothing: Constraints) -> None:
    leg = nothing.body.leg
    asked = nothing.place("hand_r", [3, 5], [[leg, 0.0, np.nan], [0.0, leg, leg]]).path(7, heading=0.5)
    first = asked.layout.blocks[PLACES].start + 3 * POINTS.index("hand_r")
    np.testing.assert_allclose(asked.values[[3, 5], first : first + 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    assert asked.mask[[3, 5], first : first + 3].tolist() == [[True, True, False], [True, True, True]]
    assert asked.mask.sum() == 6 and asked.values[7, asked.layout.blocks[PATH]][3] == 0.5
    assert asked.asked and not nothing.asked  # what was asked before is unchanged


def test_places_of_several_points_are_asked_as_one_after_the_other(nothing: Constraints) -> None:
    rng = np.random.default_rng(6)
    points, told = ["heel_l", "hand_r", "toe_r"], rng.random((FRAMES, 3)) < 0.5
    told[:, 2] = False
    places = rng.normal(size=(FRAMES, 3, 3))
    begun = nothing.place("heel_l", 0, [0.1, 0.2, 0.3])
    expected = begun
    for number, point in enumerate(points):
        frames = np.flatnonzero(told[:, number]).tolist()
        expected = expected.place(point, frames, places[frames, number])
    found = begun.places(points, told, places)
    np.testing.assert_array_equal(found.mask, expected.mask)
    np.testing.assert_array_equal(found.values, expected.values)
    with pytest.raises(SamplingError, match="hand_r: 99.* m away"):
        begun.places(points, np.ones_like(told), np.where(np.arange(3)[:, None] == 1, [99.0, 0.0, 0.0], places))


def test_a_mean_place_is_a_point_or_a_line(nothing: Constraints) -> None:
    leg = nothing.body.leg
    point = nothing.mean_place([0.3, -0.2])
    assert [mean.value * leg for mean in point.means] == pytest.approx([0.3, -0.2])
    (line,) = nothing.mean_place([5.0, 0.4], direction=0.0).means  # along x: only the distance to the left counts
    assert line.weights == pytest.approx((0.0, 1.0, 0.0, 0.0)) and line.value * leg == pytest.approx(0.4)
    assert point.asked and not point.of_frames and not nothing.asked
    with pytest.raises(ValueError, match=r"place has shape \(3,\), expected \(2,\)"):
        nothing.mean_place([0.0, 0.0, 1.0])


def test_a_mean_at_the_end_leaves_out_how_a_window_begins() -> None:
    values = np.concatenate([np.full(8, 100.0), np.full(24, 2.0)])
    assert end_mean(values) == 2.0
    assert end_mean(np.column_stack([values, 2 * values])).tolist() == [2.0, 4.0]


def test_angles_of_a_ball_joint_are_its_rotation(nothing: Constraints) -> None:
    angles = np.array([0.4, -0.3, 0.2])
    asked = nothing.angles("shoulder_l", slice(None), angles).angles("knee_flexion_r", -1, 0.7)
    ball = asked.values[0, 4 + 6 + 6 * 4 : 4 + 6 + 6 * 5]
    balls = np.broadcast_to(np.eye(3), (1, 6, 3, 3)).copy()
    balls[0, 4] = matrix(ball)
    np.testing.assert_allclose(ball_angles(balls, np.zeros((6, 3)))[0, 4], angles, atol=1e-12)
    assert asked.mask.sum() == FRAMES * 6 + 1


@pytest.mark.parametrize(
    ("ask", "named"),
    [
        (lambda nothing: nothing.place("finger_r", 0, np.zeros(3)), "hand_r"),
        (lambda nothing: nothing.torque("knee_r", 0, 1.0), "knee_flexion_r"),
        (lambda nothing: nothing.angles("knee", 0, 1.0), "knee_flexion_r"),
        (lambda nothing: nothing.contact_force("left", 0, np.zeros(3)), "l, r"),
        (lambda nothing: nothing.activation(4, 0, 0.5), "0 to 3"),
        (lambda nothing: nothing.torque_limit("knee_flexion_r", 0, -1.0), "0 or more"),
        (lambda nothing: nothing.place("hand_r", [0, 1], np.zeros((3, 3))), r"\(2, 3\)"),
        (lambda nothing: nothing.place("hand_r", 99, np.zeros(3)), "frames 99: expected some of 0 to 31"),
        (lambda nothing: nothing.place("hand_r", [0, 32], np.zeros(3)), "expected some of 0 to 31"),
        (lambda nothing: nothing.height(slice(40, 50), 0.9), "expected some of 0 to 31"),
        (lambda nothing: nothing.place("hand_r", 20, [40.0, 0.0, 1.0]), "hand_r: 40 m away, expected 5.95 m at most"),
        (lambda nothing: nothing.place("hand_r", 0, [np.nan, 3.0, np.nan]), "3 m away, expected 1.95 m at most"),
        (lambda nothing: nothing.path([0, 31], [[0.0, 0.0], [0.0, 9.0]]), "path: 9 m away, expected 8.15 m at most"),
        (lambda nothing: nothing.height(0, 40.0), "height: 40 m away"),
        (lambda nothing: nothing.place("hand_r", 0, [np.inf, 0.0, 0.0]), "hand_r: inf m away"),
        (lambda nothing: nothing.torque("knee_flexion_r", 0, np.inf), "one is infinite"),
        (lambda nothing: nothing.mean_heading(np.nan), "mean heading: a value is nan"),
        (lambda nothing: nothing.mean_place([0.0, np.inf]), "mean place: a value is 0, inf"),
    ],
)
def test_what_cannot_be_asked_is_refused_with_what_can(nothing: Constraints, ask: object, named: str) -> None:
    """A hand 40 m away was sampled, a frame of no window was an IndexError, and nothing was an error of the library."""
    for kind in (FlexMotionError, ValueError):
        with pytest.raises(kind, match=named):
            ask(nothing)  # type: ignore[operator]
