"""Frames of a person for the tests: the shipped clip, and bones of the Virtual Motion Capture protocol."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder

from flexmotion.human.motion import Motion
from flexmotion.streamer.commands.choice import choose_motion

T_POSE: dict[str, tuple[float, float, float]] = {
    "Hips": (0.0, 0.9, 0.0),
    "Spine": (0.0, 0.1, 0.0),
    "Chest": (0.0, 0.15, 0.0),
    "Neck": (0.0, 0.25, 0.0),
    "Head": (0.0, 0.1, 0.0),
    **{f"{side}UpperLeg": (x * 0.09, 0.0, 0.0) for side, x in (("Left", -1), ("Right", 1))},
    **{f"{side}LowerLeg": (0.0, -0.42, 0.0) for side in ("Left", "Right")},
    **{f"{side}Foot": (0.0, -0.40, 0.0) for side in ("Left", "Right")},
    **{f"{side}UpperArm": (x * 0.17, 0.2, 0.0) for side, x in (("Left", -1), ("Right", 1))},
    **{f"{side}LowerArm": (x * 0.27, 0.0, 0.0) for side, x in (("Left", -1), ("Right", 1))},
    **{f"{side}Hand": (x * 0.25, 0.0, 0.0) for side, x in (("Left", -1), ("Right", 1))},
}
"""Places in the bone above, in Unity's axes: x right, y up, z forward [m]; all turns are zero."""


def shipped(seconds: float = 4.0) -> Motion:
    """The beginning of the shipped clip, at 30 frames a second."""
    motion = choose_motion()
    return motion[: round(seconds * motion.fps)]


def message(address: str, *values: Any) -> Any:
    """An OSC message."""
    builder = OscMessageBuilder(address=address)
    for value in values:
        builder.add_arg(value)
    return builder.build()


def bones(turns: dict[str, tuple[float, float, float, float]] | None = None, time_s: float | None = None) -> list[Any]:
    """Messages of one frame: the T pose with turns (x, y, z, w) of some bones."""
    found = [
        message("/VMC/Ext/Bone/Pos", name, *place, *((turns or {}).get(name, (0.0, 0.0, 0.0, 1.0))))
        for name, place in T_POSE.items()
    ]
    return found if time_s is None else [*found, message("/VMC/Ext/T", float(time_s))]


def bundle(messages: list[Any]) -> bytes:
    """One datagram with all messages."""
    builder = OscBundleBuilder(IMMEDIATELY)
    for one in messages:
        builder.add_content(one)
    content: bytes = builder.build().dgram
    return content


def raw_bundle(*elements: bytes, sizes: tuple[int, ...] = ()) -> bytes:
    """A bundle of any bytes; `sizes`: what it says of its first elements' lengths, in the place of the true ones."""
    said = (*sizes, *(len(one) for one in elements[len(sizes) :]))
    parts = [struct.pack(">i", size) + one for size, one in zip(said, elements, strict=True)]
    return b"#bundle\0" + bytes(8) + b"".join(parts)


def nested_bundle(deep: int) -> bytes:
    """Bundles in bundles; the innermost is empty."""
    content = raw_bundle()
    for _ in range(deep - 1):
        content = raw_bundle(content)
    return content


def edited(datagram: bytes, **fields: Any) -> bytes:
    """A JSON datagram with some of its fields changed."""
    return json.dumps(json.loads(datagram) | fields).encode()


def moved(datagram: bytes, by: tuple[float, float, float]) -> bytes:
    """A datagram of named joints, all moved."""
    joints = json.loads(datagram)["joints"]
    return edited(datagram, joints={name: list(np.add(place, by)) for name, place in joints.items()})


def exchanged(datagram: bytes) -> bytes:
    """A datagram of named joints whose left and right are exchanged."""
    joints = json.loads(datagram)["joints"]
    other = {"left": "right", "right": "left"}
    names = {
        name: "_".join([other.get(name.split("_")[0], name.split("_")[0]), *name.split("_")[1:]]) for name in joints
    }
    return edited(datagram, joints={names[name]: place for name, place in joints.items()})
