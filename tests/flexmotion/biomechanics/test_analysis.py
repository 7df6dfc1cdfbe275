"""One clip in full: its figures, what is refused, and its place in a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.biomechanics.analysis import ClipAnalysis, Recording, analyse
from flexmotion.biomechanics.differentiation import EDGE, second_derivative
from flexmotion.biomechanics.joint_contact import compression, stance_peaks
from flexmotion.configs.errors import ConfigError, MotionFormatError
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.spatial.gravity import GRAVITY


@pytest.fixture(scope="module")
def analysed(clip: Motion) -> ClipAnalysis:
    return analyse(clip[:60], muscles=False)


def test_standing(make_standing) -> None:
    figures = analyse(make_standing(frames=30), muscles=False).figures()
    assert figures["peak_vertical_force_bw"]["left"] == pytest.approx(0.5, abs=0.02)
    assert figures["peak_vertical_force_bw"]["right"] == pytest.approx(0.5, abs=0.02)
    assert figures["good_share"] == figures["contact_share"] == 1.0
    assert figures["residual_force_median_bw"] < 0.01
    assert "saturated_share" not in figures


def test_figures_scale_with_body_weight(clip: Motion) -> None:
    light, heavy = (
        analyse(replace(clip[:40], body=replace(clip.body, mass=mass)), muscles=False).figures()
        for mass in (50.0, 100.0)
    )
    for name, value in light["peak_moment_nm_per_kg"].items():
        assert heavy["peak_moment_nm_per_kg"][name] == pytest.approx(value, abs=1e-6)
    assert heavy["peak_vertical_force_bw"] == pytest.approx(light["peak_vertical_force_bw"], abs=1e-6)


@pytest.mark.parametrize("cutoff", [0.0, -6.0, 15.0, 40.0, float("nan")])
def test_cutoff_is_between_zero_and_half_the_frame_rate(cutoff: float, make_standing) -> None:
    with pytest.raises(ConfigError, match="less than half the frame rate of 30 Hz"):
        analyse(make_standing(frames=30), cutoff, muscles=False)


@pytest.mark.parametrize(("fps", "frames", "least"), [(30.0, 18, "0.6 s"), (100.0, 60, "0.6 s"), (15.0, 12, "0.8 s")])
def test_too_short(fps: float, frames: int, least: str, make_standing) -> None:
    with pytest.raises(MotionFormatError, match=f"expected at least {least}"):
        analyse(make_standing(frames=frames, fps=fps), muscles=False)
    assert len(analyse(make_standing(frames=frames + 1, fps=fps), muscles=False)) == frames + 1


@given(turn=st.floats(-3.0, 3.0), x=st.floats(-5.0, 5.0), belt=st.tuples(st.floats(-4.0, 4.0), st.floats(-1.0, 1.0)))
def test_newton_holds_in_the_axes_of_the_recording(
    analysed: ClipAnalysis, turn: float, x: float, belt: tuple[float, float]
) -> None:
    """Centre of mass and forces are moved together: force = mass x (acceleration + g) in any axes, on any belt."""
    placed = Recording(turn=turn, origin=(x, 0.0), belt=belt).placed(analysed.dynamics)
    motion = placed.motion
    assert motion.wrenches is not None and motion.torques is not None
    acceleration = second_derivative(forward(motion).com, motion.fps)
    needed = motion.body.mass * (acceleration + [0.0, 0.0, GRAVITY])
    given_force = motion.wrenches[..., :3].sum(axis=1) + motion.torques[:, :3]
    assert given_force[EDGE:-EDGE] == pytest.approx(needed[EDGE:-EDGE], abs=0.5)


@given(turn=st.floats(-3.0, 3.0), x=st.floats(-5.0, 5.0), belt=st.tuples(st.floats(-4.0, 4.0), st.floats(-1.0, 1.0)))
def test_centres_of_pressure_stay_under_the_feet(
    analysed: ClipAnalysis, turn: float, x: float, belt: tuple[float, float]
) -> None:
    before = analysed.dynamics
    after = Recording(turn=turn, origin=(x, 0.0), belt=belt).placed(before)
    distances = [np.linalg.norm(forward(found.motion).toe - found.centres, axis=-1) for found in (before, after)]
    assert distances[1] == pytest.approx(distances[0], abs=1e-9)


def test_muscles(clip: Motion) -> None:
    pytest.importorskip("myo_sim", reason="extra biomech")
    found = analyse(clip[:30])
    assert found.muscles is not None
    assert found.muscles.state.activations.shape == (30, len(found.muscles.names))
    figures = found.figures()
    assert 0.3 < figures["peak_compression_bw"]["knee_l"] < 10.0
    assert figures["stance_compression_bw"]["knee_l"] is None, "standing has no stance phase"
    assert set(figures["saturated_muscles"]) <= set(found.muscles.names[: found.muscles.legs])
    assert (figures["saturated_share"] > 0) == bool(figures["saturated_muscles"])


def test_ends_of_a_clip_have_no_peaks(clip: Motion) -> None:
    """Regression: accelerations at the ends, known from one side, gave the greatest force of a clip."""
    found = analyse(clip[:40], muscles=False)
    expected = found.figures()
    wrenches, torques = found.dynamics.motion.wrenches, found.dynamics.motion.torques
    assert wrenches is not None and torques is not None
    wrenches[EDGE - 1] = wrenches[-EDGE] = 1e5
    torques[0] = torques[-1] = 1e5
    figures = found.figures()
    assert figures["peak_vertical_force_bw"] == expected["peak_vertical_force_bw"]
    assert figures["peak_moment_nm_per_kg"] == expected["peak_moment_nm_per_kg"]


def test_peaks_of_stance_phases_are_compression_of_whole_good_phases() -> None:
    """Regression: peaks of contact were lengths of the force over all frames, beside targets of compression."""
    fps, frames = 20.0, 60
    contacts, good = np.zeros((frames, 2), bool), np.ones(frames, bool)
    # Left: two phases, one of them at the end of the clip; right: one, with a frame that is not good.
    contacts[10:20, 0] = contacts[45:, 0] = contacts[25:40, 1] = True
    good[30] = False
    contact = np.zeros((frames, 3, 3))
    contact[..., 2], contact[..., 0] = -100.0, 1e4
    contact[15, :, 2], contact[22, :, 2], contact[50, :, 2] = -300.0, -800.0, -900.0
    contact[:, 2, 2] *= -1.0
    crossings = ("knee_l", "knee_r", "lumbar")
    pressed = compression(contact, crossings, 100.0)
    assert pressed[0] == pytest.approx(1.0)
    found = stance_peaks(pressed, crossings, contacts, good, fps)
    assert found[[0, 2]] == pytest.approx(3.0) and np.isnan(found[1])


def test_a_foot_in_the_air_has_its_centre_of_pressure_below_its_sole(clip: Motion, make_standing) -> None:
    """A solver's rest of 1e-15 N on a lifted foot put the centre of pressure at the origin of the world."""
    motion = make_standing(frames=30, hip_flexion_l=1.2, knee_flexion_l=1.2)
    away = replace(motion, root_position=motion.root_position + [3.0, 2.0, 0.0])
    found = analyse(away, muscles=False).dynamics
    assert found.motion.wrenches is not None
    assert np.abs(found.motion.wrenches[:, 0, 2]).max() < 1e-3
    feet = forward(found.motion)
    middle = (feet.heel + feet.toe)[:, 0, :2] / 2
    assert np.abs(found.centres[:, 0, :2] - middle).max() < 0.15
