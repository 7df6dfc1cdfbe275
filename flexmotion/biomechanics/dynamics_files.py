"""Files of one clip's dynamics: `.npz`, `.csv`, and for OpenSim `.sto` with files beside it (see `opensim_files`).

Arrays and columns have the project's axes and order: world x forward, y left, z up, from the clip's first frame; left
before right; joints in the order of `skeleton.JOINTS`. Storages have OpenSim's.
"""

from __future__ import annotations

import errno
import io
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.analysis import ClipAnalysis
from flexmotion.biomechanics.force_error import FLAGGED
from flexmotion.biomechanics.opensim_files import opensim_files
from flexmotion.configs.errors import ConfigError
from flexmotion.human.motion_file import motion_content
from flexmotion.human.skeleton import JOINTS, ROOT_DOFS, SIDES

SCHEMA = "flexmotion.dynamics/1"


@dataclass(frozen=True)
class Quantity:
    """An array over time, as it is written.

    Attributes:
        values: (T, ...).
        unit: of the values; empty for numbers without one.
        meaning: for people.
        columns: name of each value of a frame, in order, with its unit.
    """

    values: NDArray
    unit: str
    meaning: str
    columns: tuple[str, ...]


def quantities(clip: ClipAnalysis) -> dict[str, Quantity]:
    """Everything about a clip that is written, by the name of its array."""
    found, motion = clip.dynamics, clip.dynamics.motion
    assert motion.torques is not None and motion.wrenches is not None and motion.contacts is not None
    root = (*(f"{name}_force_n" for name in ROOT_DOFS[:3]), *(f"{name}_moment_nm" for name in ROOT_DOFS[3:]))
    contents = {
        "root_position": Quantity(motion.root_position, "m", "midpoint of the hip joints", _vector("root", "_m")),
        "root_quaternion": Quantity(
            motion.root_quaternion, "", "orientation of the pelvis, w x y z", tuple(f"root_q{part}" for part in "wxyz")
        ),
        "joints": Quantity(motion.joints, "rad", "joint angles", tuple(f"{joint}_rad" for joint in JOINTS)),
        "torques": Quantity(
            motion.torques,
            "N, N·m",
            "generalised forces; the root's, which are residuals, are forces in the world and moments about the axes "
            "of the pelvis",
            (*root, *(f"{joint}_moment_nm" for joint in JOINTS)),
        ),
        "wrenches": Quantity(
            motion.wrenches,
            "N, N·m",
            "ground force on each foot, and its moment about the centre of pressure",
            _sided(lambda side: (*_vector(f"ground_force_{side}", "_n"), *_vector(f"ground_moment_{side}", "_nm"))),
        ),
        "centres": Quantity(
            found.centres,
            "m",
            "centre of pressure of each foot; below the middle of the sole of a foot without load",
            _sided(lambda side: _vector(f"centre_of_pressure_{side}", "_m")),
        ),
        "contacts": Quantity(
            motion.contacts, "", "whether each foot carries load", _sided(lambda side: (f"contact_{side}",))
        ),
        "force_error": Quantity(
            found.force_error,
            "body weights",
            "estimated standard error of the ground force on each foot",
            _sided(lambda side: (f"force_error_{side}_bw",)),
        ),
        "flagged": Quantity(
            clip.flagged,
            "",
            f"whether that error is greater than {FLAGGED:g} body weights",
            _sided(lambda side: (f"flagged_{side}",)),
        ),
        "residual": Quantity(
            found.residual,
            "body weights, body weights x m",
            "force, and moment about the centre of mass, that ground forces do not explain",
            ("residual_force_bw", "residual_moment_bw_m"),
        ),
        "good": Quantity(clip.good, "", "whether residual and joints are within their limits", ("good",)),
    }
    if clip.muscles is not None:
        state = clip.muscles.state
        contents |= {
            "activations": Quantity(
                state.activations,
                "",
                "muscle activations, 0 to 1",
                tuple(f"activation_{name}" for name in clip.muscles.names),
            ),
            "joint_contact": Quantity(
                clip.muscles.contact,
                "N",
                "force on the segment beyond a joint, in its axes: x forward, y left, z along it to the joint",
                tuple(name for crossing in state.crossings for name in _vector(f"joint_contact_{crossing}", "_n")),
            ),
            "infeasible": Quantity(
                clip.muscles.infeasible,
                "",
                "whether muscles cannot produce the moment of a joint",
                tuple(f"infeasible_{joint}" for joint in state.joints),
            ),
        }
    return contents


