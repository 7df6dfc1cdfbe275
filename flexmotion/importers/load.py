"""`load`: reads any motion file, by its suffix."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.floor import clip_floor
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.motion_file import load_motion
from flexmotion.human.resample import resample
from flexmotion.importers.acclaim import read_acclaim
from flexmotion.importers.body_size import check_size, with_mass
from flexmotion.importers.bvh import read_bvh
from flexmotion.importers.c3d import read_c3d
from flexmotion.importers.capture import Capture, without_prefix
from flexmotion.importers.fit import FitError, fit, fit_errors
from flexmotion.importers.joint_gaps import complete_joints
from flexmotion.importers.landmarks import Landmarks, landmarks
from flexmotion.importers.mapping import SkeletonMapping, Units, Up, find_mapping
from flexmotion.importers.marker_capture import joint_capture
from flexmotion.importers.packed import is_packed, read_packed
from flexmotion.importers.refine import refine
from flexmotion.importers.smpl import is_amass, read_amass, read_joints22
from flexmotion.importers.trc import read_trc
from flexmotion.importers.treadmill import backward_speed, backwards, belt_velocity, without_belt
from flexmotion.spatial.heading import matrix_heading
from flexmotion.spatial.quaternions import continuous_quaternions

FPS = 30.0
"""Default frame rate of imported clips [1/s]."""

READERS: dict[str, Callable[[Path], Capture]] = {
    ".bvh": read_bvh,
    ".amc": read_acclaim,
    ".npy": read_joints22,
    ".trc": read_trc,
    ".c3d": read_c3d,
}
Belt = float | Literal["detect"] | None
"""Speed of a belt, backwards [m/s]; `detect`, or None for no belt."""

ARCHIVE = ".npz"
"""Suffix of FlexMotion's own motions, AMASS sequences and packed clips; their content distinguishes them."""


@dataclass(frozen=True)
class Placement:
    """Where a motion lies in its file (metres, z up), without the belt.

    Attributes:
        start: time of the motion's first frame in the file [s].
        heading: of the pelvis in the file's first frame, about z [rad].
        origin: of the motion in the file, (x, y, z) [m]: a point p of the motion is origin + Rz(heading) p.
        up: upward axis of the file; one with y up is turned so that its z, x, y become x, y, z.
    """

    start: float = 0.0
    heading: float = 0.0
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    up: Up = "z"

    @property
    def on_floor(self) -> tuple[float, tuple[float, float]]:
        """Heading [rad] and origin (x, y) [m] in axes with z up whose x is that of the file.

        Of a file with y up these are its x, -z, y, a quarter turn from those above.
        """
        x, y, _ = self.origin
        return (self.heading - np.pi / 2, (y, -x)) if self.up == "y" else (self.heading, (x, y))


@dataclass(frozen=True)
class Import:
    """An imported clip.

    Attributes:
        motion: starts over the origin with the pelvis facing x; the floor is at z = 0.
        mapping: name of the skeleton mapping; empty for FlexMotion's own files.
        errors: distances to the file's points by name (see `fit.Fit`); empty for FlexMotion's own files.
        belt: velocity of the treadmill's belt that was removed, (2,), in the axes of `motion` [m/s]; zero without one.
        warnings: what a user should know about how the file was read.
        placement: of the motion in the file.
    """

    motion: Motion
    mapping: str = ""
    errors: dict[str, FitError] = field(default_factory=dict)
    belt: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    warnings: tuple[str, ...] = ()
    placement: Placement = Placement()


def load(
    path: str | Path,
    *,
    mapping: str | Path | None = None,
    units: Units | None = None,
    up: Up | None = None,
    fps: float | None = FPS,
    clip: str | None = None,
    belt: Belt = "detect",
    mass: float | None = None,
    height: float | None = None,
) -> Motion:
    """The motion in a file; see `read`. Its warnings are not given."""
    return read(
        path, mapping=mapping, units=units, up=up, fps=fps, clip=clip, belt=belt, mass=mass, height=height
    ).motion


