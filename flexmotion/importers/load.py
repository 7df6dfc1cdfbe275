"""`load`: reads any motion file, by its suffix."""

from __future__ import annotations

import logging
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import isclose
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import ConfigError, MotionFormatError
from flexmotion.human.floor import clip_floor
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import DYNAMIC, Motion
from flexmotion.human.motion_file import load_motion
from flexmotion.human.resample import resample
from flexmotion.importers.acclaim import read_acclaim
from flexmotion.importers.belt import Belt, remove_belt
from flexmotion.importers.body_size import SAME_SIZE, check_size, is_guess, with_mass
from flexmotion.importers.bvh import read_bvh
from flexmotion.importers.c3d import read_c3d
from flexmotion.importers.capture import Capture, without_prefix
from flexmotion.importers.fit import FitError, fit, fit_errors
from flexmotion.importers.joint_gaps import complete_joints
from flexmotion.importers.landmarks import Landmarks, landmarks, leg_length
from flexmotion.importers.mapping import SkeletonMapping, Units, Up, find_mapping
from flexmotion.importers.marker_capture import joint_capture
from flexmotion.importers.packed import is_packed, read_packed
from flexmotion.importers.refine import refine
from flexmotion.importers.smpl import is_amass, read_amass, read_joints
from flexmotion.importers.trc import read_trc
from flexmotion.importers.upright_check import check_upright
from flexmotion.importers.way_check import check_rate, check_way
from flexmotion.spatial.heading import matrix_heading
from flexmotion.spatial.quaternions import continuous_quaternions

logger = logging.getLogger(__name__)

FPS = 30.0
"""Default frame rate of imported clips [1/s]."""

READERS: dict[str, Callable[[Path], Capture]] = {
    ".bvh": read_bvh,
    ".amc": read_acclaim,
    ".npy": read_joints,
    ".trc": read_trc,
    ".c3d": read_c3d,
}
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
        motion: starts over the origin with the pelvis facing x; the floor is at z = 0. `mass_given` says whether its
            mass is known.
        mapping: name of the skeleton mapping; empty for FlexMotion's own files.
        errors: distances to the file's points by name (see `fit.Fit`); empty for FlexMotion's own files.
        belt: velocity of the treadmill's belt that was removed, (2,), in the axes of `motion` [m/s]; zero without one.
        warnings: what a user should know about how the file was read.
        mass_guess: says that the mass is a guess; empty where it is known. Forces depend on the mass; joint angles do
            not, so a robot can follow the motion either way.
        placement: of the motion in the file.
    """

    motion: Motion
    mapping: str = ""
    errors: dict[str, FitError] = field(default_factory=dict)
    belt: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    warnings: tuple[str, ...] = ()
    mass_guess: str = ""
    placement: Placement = Placement()

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings for a user of forces: those of reading, and that of a guessed mass."""
        return (*self.warnings, self.mass_guess) if self.mass_guess else self.warnings


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
    """The motion in a file; see `read`. What a user should know about how it was read is logged as warnings.

    Its `mass_given` says whether the mass is known.
    """
    found = read(path, mapping=mapping, units=units, up=up, fps=fps, clip=clip, belt=belt, mass=mass, height=height)
    for warning in found.warnings:
        logger.warning("%s: %s", Path(path).name, warning)
    return found.motion


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
        path: `.bvh`; `.amc` with its `.asf`; `.npy` with positions of 22 joints (HumanML3D) or 21 (KIT-ML); `.trc`;
            `.c3d`; `.npz` of `motion_file.save_motion`, of AMASS, or with packed clips of 22 joints.
        mapping: name of a shipped skeleton mapping, or path of one; None to find one by the names of the joints.
        units, up: of the file; None for those of the mapping, or a guess.
        fps: frame rate of the result; None for that of the file.
        clip: name of the clip in a packed file.
        belt: speed of a treadmill's belt, backwards of the human [m/s]; `detect` to find and remove one, None for none.
        mass: of the human [kg]; None for that of FlexMotion's own files where it is known, else for a guess from the
            height, which `Import.mass_guess` tells.
        height: stature of the human [m]; None for an estimate from the legs.

    Raises:
        MotionFormatError: the file is missing, damaged, of an unknown kind, or lacks parts of a human.
        ConfigError: the mapping does not exist, mass or height are not a human's, or FlexMotion's own motion is to
            change its belt or its fitted body.
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
            return own_motion(load_motion(path), str(path), fps=fps, belt=belt, mass=mass, height=height)
    elif path.is_dir():
        raise MotionFormatError(f"{path}: a folder, expected a motion file")
    else:
        raise MotionFormatError(f"{path}: unknown kind of motion file, expected {', '.join([*READERS, ARCHIVE])}")
    return fit_capture(capture, mapping=mapping, units=units, up=up, fps=fps, belt=belt, mass=mass, height=height)


