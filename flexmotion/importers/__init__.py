"""Importers of motion files."""

from flexmotion.importers.load import Import, load, read

__all__ = ["Import", "load", "read"]
