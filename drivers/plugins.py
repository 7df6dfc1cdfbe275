"""`PlugIns`: classes by name, built in or installed by anyone under an entry-point group.

A plug-in that fails to import is reported and left out; the others work.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

from flexmotion.configs.errors import ConfigError

Kind = TypeVar("Kind")

log = logging.getLogger(__name__)


class PlugIns(Generic[Kind]):
    """Subclasses of one base.

    Args:
        group: of the entry points.
        what: they are called in messages.
        base: that every one is a subclass of.
        built_in: those of this project, `module:Class` by name. They are entry points of its distribution too, but
            those exist only once something is installed: this table lets a plain checkout find them. They win over
            plug-ins of the same name, so that no package can slip in front of one that moves hardware.
    """

    def __init__(self, group: str, what: str, base: type[Kind], built_in: Mapping[str, str]) -> None:
        self.group, self.what, self.base, self.built_in = group, what, base, built_in

    def names(self) -> tuple[str, ...]:
        """All that are registered, whether or not they import."""
        return tuple(sorted(self._entries()))

    def available(self) -> dict[str, type[Kind]]:
        """Every one that imports, by name; the others are logged as warnings."""
        found = {}
        for name, entry in sorted(self._entries().items()):
            try:
                found[name] = self._load(entry)
            except ConfigError as error:
                log.warning("%s", error)
        return found

    def get(self, name: str) -> type[Kind]:
        """The one of that name. Raises `ConfigError` where there is none or it does not import."""
        entries = self._entries()
        if name not in entries:
            raise ConfigError(f"unknown {self.what} {name!r}, expected one of: {', '.join(sorted(entries))}")
        return self._load(entries[name])

    def _entries(self) -> dict[str, EntryPoint]:
        entries = {name: EntryPoint(name, value, self.group) for name, value in self.built_in.items()}
        for entry in entry_points(group=self.group):
            known = entries.setdefault(entry.name, entry)
            if known.value != entry.value:
                log.warning("%s %r of %s is ignored: %s has that name", self.what, entry.name, entry.value, known.value)
        return entries

    def _load(self, entry: EntryPoint) -> type[Kind]:
        """The class that an entry point names. Raises `ConfigError` whatever a plug-in's import raises."""
        try:
            found: Any = entry.load()
        except Exception as error:
            reason = " ".join(str(error).split())
            raise ConfigError(
                f"{self.what} {entry.name!r} ({entry.value}) does not load: {type(error).__name__}: {reason}"
            ) from error
        if not (isinstance(found, type) and issubclass(found, self.base)):
            base = f"{self.base.__module__}.{self.base.__qualname__}"
            raise ConfigError(f"{self.what} {entry.name!r} ({entry.value}) is no subclass of {base}")
        return found
