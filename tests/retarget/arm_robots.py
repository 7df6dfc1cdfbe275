"""Robot files like the OP3's with other arms: fewer joints, a turning upper arm, a wrist."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import yaml

from flexmotion.configs.robot import ROBOTS

_PARTS = {
    1: ("sho_pitch",),
    2: ("sho_pitch", "sho_roll"),
    3: ("sho_pitch", "sho_roll", "el"),
    4: ("sho_pitch", "sho_roll", "sho_yaw", "el"),
    6: ("sho_pitch", "sho_roll", "sho_yaw", "el", "wr_yaw", "wr_pitch"),
}
"""Arm joints of each robot, from torso to hand."""
_ADDED: Mapping[str, tuple[str, list[float], list[float]]] = {
    "sho_yaw": ("sho_roll_link", [0, 1, 0], [-0.019, 0.05, 0]),
    "wr_yaw": ("wr_link", [0, 0, 1], [0, 0, 0]),
    "wr_pitch": ("wr_link", [1, 0, 0], [0, 0, 0]),
}
"""Joints that the OP3 lacks: body, axis and position in it, of the left side."""


def with_arms(folder: Path, joints: int) -> Path:
    """Write the folder of an OP3 whose arms have so many joints; returns it."""
    parts, target = _PARTS[joints], folder / "armed"
    target.mkdir()
    spec = mujoco.MjSpec.from_file(str(ROBOTS / "op3" / "op3.xml"))
    content: dict[str, Any] = yaml.safe_load((ROBOTS / "op3" / "op3.yaml").read_text(encoding="utf-8"))
    for prefix, side, sign in (("l", "left", 1), ("r", "right", -1)):
        for part in set(_PARTS[3]) - set(parts):
            spec.delete(spec.joint(f"{prefix}_{part}"))
        if "wr_yaw" in parts:
            wrist = spec.body(f"{prefix}_el_link").add_body(name=f"{prefix}_wr_link", pos=[-0.019, sign * 0.09, 0.002])
            wrist.add_geom(size=[0.01, 0, 0], mass=0.01, contype=0, conaffinity=0)
            content["hands"][side] = {"body": f"{prefix}_wr_link", "point": [0, sign * 0.022, 0]}
        for part in [part for part in parts if part in _ADDED]:
            body, axis, (x, y, z) = _ADDED[part]
            spec.body(f"{prefix}_{body}").add_joint(
                name=f"{prefix}_{part}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, pos=[x, sign * y, z]
            )
            content["joints"].append(
                {
                    "name": f"{prefix}_{part}",
                    "servo": "XM430-W350",
                    "id": 20 + len(content["joints"]),
                    "limits": [-1.5, 1.5],
                }
            )
        content["mapping"][f"{side}_arm"] = {part: f"{prefix}_{part}" for part in parts}
    kept = {joint.name for joint in spec.joints}
    content["joints"] = [joint for joint in content["joints"] if joint["name"] in kept]
    for pose in ("stand_pose", "rest_pose"):
        content[pose] = {name: angle for name, angle in content[pose].items() if name in kept}
    content["name"], content["mjcf"] = "armed", "armed.xml"
    spec.compile()
    (target / "armed.xml").write_text(spec.to_xml(), encoding="utf-8")
    (target / "armed.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return target
