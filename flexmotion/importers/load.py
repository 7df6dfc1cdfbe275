"""`load`: reads any motion file, by its suffix."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

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
from flexmotion.importers.bvh import read_bvh
from flexmotion.importers.capture import Capture
from flexmotion.importers.fit import FitError, fit, fit_errors
from flexmotion.importers.landmarks import landmarks
from flexmotion.importers.mapping import Units, Up, find_mapping
from flexmotion.importers.packed import is_packed, read_packed
from flexmotion.importers.refine import refine
from flexmotion.importers.smpl import is_amass, read_amass, read_joints22
from flexmotion.importers.trc import read_trc
from flexmotion.spatial.heading import matrix_heading
from flexmotion.spatial.quaternions import continuous_quaternions

FPS = 30.0
"""Default frame rate of imported clips [1/s]."""

READERS: dict[str, Callable[[Path], Capture]] = {
    ".bvh": read_bvh,
    ".amc": read_acclaim,
    ".npy": read_joints22,
    ".trc": read_trc,
}
ARCHIVE = ".npz"
"""Suffix of FlexMotion's own motions, AMASS sequences and packed clips; their content distinguishes them."""


@dataclass(frozen=True)
class Import:
    """An imported clip.

    Attributes:
        motion: starts over the origin with the pelvis facing x; the floor is at z = 0.
        mapping: name of the skeleton mapping; empty for FlexMotion's own files.
        errors: distances to the file's points by name (see `fit.Fit`); empty for FlexMotion's own files.
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
    clip: str | None = None,
) -> Motion:
    """The motion in a file; see `read`."""
    return read(path, mapping=mapping, units=units, up=up, fps=fps, clip=clip).motion


def read(
    path: str | Path,
    *,
    mapping: str | Path | None = None,
    units: Units | None = None,
    up: Up | None = None,
    fps: float | None = FPS,
    clip: str | None = None,
) -> Import:
    """The motion in a file, with its mapping and the errors of the fit.

    Args:
        path: `.bvh`; `.amc` with its `.asf`; `.npy` with positions of 22 joints (HumanML3D); `.trc`; `.npz` of
            `motion_file.save_motion`, of AMASS, or with packed clips of 22 joints.
        mapping: name of a shipped skeleton mapping, or path of one; None to find one by the names of the joints.
        units, up: of the file; None for those of the mapping, or a guess.
        fps: frame rate of the result; None for that of the file.
        clip: name of the clip in a packed file.

    Raises:
        MotionFormatError: the file is missing, damaged, of an unknown kind, or lacks parts of a human.
        ConfigError: the mapping does not exist.
    """
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
            motion = load_motion(path)
            return Import(motion if fps is None else resample(motion, fps))
    elif path.is_dir():
        raise MotionFormatError(f"{path}: a folder, expected a motion file")
    else:
        raise MotionFormatError(f"{path}: unknown kind of motion file, expected {', '.join([*READERS, ARCHIVE])}")
    return fit_capture(capture, mapping=mapping, units=units, up=up, fps=fps)


def fit_capture(
    capture: Capture,
    *,
    mapping: str | Path | None = None,
    units: Units | None = None,
    up: Up | None = None,
    fps: float | None = FPS,
) -> Import:
    """Human motion fitted to a capture; see `read`."""
    chosen = find_mapping(capture.names, capture.path, mapping)
    found = landmarks(capture, chosen, units=units, up=up)
    if fps is not None:
        found = found.resampled(fps)
    fitted = fit(found)
    motion = fitted.motion
    errors = fitted.errors
    if capture.rotations is None:
        motion = refine(motion, found)
        errors = fit_errors(found, forward(motion))
    return Import(on_floor(from_origin(motion)), chosen.name, errors)


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
    first = Rotation.from_quat(motion.root_quaternion[0], scalar_first=True)
    turn = Rotation.from_euler("z", -float(matrix_heading(first.as_matrix())))
    start = motion.root_position[0] * [1.0, 1.0, 0.0]
    turned = turn * Rotation.from_quat(motion.root_quaternion, scalar_first=True)
    quaternions = continuous_quaternions(turned.as_quat(scalar_first=True))
    return replace(motion, root_position=turn.apply(motion.root_position - start), root_quaternion=quaternions)


def on_floor(motion: Motion) -> Motion:
    """The motion with its floor (see `floor.clip_floor`) at z = 0."""
    floor = clip_floor(forward(motion), motion.fps)
    return replace(motion, root_position=motion.root_position - [0.0, 0.0, floor])
