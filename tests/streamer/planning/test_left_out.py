"""Which held parts a motion is made without."""

from __future__ import annotations

import pytest

from flexmotion.streamer.planning.left_out import left_out

RIGHT, LEFT, HEAD = ("right_arm", "right hand"), ("left_arm", "joint l_el"), ("head", "head")


@pytest.mark.parametrize(
    ("kind", "missing", "perhaps"),
    [
        ("wave-right-hand", ["right hand"], []),
        ("wave-left-hand", ["joint l_el"], []),
        ("raise-up-both-hands", ["right hand", "joint l_el"], []),
        ("bye", [], ["right hand", "joint l_el"]),  # with either arm
        ("nod", ["head"], []),
        ("look-left", ["head"], []),
        ("bow", [], []),  # the trunk bends, whatever the head looks at
        ("crouch", [], []),
        ("walk", [], []),
        ("stand", [], []),
        ("velocity", [], []),
        ("clip", [], []),
    ],
)
def test_a_held_part_was_told_in_no_answer_to_a_motion_that_moves_it(
    kind: str, missing: list[str], perhaps: list[str]
) -> None:
    assert left_out(kind, [RIGHT, LEFT, HEAD]) == (missing, perhaps)
