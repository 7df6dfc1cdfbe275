"""`fm.retarget_motion`: what it takes, and what it says of anything else."""

from __future__ import annotations

from typing import Any

import pytest

import flexmotion as fm
from flexmotion.importers.default_clip import default_clip


@pytest.mark.parametrize("given", ["walk.bvh", None, 3.0])
def test_what_is_no_motion_is_refused_by_name(given: Any) -> None:
    """Went wrong: "'str' object has no attribute 'source'"."""
    with pytest.raises(fm.ConfigError, match=r"motion: .*, expected a Motion, as of fm\.load_motion"):
        fm.retarget_motion(given, "op3")


def test_a_robot_may_be_named_as_for_a_session() -> None:
    """Went wrong: "'str' object has no attribute 'gait'"."""
    found = fm.retarget_motion(default_clip()[:30], "op3")
    assert found.q.shape[1] == fm.open_robot("op3").n
