"""`PlugIns`: classes by name, built-in ones and those of an entry-point group.

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
        group: entry-point group.
        what: name of the kind of class, for messages.
        base: common base class.
        built_in: classes of this project, `module:Class` by name. They are entry points of its distribution too; this
            table finds them in a checkout that is not installed. They take precedence over plug-ins of the same name,
            so that no package can replace one that moves hardware.
    """

    def __init__(self, group: str, what: str, base: type[Kind], built_in: Mapping[str, str]) -> None:
        self.group, self.what, self.base, self.built_in = group, what, base, built_in

    def names(self) -> tuple[str, ...]:
        """Names of all registered classes, whether or not they can be imported."""
        return tuple(sorted(self._entries()))

    def available(self) -> dict[str, type[Kind]]:
        """Every class that can be imported, by name; a warning is logged for each of the others."""
        found = {}
        for name, entry in sorted(self._entries().items()):
            try:
                found[name] = self._load(entry)
            except ConfigError as error:
                log.warning("%s", error)
        return found

    def get(self, name: str) -> type[Kind]:
        """The class of that name. Raises `ConfigError` if there is none or it cannot be imported."""
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
        """The class that an entry point names. Raises `ConfigError` for every exception of the import."""
        try:
            found: Any = entry.load()
        except Exception as error:
            reason = " ".join(str(error).split())
            raise ConfigError(
                f"{self.what} {entry.name!r} ({entry.value}) does not load: {type(error).__name__}: {reason}"
            ) from error
        if not (isinstance(found, type) and issubclass(found, self.base)):
            base = f"{self.base.__module__}.{self.base.__qualname__}"
            raise ConfigError(f"{self.what} {entry.name!r} ({entry.value}) is not a subclass of {base}")
        return found
