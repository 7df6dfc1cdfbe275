"""The human as an OpenSim model (`.osim`), written without OpenSim: segments, inertia, joints, shapes; no muscles.

Files of a clip's dynamics (`opensim_files.py`) refer to its coordinates and bodies. Format: OpenSim's XML, version
40000, which OpenSim 4.0 and newer read.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.biomechanics.opensim_names import (
    ROOT_ROTATIONS,
    ROOT_TRANSLATIONS,
    body_name,
    coordinate_name,
    joint_name,
    y_up,
    y_up_rotation,
)
from flexmotion.human.body import Body
from flexmotion.human.human_model import human_model
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.skeleton import JOINTS
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

LEAST = 1e-9
"""Mass [kg] and inertia [kg·m²] of segments whose mass is lumped on others: OpenSim refuses zero."""

VERSION = "40000"

ROOT_AXES = np.eye(3)[[2, 0, 1]]
"""Axes of the pelvis's rotations: z, x, y."""


def model_document(body: Body) -> bytes:
    """The model as an XML document; gravity along -y."""
    human = human_model(body).model
    names = ["ground", *(body_name(human.body(index).name) for index in range(1, human.nbody))]
    bodies, joints = _node("objects"), _node("objects")
    for index in range(1, human.nbody):
        bodies.append(_body(human, index, names[index]))
        joints.append(_joint(human, index, names))
    model = _node("Model", name="flexmotion_human")
    model.extend(
        [
            _node("gravity", _text([0.0, -GRAVITY, 0.0])),
            _node("length_units", "meters"),
            _node("force_units", "N"),
            _node("BodySet", children=[bodies]),
            _node("JointSet", children=[joints]),
        ]
    )
    return document(model)


def document(content: ET.Element) -> bytes:
    """An OpenSim document with one object."""
    root = ET.Element("OpenSimDocument", Version=VERSION)
    root.append(content)
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def _body(human: mujoco.MjModel, index: int, name: str) -> ET.Element:
    # The model's inertia has the segment's own axes, x forward, y left, z up.
    x, y, z = np.maximum(human.body_inertia[index], LEAST)
    body = _node("Body", name=name)
    shapes = [_shape(human, geom, f"{name}_{number}") for number, geom in enumerate(_geoms(human, index))]
    if shapes:
        body.append(_node("components", children=shapes))
    body.extend(
        [
            _node("mass", _text([max(human.body_mass[index], LEAST)])),
            _node("mass_center", _text(y_up(human.body_ipos[index]))),
            _node("inertia", _text([x, z, y, 0.0, 0.0, 0.0])),
        ]
    )
    return body


def _geoms(human: mujoco.MjModel, index: int) -> range:
    return range(human.body_geomadr[index], human.body_geomadr[index] + human.body_geomnum[index])


def _shape(human: mujoco.MjModel, geom: int, name: str) -> ET.Element:
    """A frame with a cylinder: a capsule's axis is z, a cylinder's y, which `y_up_rotation` makes of it."""
    radius, half_length = human.geom_size[geom, :2]
    cylinder = _node("Cylinder", name=f"{name}_shape")
    cylinder.extend(
        [
            _node("socket_frame", ".."),
            _node("radius", _text([radius])),
            _node("half_height", _text([half_length])),
        ]
    )
    frame = _offset(f"{name}_frame", "..", human.geom_pos[geom], _turn(human.geom_quat[geom]))
    frame.append(_node("attached_geometry", children=[cylinder]))
    return frame


def _joint(human: mujoco.MjModel, index: int, names: list[str]) -> ET.Element:
    name, parent = names[index], int(human.body_parentid[index])
    coordinates: list[ET.Element]
    if parent:
        first = int(human.body_jntadr[index])
        hinges = [human.joint(first + number).name for number in range(human.body_jntnum[index])]
        rotations = {coordinate_name(hinge): y_up(human.joint(hinge).axis) for hinge in hinges}
        translations: tuple[str, ...] = ()
        coordinates = [_coordinate(coordinate_name(hinge), joint_limits()[JOINTS.index(hinge)]) for hinge in hinges]
        place, turn = human.body_pos[index], _turn(human.body_quat[index])
    else:
        rotations, translations = dict(zip(ROOT_ROTATIONS, ROOT_AXES, strict=True)), ROOT_TRANSLATIONS
        coordinates = [_coordinate(root) for root in (*ROOT_ROTATIONS, *ROOT_TRANSLATIONS)]
        place, turn = np.zeros(3), np.zeros(3)
    joint = _node("CustomJoint" if rotations else "WeldJoint", name=joint_name(human.body(index).name))
    joint.append(_node("socket_parent_frame", f"{names[parent]}_offset"))
    joint.append(_node("socket_child_frame", f"{name}_offset"))
    if rotations:
        joint.append(_node("coordinates", children=coordinates))
    outer = f"/bodyset/{names[parent]}" if parent else "/ground"
    frames = [
        _offset(f"{names[parent]}_offset", outer, place, turn),
        _offset(f"{name}_offset", f"/bodyset/{name}", np.zeros(3), np.zeros(3)),
    ]
    joint.append(_node("frames", children=frames))
    if rotations:
        joint.append(_transform(rotations, translations))
    return joint


def _coordinate(name: str, limits: Float | None = None) -> ET.Element:
    coordinate = _node("Coordinate", name=name)
    if limits is not None:
        coordinate.append(_node("range", _text(limits)))
    return coordinate


def _transform(rotations: dict[str, Float], translations: Sequence[str]) -> ET.Element:
    """Rotations about axes in sequence, then translations along x, y, z; axes without a coordinate stay at zero."""
    axes = list(rotations.values())
    while len(axes) < len(np.eye(3)):
        axes.append(next(e for e in np.eye(3) if np.linalg.matrix_rank(np.array([*axes, e])) == len(axes) + 1))
    transform = _node("SpatialTransform")
    for kind, names, directions in (("rotation", tuple(rotations), axes), ("translation", translations, np.eye(3))):
        for number, direction in enumerate(directions):
            driven = number < len(names)
            axis = _node("TransformAxis", name=f"{kind}{number + 1}")
            axis.append(_node("coordinates", names[number] if driven else ""))
            axis.append(_node("axis", _text(direction)))
            function = _node("LinearFunction" if driven else "Constant", name="function")
            function.append(_node("coefficients", "1 0") if driven else _node("value", "0"))
            axis.append(function)
            transform.append(axis)
    return transform


def _offset(name: str, outer: str, place: Float, turn: Float) -> ET.Element:
    """A frame fixed to another, at a place and a body-fixed x-y-z rotation in the project's axes."""
    frame = _node("PhysicalOffsetFrame", name=name)
    frame.append(_node("socket_parent", outer))
    frame.append(_node("translation", _text(y_up(place))))
    frame.append(_node("orientation", _text(turn)))
    return frame


def _turn(quaternion: Float) -> Float:
    """Body-fixed x-y-z angles, in OpenSim's axes, of a rotation w x y z in the project's, (3,) [rad]."""
    matrix = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    angles: Float = Rotation.from_matrix(y_up_rotation(matrix)).as_euler("XYZ")
    return angles


def _node(tag: str, text: str = "", name: str = "", children: Iterable[ET.Element] = ()) -> ET.Element:
    node = ET.Element(tag, {"name": name} if name else {})
    node.text = text or None
    node.extend(children)
    return node


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{float(value):.12g}" for value in values)
