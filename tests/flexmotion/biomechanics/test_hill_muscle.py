"""Force curves and parameters of the leg muscles."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.biomechanics.hill_muscle import HillMuscles, force_length, force_velocity, leg_muscles


def test_force_curves_have_their_fixed_points() -> None:
    assert force_length(np.array([1.0]))[0] == pytest.approx(1.0, abs=0.01)
    assert force_velocity(np.array([0.0]))[0] == pytest.approx(1.0, abs=0.01)
    assert force_velocity(np.array([-1.0, -2.0])) == pytest.approx(0.0, abs=0.02)
    speeds = np.linspace(-1.0, 1.0, 50)
    assert (np.diff(force_velocity(speeds)) >= 0).all()
    assert force_velocity(np.array([1.0]))[0] < 1.9


def test_force_length_curve_is_that_of_the_2016_model() -> None:
    """Without its stretch the source's curve is 36 % weaker at fibre length 1.4."""
    lengths = np.array([0.6, 0.7, 0.8, 0.9, 1.1, 1.2, 1.3, 1.4])
    # Millard's curve (J. Biomech. Eng. 135, 2013) with the 2016 model's parameters .25, .77, 1.9, .75.
    published = np.array([0.619, 0.801, 0.887, 0.962, 0.961, 0.843, 0.719, 0.594])
    assert force_length(lengths) == pytest.approx(published, abs=0.06)


def test_tension_follows_pennation_and_tendon() -> None:
    muscle = HillMuscles(*(np.array([value]) for value in (1000.0, 0.1, 0.2, 0.3)))
    optimal = 0.2 + 0.1 * np.cos(0.3)
    assert muscle.tension(np.array([optimal]), np.zeros(1))[0] == pytest.approx(1000 * np.cos(0.3), rel=0.02)
    # One tenth of the greatest shortening speed.
    slower = muscle.tension(np.array([optimal]), np.array([-0.1]))[0]
    assert 0.6 * 1000 < slower < 0.8 * 1000
    # A path shorter than the tendon is slack.
    assert muscle.tension(np.array([0.15]), np.zeros(1))[0] < 5.0


def test_leg_muscles_have_published_parameters() -> None:
    """MyoLegs has optimal fibres of 171 mm for rectus femoris (published: 76), 408 mm for glmax3 (167)."""
    found = leg_muscles(("recfem", "glmax3", "soleus"))
    assert found.fibre == pytest.approx([0.0759, 0.167, 0.044], abs=1e-3)
    assert found.force == pytest.approx([2191.7, 947.8, 6194.8], rel=0.01)
