"""`need`: the libraries of transports, which are extras."""

from __future__ import annotations

from importlib.util import find_spec

from flexmotion.configs.errors import ConfigError


def need(module: str, option: str, extra: str) -> None:
    """Raise `ConfigError` where the library of an option is not installed."""
    if find_spec(module) is None:
        raise ConfigError(f"{option} needs the package {module}: pip install 'flexmotion[{extra}]'")
