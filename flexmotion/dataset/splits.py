"""Which clips train, and which are held out: by rules that depend on a clip's name alone."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

BUCKETS = 100
VALIDATION_BUCKETS = range(12, 22)
"""Of the Bandai clips; takes of one content and style are near-duplicates and may fall on both sides, which is why a
whole style is held out as well."""

HELD_OUT_STYLE = "happy"


def bucket(file_name: str) -> int:
    """SHA-256 of a file's name, as a whole number, modulo a hundred."""
    return int(hashlib.sha256(file_name.encode()).hexdigest(), 16) % BUCKETS


def split_of(collection: str, file_name: str, labels: Mapping[str, str]) -> str:
    """`train` or `validation` (or what the index says).

    Args:
        collection: what the clip belongs to.
        file_name: with its suffix.
        labels: the clip's row in its index; may be empty.
    """
    if labels.get("split"):
        return {"val": "validation", "valid": "validation"}.get(labels["split"], labels["split"])
    if collection == "bandai":
        held_out = labels.get("style") == HELD_OUT_STYLE or bucket(file_name) in VALIDATION_BUCKETS
        return "validation" if held_out else "train"
    return "train"
