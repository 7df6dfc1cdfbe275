"""Files that OpenSim reads, of one clip: storages (`.sto`), external loads (`.xml`) and the model (`.osim`).

Axes and names are OpenSim's (see `opensim_names`). A storage is a table of numbers over time, tab-separated.
"""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.analysis import ClipAnalysis
from flexmotion.biomechanics.dynamics import Dynamics
from flexmotion.biomechanics.joint_contact import BEYOND
from flexmotion.biomechanics.opensim_model import document, model_document
from flexmotion.biomechanics.opensim_names import (
    BODIES,
    ROOT_TRANSLATIONS,
    body_name,
    coordinates,
    generalised_forces,
    joint_name,
    y_up,
)
from flexmotion.human.skeleton import SIDES

Float = NDArray[np.float64]

IDENTIFIERS = {"force": "ground_force_{}_v", "point": "ground_force_{}_p", "torque": "ground_torque_{}_"}
"""Beginnings of the columns of force, point and torque of a foot; an axis follows."""

PARTS = {
    "": "ground forces: force, centre of pressure and free torque of both feet",
    "_external_loads.xml": "applies them to the feet calcn_l and calcn_r",
    "_coordinates.sto": "pose: pelvis and joint angles [degrees]",
    "_moments.sto": "joint moments, and as those of the pelvis the residuals",
    "_quality.sto": "force error, residuals, and whether a frame is flagged or good",
    "_activations.sto": "muscle activations",
    "_joint_contact.sto": "joint contact forces",
    "_model.osim": "the human as a model with these coordinates and bodies, without muscles",
}
"""What is written, by the end of the file's name; `""` is the file itself."""


def storage(name: str, times: Float, columns: Mapping[str, Float], *, degrees: bool = False) -> bytes:
    """A storage with columns after the time.

    Args:
        name: of the table.
        times: (T,) [s].
        columns: values by label, (T,) each.
        degrees: whether angles are in degrees.
    """
    # Zeros of rounding, such as the force on a foot in the air, are written as zeros.
    table = np.column_stack([times, *columns.values()]).round(9) + 0.0
    header = [name, "version=1", f"nRows={table.shape[0]}", f"nColumns={table.shape[1]}"]
    header += [f"inDegrees={'yes' if degrees else 'no'}", "endheader", "\t".join(["time", *columns])]
    stream = io.StringIO()
    np.savetxt(stream, table, fmt="%.9g", delimiter="\t", header="\n".join(header), comments="")
    return stream.getvalue().encode()


def ground_columns(found: Dynamics, axes: Callable[[Float], Float] = y_up) -> dict[str, Float]:
    """Ground force, centre of pressure and free torque of both feet in the world, (T,) each [N, m, N·m].

    Args:
        found: the forces.
        axes: from vectors (T, 3) in the project's axes to those of the columns.
    """
    assert found.motion.wrenches is not None
    columns: dict[str, Float] = {}
    # Right before left, as OpenSim's examples have it.
    for foot, side in reversed(list(enumerate(SIDES))):
        wrench = found.motion.wrenches[:, foot]
        parts = {"force": wrench[:, :3], "point": found.centres[:, foot], "torque": wrench[:, 3:]}
        for kind, values in parts.items():
            columns |= _axes(IDENTIFIERS[kind].format(side), axes(values))
    return columns


def external_loads(name: str, data_file: str, foot: str = BODIES["calcaneus"]) -> bytes:
    """Document that applies the ground forces of a storage to the feet.

    Args:
        name: of the loads.
        data_file: storage with the columns of `ground_columns`; relative to the document's folder.
        foot: name of the foot's body without its side.
    """
    loads = ET.Element("ExternalLoads", name=name)
    objects = ET.SubElement(loads, "objects")
    for side in SIDES:
        force = ET.SubElement(objects, "ExternalForce", name=f"ground_{side}")
        content = {
            "applied_to_body": f"{foot}_{side}",
            "force_expressed_in_body": "ground",
            "point_expressed_in_body": "ground",
            **{f"{kind}_identifier": prefix.format(side) for kind, prefix in IDENTIFIERS.items()},
        }
        for tag, text in content.items():
            ET.SubElement(force, tag).text = text
    ET.SubElement(loads, "datafile").text = data_file
    return document(loads)


def quality_columns(clip: ClipAnalysis) -> dict[str, Float]:
    """How far forces can be trusted, (T,) each: see `Dynamics.force_error`, `.residual`, `ClipAnalysis.good`."""
    found = clip.dynamics
    columns = {f"force_error_{side}_bw": found.force_error[:, foot] for foot, side in enumerate(SIDES)}
    columns |= {"residual_force_bw": found.residual[:, 0], "residual_moment_bw_m": found.residual[:, 1]}
    columns |= {f"flagged_{side}": clip.flagged[:, foot].astype(np.float64) for foot, side in enumerate(SIDES)}
    return columns | {"good": clip.good.astype(np.float64)}


def opensim_files(path: Path, clip: ClipAnalysis) -> dict[Path, bytes]:
    """Content of every file of a clip; `path` is that of the ground forces, the others' names begin with its stem.

    Times, axes and place are those of the recording, on a treadmill too.
    """
    placed, stem = clip.recording.placed(clip.dynamics), path.stem
    motion = placed.motion

    def table(part: str, columns: Mapping[str, Float], *, degrees: bool = False) -> None:
        place = _place(path, part)
        files[place] = storage(place.stem, clip.times, columns, degrees=degrees)

    files: dict[Path, bytes] = {}
    table("", ground_columns(placed))
    files[_place(path, "_external_loads.xml")] = external_loads(stem, path.name)
    angles = {
        name: values if name in ROOT_TRANSLATIONS else np.degrees(values)
        for name, values in coordinates(motion).items()
    }
    table("_coordinates.sto", angles, degrees=True)
    table("_moments.sto", generalised_forces(motion))
    table("_quality.sto", quality_columns(clip))
    if clip.muscles is not None:
        muscles = clip.muscles
        table("_activations.sto", dict(zip(muscles.names, muscles.state.activations.T, strict=True)))
        contact: dict[str, Float] = {}
        for column, crossing in enumerate(muscles.state.crossings):
            contact |= _axes(contact_label(crossing), y_up(muscles.contact[:, column]))
        table("_joint_contact.sto", contact)
    files[_place(path, "_model.osim")] = model_document(motion.body)
    return files


def contact_label(crossing: str) -> str:
    """Beginning of a joint contact force's columns, as OpenSim's joint reactions have it."""
    base, _, side = crossing.partition("_")
    segment = BEYOND[base][0] + (f"_{side}" if side else "")
    body = body_name(segment)
    return f"{joint_name(segment)}_on_{body}_in_{body}_f"


def _place(path: Path, part: str) -> Path:
    return path.with_name(path.stem + part) if part else path


def _axes(prefix: str, values: Float) -> dict[str, Float]:
    """Columns x, y, z of vectors (T, 3)."""
    return dict(zip((f"{prefix}{axis}" for axis in "xyz"), values.T, strict=True))
