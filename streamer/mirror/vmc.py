"""`VmcReader`: frames from messages of the Virtual Motion Capture protocol, over OSC.

https://protocol.vmc.info/specification: bones of Unity's humanoid with their place and turn in the bone above, in
Unity's left-handed axes (x right, y up, z forward) [m], and the time of the sender. A frame may come in several
datagrams: it is complete with `/VMC/Ext/T` or `/VMC/Ext/OK` after its bones, at the end of a bundle that holds all that
is needed, or with the first bone that comes again.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pythonosc.osc_packet import OscPacket, ParseError
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import FrameError
from flexmotion.importers.frame import Frame, Skeleton

Float = NDArray[np.float64]

BONE, ROOT, TIME, STATE = "/VMC/Ext/Bone/Pos", "/VMC/Ext/Root/Pos", "/VMC/Ext/T", "/VMC/Ext/OK"

PARENTS: dict[str, tuple[str, ...]] = {
    "Hips": (),
    "Spine": ("Hips",),
    "Chest": ("Spine",),
    "UpperChest": ("Chest", "Spine"),
    "Neck": ("UpperChest", "Chest", "Spine"),
    "Head": ("Neck", "UpperChest", "Chest", "Spine"),
    **{
        f"{side}{bone}": tuple(
            above if above in ("Hips", "UpperChest", "Chest", "Spine") else side + above for above in up
        )
        for side in ("Left", "Right")
        for bone, up in {
            "UpperLeg": ("Hips",),
            "LowerLeg": ("UpperLeg",),
            "Foot": ("LowerLeg",),
            "Toes": ("Foot",),
            "Shoulder": ("UpperChest", "Chest", "Spine"),
            "UpperArm": ("Shoulder", "UpperChest", "Chest", "Spine"),
            "LowerArm": ("UpperArm",),
            "Hand": ("LowerArm",),
        }.items()
    },
}
"""Bones that are read, parents first, and the bone above: the first of those that the sender has."""

NEEDED = ("Hips", "Spine", "Head", *(f"{s}{b}" for s in ("Left", "Right") for b in ("UpperLeg", "LowerLeg", "Foot")))
TOES = (0.0, -0.08, 0.16)
"""Toe joint in the ankle's frame as a share of the leg's length, for models without toes: 7 cm lower and 13 cm ahead
of an adult's (the `Segments` of 1.75 m: ankle 11 cm above the sole, toe joint 10 cm ahead of it, 3 cm high)."""

BUNDLE, HEADER_BYTES, DEEPEST = b"#bundle\0", 16, 8
"""How a bundle begins, its length before the first element (with a time tag), and how deep bundles may be nested."""

Pose = tuple[Float, Float]


class VmcReader:
    """Puts the bones of one sender together to frames."""

    def __init__(self) -> None:
        self._bones: dict[str, Pose] = {}
        self._root: Pose = (np.zeros(3), np.eye(3))
        self._time_s: float | None = None

    def take(self, datagram: bytes) -> list[Frame]:
        """The frames that a datagram completes. Raises `FrameError` where it is no OSC, or not as the protocol says."""
        if datagram.startswith(BUNDLE):
            _check_bundle(datagram)
        try:
            messages = OscPacket(datagram).messages
        except (ParseError, ValueError, IndexError) as error:
            raise FrameError(f"no OSC packet: {error}") from error
        frames: list[Frame] = []
        for timed in messages:
            address, values = timed.message.address, list(timed.message.params)
            if address == BONE:
                name = values[0] if values else None
                if not isinstance(name, str) or name not in PARENTS:
                    continue  # fingers, eyes, the jaw
                if name in self._bones:
                    self._finish(frames)
                self._bones[name] = _pose(f"{BONE} {name}", values[1:])
            elif address == ROOT:
                self._root = _pose(ROOT, values[1:])
            elif address == TIME:
                if not values or not isinstance(values[0], float) or not math.isfinite(values[0]):
                    raise FrameError(f"{TIME}: expected seconds")
                self._time_s = values[0]
                self._finish(frames)
            elif address == STATE:
                self._finish(frames)
        if datagram.startswith(BUNDLE):
            self._finish(frames)
        return frames

    def _finish(self, frames: list[Frame]) -> None:
        """Add the frame of the bones so far, if they are those of a human."""
        if any(name not in self._bones for name in NEEDED):
            return
        frames.append(_frame(self._bones, self._root, self._time_s))
        self._bones, self._time_s = {}, None


