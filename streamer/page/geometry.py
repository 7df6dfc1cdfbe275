"""The robot's geoms as triangle meshes, each in the frame of its body."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray

Float = NDArray[np.float64]

_SHOWN_GROUPS = 2
"""Geoms of higher groups are hidden, as in MuJoCo's viewer."""
_ROUND = 32
"""Corners of a circle."""
_CREASE = 0.6
"""Edges whose faces meet at a larger angle than this stay sharp [rad]."""


@dataclass(frozen=True)
class GeomMesh:
    """One geom.

    Attributes:
        geom, body: ids in the model.
        vertices, faces: (V, 3) in the body's frame [m], (F, 3).
        colour: red, green, blue in 0 .. 255.
    """

    geom: int
    body: int
    vertices: Float
    faces: NDArray[np.integer]
    colour: tuple[int, int, int]


def geom_meshes(model: mujoco.MjModel) -> list[GeomMesh]:
    """Meshes of all visible geoms except planes and height fields."""
    found = []
    for geom in range(model.ngeom):
        material = model.geom_matid[geom]
        colour = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        if model.geom_group[geom] > _SHOWN_GROUPS or colour[3] == 0:
            continue
        mesh = _mesh(model, geom)
        if mesh is None:
            continue
        pose = np.eye(4)
        mujoco.mju_quat2Mat(flat := np.zeros(9), model.geom_quat[geom])
        pose[:3, :3], pose[:3, 3] = flat.reshape(3, 3), model.geom_pos[geom]
        mesh = trimesh.graph.smooth_shade(mesh.apply_transform(pose), angle=_CREASE)
        red, green, blue = (int(round(255 * part)) for part in colour[:3])
        found.append(GeomMesh(geom, int(model.geom_bodyid[geom]), mesh.vertices, mesh.faces, (red, green, blue)))
    return found


def _mesh(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh | None:
    """Surface of a geom in its own frame; None for planes and height fields."""
    size, kind = model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return trimesh.creation.box(extents=2 * size)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return trimesh.creation.icosphere(subdivisions=3, radius=size[0])
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return trimesh.creation.icosphere(subdivisions=3, radius=1.0).apply_scale(size)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(radius=size[0], height=2 * size[1], sections=_ROUND)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        capsule = trimesh.creation.capsule(radius=size[0], height=2 * size[1], count=[_ROUND, _ROUND // 2])
        # MuJoCo's capsule has its origin in the middle; some releases of trimesh put it at one end.
        return capsule.apply_translation(-capsule.bounds.mean(axis=0))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        vertices, faces = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        return trimesh.Trimesh(
            model.mesh_vert[vertices : vertices + model.mesh_vertnum[mesh]],
            model.mesh_face[faces : faces + model.mesh_facenum[mesh]],
        )
    return None