def own_motion(
    motion: Motion,
    path: str = "motion",
    *,
    fps: float | None = None,
    belt: Belt = "detect",
    mass: float | None = None,
    height: float | None = None,
) -> Import:
    """A motion of FlexMotion's own format, which has a body and no belt.

    A known mass is kept. A motion that does not say whether its mass is known, such as one of an older file, has a
    guess if the mass is `Body`'s default or that of `with_mass`; any other mass was given. Forces, torques and
    activations of another body are removed.

    Args:
        path: of the file, for messages.
        fps, belt, mass, height: see `read`; the path scales with the height.

    Raises:
        ConfigError: a belt is given; or a height, for a body that was fitted to a recording.
        MotionFormatError: no human gets where the motion is, or not in so few frames.
    """
    check_rate(path, motion.fps)
    before = motion.body
    if not isinstance(belt, str) and belt is not None:
        raise ConfigError(
            f"{path}: belt is {belt:g} m/s, but FlexMotion's own motions are over ground: give the belt where the "
            "recording is imported"
        )
    if height is not None and not isclose(height, before.height, rel_tol=SAME_SIZE):
        if before.fitted is not None:
            raise ConfigError(
                f"{path}: height is {height:g} m, but the body of {before.height:.2f} m is fitted to the recording: "
                "give the height where that is imported"
            )
        # Mean proportions scale with the height, so the feet stay on the floor.
        scale = height / before.height
        motion = replace(motion, body=replace(before, height=height), root_position=scale * motion.root_position)
    given = mass is not None or (not is_guess(before) if motion.mass_given is None else motion.mass_given)
    notes = check_way(path, motion.fps, motion.root_position)
    guess = ""
    if mass is not None or not given:
        body, guess = with_mass(motion.body, mass, height)
        kept = isclose(body.mass, before.mass, rel_tol=SAME_SIZE)
        motion = replace(motion, body=replace(body, mass=before.mass) if kept else body)
    stale = [name for name in DYNAMIC if name != "contacts" and _has(motion, name)]
    if motion.body != before and stale:
        notes.append(
            f"{', '.join(stale)} removed: they are those of a human of {before.mass:.1f} kg and {before.height:.2f} m"
        )
        motion = replace(motion.kinematics, contacts=motion.contacts)
    motion = replace(motion, mass_given=given)
    motion = motion if fps is None else resample(motion, fps)
    return Import(motion, warnings=(*notes, *_pose(motion)), mass_guess=guess)


def _pose(motion: Motion) -> list[str]:
    """A warning about a single frame."""
    return ["1 frame: a pose, no motion; a robot follows two frames or more"] if len(motion) < 2 else []


def _has(motion: Motion, name: str) -> bool:
    return getattr(motion, name) is not None


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
    check_rate(capture.path, capture.fps)
    chosen = find_mapping(capture.names, capture.path, mapping)
    if chosen.markers:
        joints = joint_capture(capture, chosen, units=units, up=up)
        points = SkeletonMapping(name=chosen.name, joints={name: name for name in joints.names})
        found = landmarks(joints, points, units="m", up="z")
    else:
        capture, chosen = complete_joints(capture, chosen)
        found = landmarks(capture, chosen, units=units, up=up)
    hips = (found.points["hip_l"] + found.points["hip_r"]) / 2
    jumps = check_way(found.path, found.fps, hips, round((found.start - capture.start) * found.fps))
    turned = check_upright(found.points, leg_length(found.points), found.up)
    found, velocity, said = remove_belt(found, belt)
    if fps is not None:
        found = found.resampled(fps)
    fitted = fit(found, height)
    motion = fitted.motion
    errors = fitted.errors
    if capture.rotations is None:
        motion = refine(motion, found)
        errors = fit_errors(found, forward(motion))
    notes = [*found.warnings, *jumps, *turned, *said, *_pose(motion)]
    body, guess = with_mass(motion.body, mass, height)
    motion = replace(motion, body=body, mass_given=mass is not None)
    placed = on_floor(from_origin(motion))
    place = _placement(motion, placed, found)
    belt_velocity = Rotation.from_euler("z", -place.heading).apply([*velocity, 0.0])[:2]
    return Import(placed, chosen.name, errors, belt_velocity, tuple(notes), guess, place)


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