def read(
    path: str | Path,
    *,
    mapping: str | Path | None = None,
    units: Units | None = None,
    up: Up | None = None,
    fps: float | None = FPS,
    clip: str | None = None,
    belt: Belt = "detect",
    mass: float | None = None,
    height: float | None = None,
) -> Import:
    """The motion in a file, with its mapping and the errors of the fit.

    Args:
        path: `.bvh`; `.amc` with its `.asf`; `.npy` with positions of 22 joints (HumanML3D); `.trc`; `.c3d`; `.npz` of
            `motion_file.save_motion`, of AMASS, or with packed clips of 22 joints.
        mapping: name of a shipped skeleton mapping, or path of one; None to find one by the names of the joints.
        units, up: of the file; None for those of the mapping, or a guess.
        fps: frame rate of the result; None for that of the file.
        clip: name of the clip in a packed file.
        belt: speed of a treadmill's belt, backwards of the human [m/s]; `detect` to find and remove one, None for none.
        mass: of the human [kg]; None for a guess from the height, with a warning.
        height: stature of the human [m]; None for an estimate from the legs.

    Raises:
        MotionFormatError: the file is missing, damaged, of an unknown kind, or lacks parts of a human.
        ConfigError: the mapping does not exist, or mass or height are not a human's.
    """
    check_size(mass, height)
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in READERS:
        capture = READERS[suffix](path)
    elif suffix == ARCHIVE:
        content = _archive(path, clip)
        if is_amass(content):
            capture = read_amass(str(path), content)
        elif is_packed(content):
            capture = read_packed(str(path), content, clip)
        else:
            return own_motion(load_motion(path), fps, mass, height)
    elif path.is_dir():
        raise MotionFormatError(f"{path}: a folder, expected a motion file")
    else:
        raise MotionFormatError(f"{path}: unknown kind of motion file, expected {', '.join([*READERS, ARCHIVE])}")
    return fit_capture(capture, mapping=mapping, units=units, up=up, fps=fps, belt=belt, mass=mass, height=height)


def own_motion(motion: Motion, fps: float | None, mass: float | None, height: float | None) -> Import:
    """A motion of FlexMotion's own format; it has a body, of which mass and height change where they are given."""
    body = motion.body
    body = replace(body, mass=body.mass if mass is None else mass, height=body.height if height is None else height)
    motion = replace(motion, body=body)
    return Import(motion if fps is None else resample(motion, fps))


def fit_capture(
    capture: Capture,
    *,
    mapping: str | Path | None = None,
    units: Units | None = None,
    up: Up | None = None,
    fps: float | None = FPS,
    belt: Belt = "detect",
    mass: float | None = None,
    height: float | None = None,
) -> Import:
    """Human motion fitted to a capture; see `read`."""
    capture = without_prefix(capture)
    chosen = find_mapping(capture.names, capture.path, mapping)
    if chosen.markers:
        joints = joint_capture(capture, chosen, units=units, up=up)
        points = SkeletonMapping(name=chosen.name, joints={name: name for name in joints.names})
        found = landmarks(joints, points, units="m", up="z")
    else:
        capture, chosen = complete_joints(capture, chosen)
        found = landmarks(capture, chosen, units=units, up=up)
    velocity = np.zeros(2) if belt is None else belt_velocity(found) if belt == "detect" else backwards(found, belt)
    if velocity.any():
        found = without_belt(found, velocity)
    if fps is not None:
        found = found.resampled(fps)
    fitted = fit(found, height)
    motion = fitted.motion
    errors = fitted.errors
    if capture.rotations is None:
        motion = refine(motion, found)
        errors = fit_errors(found, forward(motion))
    notes = list(found.warnings)
    if velocity.any():
        way = "given" if belt != "detect" else "detected"
        notes.append(f"a treadmill's belt of {backward_speed(found, velocity):.2f} m/s backwards was removed ({way})")
    body, guessed = with_mass(motion.body, mass, height)
    motion = replace(motion, body=body)
    placed = on_floor(from_origin(motion))
    place = _placement(motion, placed, found)
    turned = Rotation.from_euler("z", -place.heading).apply([*velocity, 0.0])[:2]
    return Import(placed, chosen.name, errors, turned, (*notes, *guessed), place)


def _placement(before: Motion, after: Motion, found: Landmarks) -> Placement:
    """Placement of a motion (`after`) that was moved from where its file has it (`before`)."""
    heading = _heading(before)
    x, y = before.root_position[0, :2]
    height = before.root_position[0, 2] - after.root_position[0, 2]
    return Placement(found.start, heading, (float(x), float(y), float(height)), found.up)


def _heading(motion: Motion) -> float:
    first = Rotation.from_quat(motion.root_quaternion[0], scalar_first=True)
    return float(matrix_heading(first.as_matrix()))


def _archive(path: Path, clip: str | None) -> dict[str, NDArray]:
    """Arrays of an archive; of a named clip only, if there is one, since a packed file has hundreds."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            names = [clip] if clip is not None and clip in archive.files else archive.files
            return {name: archive[name] for name in names}
    except OSError as error:
        raise MotionFormatError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        raise MotionFormatError(f"{path}: not a NumPy archive, or a damaged one") from error


def from_origin(motion: Motion) -> Motion:
    """The motion moved to start over the origin with the pelvis facing x; heights are unchanged."""
    turn = Rotation.from_euler("z", -_heading(motion))
    start = motion.root_position[0] * [1.0, 1.0, 0.0]
    turned = turn * Rotation.from_quat(motion.root_quaternion, scalar_first=True)
    quaternions = continuous_quaternions(turned.as_quat(scalar_first=True))
    return replace(motion, root_position=turn.apply(motion.root_position - start), root_quaternion=quaternions)


def on_floor(motion: Motion) -> Motion:
    """The motion with its floor (see `floor.clip_floor`) at z = 0."""
    floor = clip_floor(forward(motion), motion.fps)
    return replace(motion, root_position=motion.root_position - [0.0, 0.0, floor])
