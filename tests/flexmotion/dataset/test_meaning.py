"""Kind and manner of clips, from labels and from captions."""

from __future__ import annotations

import pytest

from flexmotion.dataset.meaning import clip_kind, clip_manner


@pytest.mark.parametrize(
    ("labels", "captions", "kind", "manner"),
    [
        ({"content": "bow", "style": "elderly"}, [], "bow", "old"),
        ({"content": "bow", "style": "of no table"}, [], "bow", None),
        ({"content": "nod"}, ["nod twice"], "nod", "normal"),
        ({"action": "walk"}, ["walk", "A person walks straight forward."], "walk", "normal"),
        ({"action": "walk"}, ["walk, exaggerated stride"], "walk", "normal"),
        ({"action": "walk"}, ["walk like an old man"], "walk", "old"),
        ({"action": "walk"}, ["a man limps and walks like a zombie"], "walk", None),
        ({}, ["a person waves with both hands"], "wave-both-hands", "normal"),
        ({}, ["someone steps to the left"], "walk-left", "normal"),
        ({}, ["a man walks slowly backwards"], "walk-back", "normal"),
        # More than one kind, or none that is known.
        ({"action": "walk"}, ["walk forward, turn around, walk back"], "", None),
        ({"action": "walk"}, ["walk on uneven terrain"], "", None),
        ({"action": "run"}, ["jumping jacks, side twists, squats, jog"], "", None),
        ({"action": "climb"}, ["climb ladder"], "", None),
        ({}, ["a person walks and waves with both hands"], "", None),
        # An index alone.
        ({"action": "run"}, [], "run", "normal"),
        ({}, [], "", None),
    ],
)
def test_kind_and_manner(labels: dict[str, str], captions: list[str], kind: str, manner: str | None) -> None:
    """Regression: "walk forward, turn around, walk back" was taught as walking ahead."""
    assert (clip_kind(labels, captions), clip_manner(labels, captions)) == (kind, manner)
