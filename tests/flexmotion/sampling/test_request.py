"""Conditions to what the shipped model's network is asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.sampling.condition import Condition
from flexmotion.sampling.request import Requests


@pytest.mark.parametrize("turning", [0.5, -0.5])
def test_a_turn_on_the_spot_may_be_a_number_of_numpy(bundle: Path, turning: float) -> None:
    """A velocity of NumPy floats raised a TypeError: a comparison of them is no index of a tuple."""
    requests = Requests(Bundle(bundle))
    assert requests.one_speed(Condition(velocity=(-0.5, 0.0, 0.0))) is not None  # it reads the words of a velocity
    numbers = (np.float64(0.0), np.float64(0.0), np.float64(turning))
    assert requests.one_speed(Condition(velocity=numbers)) is None
