from __future__ import annotations

import numpy as np

from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.control.tick_row import TickRow


def test_a_published_row_leaves_counts_and_no_measurement() -> None:
    telemetry = Telemetry(3, 10.0)
    for _, values in telemetry.row:
        values[...] = 1
    telemetry.commit()
    for name, values in telemetry.row:
        assert np.isnan(values).all() if values.dtype.kind == "f" else (values == 1).all(), name
    row = telemetry.ticks.latest()
    assert row is not None
    assert all((values == 1).all() for _, values in TickRow({name: row[name] for name in TickRow.names()}))