def _check_bundle(bundle: bytes, depth: int = 1) -> None:
    """Raise `FrameError` where elements do not lie one behind the other: python-osc follows any size, also back."""
    if depth > DEEPEST:
        raise FrameError(f"OSC: bundles in bundles, expected at most {DEEPEST} deep")
    begin = HEADER_BYTES
    while begin < len(bundle):
        size = int.from_bytes(bundle[begin : begin + 4], "big", signed=True)
        begin, end = begin + 4, begin + 4 + size
        if size < 4 or size % 4 or end > len(bundle):
            raise FrameError(f"OSC: an element of {size} bytes, expected a multiple of 4 that lies in its bundle")
        if bundle.startswith(BUNDLE, begin, end):
            _check_bundle(bundle[begin:end], depth + 1)
        elif not bundle.startswith(b"/", begin, end):
            raise FrameError("OSC: an element that is neither a message nor a bundle")
        begin = end


def _pose(field: str, values: list[Any]) -> Pose:
    """Place and turn in right-handed axes: x left, y up, z forward. Raises `FrameError`."""
    if len(values) < 7 or not all(isinstance(value, int | float) for value in values[:7]):
        raise FrameError(f"{field}: expected a name, x, y, z [m] and a quaternion x, y, z, w")
    x, y, z, qx, qy, qz, qw = map(float, values[:7])
    length = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if not (math.isfinite(length) and abs(length - 1.0) < 0.1 and all(map(math.isfinite, (x, y, z)))):
        raise FrameError(f"{field}: expected finite numbers and a unit quaternion")
    # Reflection in x: a turn about x keeps its sense, those about y and z change it.
    return np.array([-x, y, z]), Rotation.from_quat([qx, -qy, -qz, qw]).as_matrix()


def _frame(bones: dict[str, Pose], root: Pose, time_s: float | None) -> Frame:
    names = [name for name in PARENTS if name in bones]
    index = {name: at for at, name in enumerate(names)}
    positions, rotations = np.empty((len(names), 3)), np.empty((len(names), 3, 3))
    zero, parents = np.zeros((len(names), 3)), []
    for at, name in enumerate(names):
        place, turn = bones[name]
        above = next((index[one] for one in PARENTS[name] if one in index), -1)
        parents.append(above)
        start, frame = root if above < 0 else (positions[above], rotations[above])
        positions[at], rotations[at] = start + frame @ place, frame @ turn
        zero[at] = place if above < 0 else zero[above] + place
    for side in ("Left", "Right"):
        toes = f"{side}Toes"
        if toes in index:
            continue
        foot, knee, hip = (index[side + bone] for bone in ("Foot", "LowerLeg", "UpperLeg"))
        leg = np.linalg.norm(zero[hip] - zero[knee]) + np.linalg.norm(zero[knee] - zero[foot])
        ahead = leg * np.array(TOES)
        names.append(toes)
        parents.append(foot)
        positions = np.vstack([positions, positions[foot] + rotations[foot] @ ahead])
        rotations = np.concatenate([rotations, rotations[foot][None]])
        zero = np.vstack([zero, zero[foot] + ahead])
    skeleton = Skeleton("vmc", tuple(names), up="y", units="m", parents=tuple(parents))
    return Frame(skeleton, positions, time_s, rotations, zero)
