"""`Frame`: one moment of a person, as a sender of live motion gives it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.importers.capture import Capture
from flexmotion.importers.mapping import Units, Up

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Skeleton:
    """What the frames of one sender have in common; two frames are of one skeleton where these are equal.

    Attributes:
        protocol: by which the frames came, for messages.
        names: of the J joints.
        up: upward axis; with "y" forward is z and left is x, with "z" forward is x and left is y.
        units: of positions.
        hip_centred: positions are relative to the middle of the hips: the frames do not say where the person goes.
        parents: index of each joint's parent, -1 for a root; None where the protocol has no hierarchy.
    """

    protocol: str
    names: tuple[str, ...]
    up: Up = "y"
    units: Units = "m"
    hip_centred: bool = False
    parents: tuple[int, ...] | None = None


@dataclass(frozen=True)
class Frame:
    """One moment of a person.

    Attributes:
        skeleton: names, axes and units.
        positions: of its joints, (J, 3) [units of the skeleton]; NaN where a joint is not seen.
        time_s: on the sender's clock [s]; None where it says none.
        rotations: of each joint's own frame, (J, 3, 3); None for frames of positions alone.
        zero_positions: positions with every rotation at zero, (J, 3); None where the protocol has no such pose.
    """

    skeleton: Skeleton
    positions: Float
    time_s: float | None = None
    rotations: Float | None = None
    zero_positions: Float | None = field(default=None, repr=False)

    def towards(self, later: Frame, share: float) -> Frame:
        """The frame between this and a later one of the same skeleton, at a share of the way in [0, 1]."""
        positions = (1.0 - share) * self.positions + share * later.positions
        rotations = later.rotations
        if self.rotations is not None and later.rotations is not None:
            turn = Rotation.from_matrix(np.swapaxes(self.rotations, 1, 2) @ later.rotations).as_rotvec()
            rotations = self.rotations @ Rotation.from_rotvec(share * turn).as_matrix()
        return replace(later, positions=positions, rotations=rotations)


def capture_of(frames: list[Frame], fps: float) -> Capture:
    """Frames of one skeleton, evenly spaced in time, as a capture of that many frames a second."""
    last = frames[-1]
    rotated = all(frame.rotations is not None for frame in frames)
    return Capture(
        path=last.skeleton.protocol,
        fps=fps,
        names=last.skeleton.names,
        positions=np.stack([frame.positions for frame in frames]),
        rotations=np.stack([frame.rotations for frame in frames if frame.rotations is not None]) if rotated else None,
        parents=last.skeleton.parents,
        zero_positions=last.zero_positions,
    )
