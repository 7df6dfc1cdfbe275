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
        found = _found(robot, part, side)
    if not found:
        names = ", ".join(own for own in _PARTS if _found(robot, own, ""))
        joints = ", ".join(robot.joint_names)
        raise ConfigError(
            f"torque: joint: {name!r} is not known; expected {names}, one of them on the left or right, or {joints}"
        )
    return found


def _found(robot: Robot, part: str, side: str) -> dict[str, int]:
    """The joints of a part that the robot has on a side, "" for both, and their columns."""
    chains, begins = robot.mapping.chains(), _PARTS[part][1]
    return {
        robot.joint_names[joint]: joint
        for chain in _chains(part, side)
        for own, joint in (robot.chain(chain) if chain in chains else {}).items()
        if own.startswith(begins)
    }


def _chains(part: str, side: str) -> tuple[str, ...]:
    """Names of the chains of the robot file that have a part."""
    chain = _PARTS[part][0]
    return ("head",) if chain == "head" else tuple(f"{one}_{chain}" for one in SIDE_NAMES if side in ("", one))
