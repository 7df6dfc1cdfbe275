"""FlexMotion's motion files: one `.npz` holds one `Motion`."""

from __future__ import annotations

import json
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.body import Body, Segments
from flexmotion.human.motion import DYNAMIC, Motion
from flexmotion.human.skeleton import JOINTS

SCHEMA = "flexmotion.motion/1"
REQUIRED = ("root_position", "root_quaternion", "joints")


def save_motion(motion: Motion, path: str | Path) -> None:
    """Write a motion; arrays keep their precision.

    The file is a compressed NumPy archive: arrays as in `Motion`, and `header`, JSON with schema, fps, joint names,
    body, whether its mass is given, and source.
    """
    header, arrays = motion_content(motion)
    content: dict[str, Any] = {"header": np.array(json.dumps(header)), **arrays}
    with open(path, "wb") as file:
        np.savez_compressed(file, **content)


def motion_content(motion: Motion) -> tuple[dict[str, Any], dict[str, NDArray]]:
    """Header and arrays of a motion file; a file may have more of both, which `load_motion` ignores."""
    header = {
        "schema": SCHEMA,
        "fps": motion.fps,
        "joints": JOINTS,
        "body": asdict(motion.body),
        "mass_given": motion.mass_given,
        "source": motion.source,
    }
    arrays = {name: getattr(motion, name) for name in (*REQUIRED, *DYNAMIC)}
    return header, {name: value for name, value in arrays.items() if value is not None}


def load_motion(path: str | Path) -> Motion:
    """Read a file of `save_motion`; joints and their torques are matched by name.

    Raises:
        MotionFormatError: the file is missing, damaged, or not a motion file.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            content: dict[str, Any] = {name: archive[name] for name in archive.files}
    except OSError as error:
        raise MotionFormatError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        raise MotionFormatError(f"{path}: not a NumPy archive, or a damaged one") from error
    missing = [name for name in ("header", *REQUIRED) if name not in content]
    if missing:
        raise MotionFormatError(f"{path}: not a motion of `flexmotion data import`, it lacks {', '.join(missing)}")
    try:
        header = json.loads(str(content["header"]))
        if header["schema"] != SCHEMA:
            raise MotionFormatError(f"{path}: schema is {header['schema']!r}, expected {SCHEMA!r}")
        order = _order(header["joints"], path)
        body = header["body"]
        fitted = Segments(**body.pop("fitted")) if body.get("fitted") else body.pop("fitted")
        joints = np.asarray(content["joints"], np.float64)[:, order]
        floats = {name: np.asarray(content[name], np.float64) for name in (*REQUIRED, *DYNAMIC[:-1]) if name in content}
        if "torques" in floats:  # six of the root, then one a joint
            floats["torques"] = floats["torques"][:, [*range(6), *(6 + joint for joint in order)]]
        contacts = np.asarray(content["contacts"], np.bool_) if "contacts" in content else None
        return Motion(
            fps=float(header["fps"]),
            body=Body(**body, fitted=fitted),
            source=str(header["source"]),
            contacts=contacts,
            mass_given=_mass_given(header),
            **floats | {"joints": joints},
        )
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise MotionFormatError(f"{path}: {type(error).__name__}: {error}") from error


def _mass_given(header: dict[str, Any]) -> bool | None:
    """Whether the mass is given; None in files of versions that did not store it."""
    value = header.get("mass_given")
    if not (value is None or isinstance(value, bool)):
        raise ValueError(f"mass_given is {value!r}, expected true, false or null")
    return value


def _order(names: list[str], path: str | Path) -> list[int]:
    missing = [name for name in JOINTS if name not in names]
    if missing:
        raise MotionFormatError(f"{path}: lacks joint {', '.join(missing)}")
    return [names.index(name) for name in JOINTS]
