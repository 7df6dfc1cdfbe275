"""Split of the clips into training and validation, by rules that depend on names only."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

BUCKETS = 100
VALIDATION_BUCKETS = range(12, 22)
"""Buckets of the Bandai clips for validation. Takes of one content and style are near-duplicates and may be in both
splits, so a whole style is held out as well."""

HELD_OUT_STYLE = "happy"


def bucket(file_name: str) -> int:
    """SHA-256 of a file's name as an integer, modulo 100."""
    return int(hashlib.sha256(file_name.encode()).hexdigest(), 16) % BUCKETS


def split_of(collection: str, file_name: str, labels: Mapping[str, str]) -> str:
    """`train` or `validation`, or the split in the index.

    Args:
        collection: of the clip.
        file_name: with its suffix.
        labels: the clip's row in its index; may be empty.
    """
    if labels.get("split"):
        return {"val": "validation", "valid": "validation"}.get(labels["split"], labels["split"])
    if collection == "bandai":
        held_out = labels.get("style") == HELD_OUT_STYLE or bucket(file_name) in VALIDATION_BUCKETS
        return "validation" if held_out else "train"
    return "train"