def _vector(name: str, unit: str) -> tuple[str, ...]:
    return tuple(f"{name}_{axis}{unit}" for axis in "xyz")


def _sided(columns: Callable[[str], tuple[str, ...]]) -> tuple[str, ...]:
    return tuple(name for side in SIDES for name in columns(side))


def _npz(path: Path, clip: ClipAnalysis) -> dict[Path, bytes]:
    """A motion file (see `motion_file`) with more arrays; `header` describes each under `dynamics`."""
    header, arrays = motion_content(clip.dynamics.motion)
    contents = quantities(clip)
    fields = {
        name: {"unit": item.unit, "meaning": item.meaning, "columns": item.columns} for name, item in contents.items()
    }
    header["dynamics"] = {"schema": SCHEMA, "cutoff_hz": clip.cutoff, "fields": fields}
    arrays |= {name: item.values for name, item in contents.items()}
    stream = io.BytesIO()
    np.savez_compressed(stream, header=np.array(json.dumps(header)), allow_pickle=False, **arrays)
    return {path: stream.getvalue()}


def _csv(path: Path, clip: ClipAnalysis) -> dict[Path, bytes]:
    """One table; comments before it say what it is."""
    motion, contents = clip.dynamics.motion, quantities(clip)
    comments = [
        f"{SCHEMA}: {motion.source}",
        f"{len(motion)} frames at {motion.fps:g} Hz, low-pass filter {clip.cutoff:g} Hz",
        f"body: {json.dumps(asdict(motion.body))}",
        "world: x forward, y left, z up, from the first frame; floor at z = 0; _l left, _r right",
        "units end the names: _s s, _m m, _rad rad, _n N, _nm N·m, _bw body weights, _bw_m body weights x m",
        *(f"{item.columns[0]} ...: {item.meaning}" for item in contents.values()),
    ]
    names = ["time_s", *(name for item in contents.values() for name in item.columns)]
    columns = [clip.times, *(item.values.reshape(len(clip), -1) for item in contents.values())]
    stream = io.StringIO()
    stream.writelines(f"# {line}\n" for line in comments)
    stream.write(",".join(names) + "\n")
    np.savetxt(stream, np.column_stack(columns), fmt="%.9g", delimiter=",")
    return {path: stream.getvalue().encode()}


WRITERS: dict[str, Callable[[Path, ClipAnalysis], dict[Path, bytes]]] = {
    ".npz": _npz,
    ".csv": _csv,
    ".sto": opensim_files,
}
"""Content of the files of a clip, by the suffix of the path that is asked for."""


def dynamics_writer(path: Path) -> Callable[[Path, ClipAnalysis], dict[Path, bytes]]:
    """The writer for a path; raises `ConfigError` where its suffix is unknown."""
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise ConfigError(f"{path}: unknown kind of file, expected {', '.join(WRITERS)}")
    return writer


def write_files(contents: Mapping[Path, bytes]) -> None:
    """Write every file completely before the first takes its name; raises `OSError` where one cannot be written."""
    unfinished = {path: path.with_name(f".{path.name}.{os.getpid()}.unfinished") for path in contents}
    try:
        for path, content in contents.items():
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            unfinished[path].write_bytes(content)
        for path, temporary in unfinished.items():
            os.replace(temporary, path)
    except OSError as error:
        # The name that was asked for, not that of the temporary file.
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        for temporary in unfinished.values():
            temporary.unlink(missing_ok=True)
