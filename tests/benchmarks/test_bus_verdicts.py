"""When the campaign of false readings passes."""

from __future__ import annotations

import pytest

from benchmarks.bus.faults import verdicts_of_lies

GOOD = {"minutes": 10.0, "faults": 0.0, "falls": 0.0, "violations": 0.0, "jump_deg": 3.0, "false": 900.0}
GOOD |= {"disbelieved": 800.0}


def test_a_campaign_of_lies_that_did_no_harm_passes() -> None:
    assert all(verdict.holds for verdict in verdicts_of_lies(0.01, GOOD))


@pytest.mark.parametrize("nothing", ["false", "disbelieved"])
def test_a_campaign_in_which_nothing_lied_or_no_lie_was_seen_fails(nothing: str) -> None:
    """It passed: with no false reading there is no jump either."""
    assert not all(verdict.holds for verdict in verdicts_of_lies(0.01, GOOD | {nothing: 0.0}))
