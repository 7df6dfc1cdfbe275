"""Version of the files in a training folder, and which versions of each are read."""

from __future__ import annotations

from flexmotion.configs.versions import FormatVersions

FORMAT = 3
"""Version that is written.

1: files without a version. `last.pt` held the averaged weights without the number of weights averaged.
2: every file carries the version; `last.pt` holds the state of torch's `AveragedModel`.
3: features with joint contact forces, external loads and error estimates.
"""

UNVERSIONED = 1
"""Version of a file that carries none."""


def _read_from(oldest: int, kind: str, migration: str) -> FormatVersions:
    return FormatVersions(kind, oldest, FORMAT, migration, field="format")


CONFIG_VERSIONS = _read_from(1, "training configuration", "train again in an empty folder")
FEATURES_VERSIONS = _read_from(1, "feature store", "remove the folder and name the training set again")
MUSCLES_VERSIONS = _read_from(1, "fit of muscle torques", "remove the file and name the training set again")
CHECKPOINT_VERSIONS = _read_from(
    1, "checkpoint", "finish the stage with the release that began it, or train in an empty folder"
)
