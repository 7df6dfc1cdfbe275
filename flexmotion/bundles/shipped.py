"""The bundle that comes with the package."""

from __future__ import annotations

from pathlib import Path

from flexmotion.bundles.manifest import MANIFEST

FOLDER = Path(__file__).parents[1] / "data" / "bundle"


def shipped_bundle() -> Path | None:
    """Its folder; None where this installation has none."""
    return FOLDER if (FOLDER / MANIFEST).is_file() else None
