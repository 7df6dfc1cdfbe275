"""`KEY=VALUE` options of a driver."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import typer
import yaml

from flexmotion.drivers.sim.options import standard_options


def parse_options(pairs: Sequence[str]) -> dict[str, Any]:
    """Options by name; values are YAML (`friction=0.6`, `slope_deg=[1, 0]`). The driver checks the names."""
    options: dict[str, Any] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key:
            raise typer.BadParameter(f"expected KEY=VALUE, found {pair!r}")
        if key == "seed":
            raise typer.BadParameter("the seed is set by --seed")
        try:
            options[key] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            raise typer.BadParameter(f"{key}: not a YAML value: {value!r}") from error
    return options


def simulation_options(perturbed: bool, pairs: Sequence[str]) -> dict[str, Any]:
    """Options of driver `sim`: the standard perturbations if `perturbed`, overridden by single ones."""
    return standard_options(perturbed) | parse_options(pairs)
