"""`FormatVersions`: which versions of a file format this release reads, and what to do about the others."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from flexmotion.configs.errors import ConfigError


@dataclass(frozen=True)
class FormatVersions:
    """The versions of one file format that this release reads: all from `oldest` to `newest`.

    Attributes:
        kind: of file, for messages ("robot file").
        oldest, newest: versions that are read.
        migration: what to do with an older file, for messages.
        field: of the file that holds the version, for messages.
    """

    kind: str
    oldest: int
    newest: int
    migration: str
    field: str = "version"

    def check(self, version: object, origin: Path | str, writer: str = "the FlexMotion release that wrote it") -> None:
        """Raise `ConfigError` if a file of this version is not read.

        Args:
            version: as written in the file.
            origin: the file, for messages.
            writer: release that wrote the file, for messages; `{writer}` in `migration` is replaced by it.
        """
        read = str(self.newest) if self.oldest == self.newest else f"{self.oldest} to {self.newest}"
        if not isinstance(version, int) or isinstance(version, bool):
            raise ConfigError(
                f"{origin}: field {self.field}: {version!r}, expected a whole number; this release reads {read}"
            )
        found = f"{origin}: field {self.field}: {self.kind} of version {version}, this release reads {read}"
        if version > self.newest:
            raise ConfigError(f"{found}: the file is too new: install {writer}, or newer")
        if version < self.oldest:
            raise ConfigError(f"{found}: the file is too old: {self.migration.format(writer=writer)}")
