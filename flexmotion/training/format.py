"""Version of the files in a training folder, and the check of it when they are read."""

from __future__ import annotations

from pathlib import Path

from flexmotion.configs.errors import ConfigError

FORMAT = 2
"""Version that is written.

1: files without a version. `last.pt` held the averaged weights without the number of weights averaged.
2: every file carries the version; `last.pt` holds the state of torch's `AveragedModel`.
"""

UNVERSIONED = 1


def check_format(found: object, path: Path, *, oldest: int, advice: str) -> None:
    """Check the version of a file.

    Args:
        found: version in the file; None where the file carries none.
        path: of the file, for the message.
        oldest: version that can still be read.
        advice: what to do with an older file.

    Raises:
        ConfigError: the file is too old, too new, or its version is no whole number.
    """
    version = UNVERSIONED if found is None else found
    if not isinstance(version, int):
        raise ConfigError(f"{path}: format {version!r} is not a whole number; the file is damaged")
    if version > FORMAT:
        raise ConfigError(
            f"{path}: format {version} is too new, this version of flexmotion reads {oldest} to {FORMAT}; "
            "update flexmotion"
        )
    if version < oldest:
        raise ConfigError(
            f"{path}: format {version} is too old, this version of flexmotion reads {oldest} to {FORMAT}; {advice}"
        )
