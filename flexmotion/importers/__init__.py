"""Motion files of any kind to `Motion`."""

from flexmotion.importers.load import Import, load, read

__all__ = ["Import", "load", "read"]
