"""The bundles that come with the package: the default one, and others by name."""

from __future__ import annotations

from pathlib import Path

from flexmotion.bundles.manifest import MANIFEST
from flexmotion.configs.errors import ConfigError

DATA = Path(__file__).parents[1] / "data"
FOLDER = DATA / "bundle"
NAMED = DATA / "bundles"
DEFAULT = "default"


def shipped_bundle() -> Path | None:
    """Folder of the default one; None where this installation has none."""
    return FOLDER if (FOLDER / MANIFEST).is_file() else None


def shipped_bundles() -> dict[str, Path]:
    """Folders of all of them by name: `DEFAULT`, and the folders in `NAMED`."""
    found = {} if shipped_bundle() is None else {DEFAULT: FOLDER}
    return found | {path.parent.name: path.parent for path in sorted(NAMED.glob(f"*/{MANIFEST}"))}


def bundle_folder(name: str | Path) -> Path:
    """Folder of a bundle by the name of a shipped one, or by its path.

    Raises:
        ConfigError: it is neither.
    """
    shipped = shipped_bundles()
    if str(name) in shipped:
        return shipped[str(name)]
    if Path(name).is_dir():
        return Path(name)
    raise ConfigError(f"{name}: no bundle there ('flexmotion export' makes one), nor one of: {', '.join(shipped)}")


def shipped_name(folder: Path) -> str | None:
    """Name of a shipped bundle in a folder; None for any other folder."""
    return next((name for name, shipped in shipped_bundles().items() if shipped.resolve() == folder.resolve()), None)
