"""`load`: the one door for motion files; picks the reader by the file's suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from scipy.spatial.transform import Rotation

from configs.errors import MotionFormatError
from flexmotion.floor import clip_floor
from flexmotion.importers.bvh import read_bvh
from flexmotion.importers.capture import Capture
from flexmotion.importers.fit import FitError, fit
from flexmotion.importers.landmarks import landmarks
from flexmotion.importers.mapping import Units, Up, find_mapping
from flexmotion.kinematics import forward, heading
from flexmotion.motion import Motion
from flexmotion.motion_file import load_motion
from flexmotion.resample import resample
from flexmotion.signals import continuous_quaternions

FPS = 30.0
"""Frame rate that clips are brought to unless asked otherwise."""

READERS: dict[str, Callable[[Path], Capture]] = {".bvh": read_bvh}
OWN = ".npz"


@dataclass(frozen=True)
class Import:
    """A clip as read.

    Attributes:
        motion: starts over the origin with the pelvis facing x; the floor is at z = 0.
        mapping: name of the skeleton mapping that was used; empty for our own files.
        errors: distance to the file's points by name (see `fit.Fit`); empty for our own files.
    """

    motion: Motion
    mapping: str = ""
    errors: dict[str, FitError] = field(default_factory=dict)


def load(
    path: str | Path,
    *,
    mapping: str | Path | None = None,
    units: Units | None = None,
    up: Up | None = None,
    fps: float | None = FPS,
) -> Motion:
    """The motion in a file; see `read`."""
    return read(path, mapping=mapping, units=units, up=up, fps=fps).motion


def read(
    path: str | Path,
    *,
    mapping: str | Path | None = None,
    units: Units | None = None,
    up: Up | None = None,
    fps: float | None = FPS,
) -> Import:
    """The motion in a file and how well it was fitted.

    Args:
        path: `.bvh`, or `.npz` as `motion_file.save_motion` writes it.
        mapping: name of a shipped skeleton mapping or path of one; None finds one by the joints' names.
        units, up: of the file; None takes the mapping's or guesses.
        fps: frame rate of the result; None keeps the file's.

    Raises:
        MotionFormatError: the file is missing, of an unknown kind, broken, or holds no whole human.
        ConfigError: there is no such mapping.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in READERS and suffix != OWN:
        raise MotionFormatError(f"{path}: unknown kind of motion file, expected {', '.join([*READERS, OWN])}")
    if suffix == OWN:
        motion = load_motion(path)
        return Import(motion if fps is None else resample(motion, fps))
    capture = READERS[suffix](path)
    chosen = find_mapping(capture.names, capture.path, mapping)
    found = landmarks(capture, chosen, units=units, up=up)
    if fps is not None:
        found = found.resampled(fps)
    fitted = fit(found)
    return Import(on_floor(from_origin(fitted.motion)), chosen.name, fitted.errors)


def from_origin(motion: Motion) -> Motion:
    """The same motion, started over the origin with the pelvis facing x; heights stay."""
    first = Rotation.from_quat(motion.root_quaternion[0], scalar_first=True)
    turn = Rotation.from_euler("z", -float(heading(first.as_matrix())))
    start = motion.root_position[0] * [1.0, 1.0, 0.0]
    turned = turn * Rotation.from_quat(motion.root_quaternion, scalar_first=True)
    quaternions = continuous_quaternions(turned.as_quat(scalar_first=True))
    return replace(motion, root_position=turn.apply(motion.root_position - start), root_quaternion=quaternions)


def on_floor(motion: Motion) -> Motion:
    """The same motion with its floor (see `floor.clip_floor`) at z = 0."""
    floor = clip_floor(forward(motion), motion.fps)
    return replace(motion, root_position=motion.root_position - [0.0, 0.0, floor])
