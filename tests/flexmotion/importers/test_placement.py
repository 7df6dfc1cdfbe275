"""Where a motion lies in its file."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.importers.load import Placement


def test_axes_of_a_file_with_y_up_have_its_x_ahead() -> None:
    """A human who faces x of a file with y up: the importer takes that file's z, x, y as x, y, z."""
    placement = Placement(heading=np.pi / 2, origin=(3.0, 2.0, 0.0), up="y")
    heading, origin = placement.on_floor
    assert heading == pytest.approx(0.0)
    # In the file the origin is at x = 2, z = 3.
    assert origin == pytest.approx((2.0, -3.0))
    assert Placement(heading=0.4, origin=(3.0, 2.0, 0.0)).on_floor == (0.4, (3.0, 2.0))
