"""Where a robot rested before the step that it makes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.planning.standstill import LastRest

RATE = 100.0
DOWN, LEFT_UP, RIGHT_UP, NO_PLAN = (True, True), (False, True), (True, False), (False, False)


class Rows:
    """Rows of a robot that walks along x, read by a `LastRest`."""

    def __init__(self) -> None:
        self.rest, self.tick = LastRest(RATE), 0
        self.row = TickRow(blank(TickRow.dtype(joints=1)))
        self.row.foot_ref[...], self.row.com_ref[...], self.row.base_ref[...] = 0.0, 0.0, [0, 0, 0, 1, 0, 0, 0]

    def run(self, contacts: tuple[bool, bool], seconds: float = 0.3, x: float = 0.0) -> None:
        """Rows with the same contacts and odometry for so long."""
        self.row.contact_ref[...], self.row.odometry[...] = contacts, [x, 0.0, 0.0]
        for _ in range(round(seconds * RATE)):
            self.tick += 1
            self.row.tick[...] = self.tick
            self.rest.update(self.row)


def test_a_robot_rested_where_it_stood_before_its_first_step() -> None:
    rows = Rows()
    rows.run(NO_PLAN, 1.0)
    assert rows.rest.place is None
    rows.run(DOWN, 1.0, x=0.1)
    rows.run(LEFT_UP, x=0.2)
    assert rows.rest.place is not None and rows.rest.place[0] == 0.1
    rows.run(DOWN, 0.1, x=0.3)
    rows.run(RIGHT_UP, x=0.4)
    assert rows.rest.place is None


def test_a_step_is_counted_where_the_row_between_two_of_them_was_missed() -> None:
    """Regression: both feet were down for six ticks while a plan was made: two steps counted as one."""
    rows = Rows()
    rows.run(DOWN, 1.0)
    rows.run(LEFT_UP, x=0.1)
    rows.run(RIGHT_UP, x=0.2)
    assert rows.rest.place is None


def test_a_rest_before_the_robot_was_parked_is_forgotten() -> None:
    """Regression: the odometry begins anew, and the first walk after a park was measured from the place before it."""
    rows = Rows()
    rows.run(DOWN, 1.0, x=3.0)
    rows.run(NO_PLAN, 5.0, x=np.nan)
    rows.run(DOWN, 0.2)
    assert rows.rest.place is None
    rows.run(DOWN, 0.4)
    assert rows.rest.place is not None and rows.rest.place[0] == 0.0


def test_a_robot_rests_where_its_feet_are_and_not_where_its_torso_looks() -> None:
    """Regression: a turn after a look to the side was measured from where the torso looked."""
    rows = Rows()
    rows.row.base_ref[3:] = Rotation.from_euler("z", 0.5).as_quat(scalar_first=True)
    rows.run(DOWN, 1.0)
    assert rows.rest.place == pytest.approx([0.0, 0.0, -0.5])


def test_a_rest_without_odometry_is_not_known() -> None:
    rows = Rows()
    rows.run(DOWN, 1.0, x=np.nan)
    assert rows.rest.place is None
