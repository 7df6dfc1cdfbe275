"""`joints_named`: the joints of a robot that a name of the body means: `knee` both, `left knee` one."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.retarget.legs import SIDE_NAMES

_PARTS: Mapping[str, tuple[str, tuple[str, ...]]] = MappingProxyType(
    {
        "hip": ("leg", ("hip",)),
        "knee": ("leg", ("knee",)),
        "ankle": ("leg", ("ank",)),
        "shoulder": ("arm", ("sho",)),
        "elbow": ("arm", ("el",)),
        "wrist": ("arm", ("wr",)),
        "neck": ("head", ("",)),
    }
)
"""A name of the body: the chains of the robot file that have it, and how the names of its parts there begin."""


def joints_named(robot: Robot, name: str) -> dict[str, int]:
    """The joints of a name, and their columns.

    Args:
        name: of a joint in the robot file; or of the body, with or without a side: `knee`, `left knee`, `hip`,
            `ankle`, `shoulder`, `elbow`, `wrist`, `neck`.

    Raises:
        ConfigError: the robot has no such joint; names those that it has.
    """
    if name in robot.joint_names:
        return {name: robot.joint_names.index(name)}
    side, _, part = name.rpartition(" ")
    found: dict[str, int] = {}
    if part in _PARTS and (not side or (side in SIDE_NAMES and _PARTS[part][0] != "head")):
        chains = robot.mapping.chains()
        for chain in _chains(part, side):
            parts = robot.chain(chain) if chain in chains else {}
            begins = _PARTS[part][1]
            found |= {robot.joint_names[joint]: joint for own, joint in parts.items() if own.startswith(begins)}
    if not found:
        names, joints = ", ".join(_PARTS), ", ".join(robot.joint_names)
        raise ConfigError(
            f"torque: joint: {name!r} is not known; expected {names}, one of them on the left or right, or {joints}"
        )
    return found


def _chains(part: str, side: str) -> tuple[str, ...]:
    """Names of the chains of the robot file that have a part."""
    chain = _PARTS[part][0]
    return ("head",) if chain == "head" else tuple(f"{one}_{chain}" for one in SIDE_NAMES if side in ("", one))
