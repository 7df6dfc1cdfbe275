"""The robot as flat-shaded triangles, drawn without OpenGL: each geom by its convex hull."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Float = NDArray[np.float64]

_SHOWN_GROUPS = 2
"""Geoms of higher groups are hidden, as in MuJoCo's viewer."""
_ROUND = 14
"""Corners of a circle."""
_LIGHT = np.array([0.35, -0.45, 0.82])
_AMBIENT = 0.55


@dataclass(frozen=True)
class Camera:
    """Orthographic view. Rows of `axes`: right, up and towards the viewer, in the world, (3, 3)."""

    axes: Float

    @classmethod
    def at(cls, azimuth_deg: float, elevation_deg: float) -> Camera:
        """Looking at the origin from an azimuth (0: from +x, counter-clockwise) and an elevation."""
        azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
        towards = np.array(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
        )
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        return cls(np.stack([right, np.cross(towards, right), towards]))

    def project(self, points: Float) -> Float:
        """World points (..., 3) to right, up and depth (larger is nearer), (..., 3)."""
        return points @ self.axes.T


@dataclass(frozen=True)
class Shape:
    """Convex hull of one geom in its own frame: corners (V, 3), triangles (F, 3), outward normals (F, 3), colour."""

    geom: int
    corners: Float
    triangles: NDArray[np.integer]
    normals: Float
    colour: Float


def shapes(model: mujoco.MjModel) -> list[Shape]:
    """Hulls of all geoms that are shown, planes left out."""
    found = []
    for geom in range(model.ngeom):
        material = model.geom_matid[geom]
        colour = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        corners = _corners(model, geom)
        if corners is None or model.geom_group[geom] > _SHOWN_GROUPS or colour[3] == 0:
            continue
        hull = ConvexHull(corners)
        found.append(Shape(geom, corners, hull.simplices, hull.equations[:, :3], np.array(colour[:3])))
    return found


def draw_solid(
    model: mujoco.MjModel, data: mujoco.MjData, hulls: list[Shape], camera: Camera, offset: Float
) -> tuple[PolyCollection, PolyCollection]:
    """The robot in the pose of `data` and its shadow on z = 0, moved by `offset` (2,) in the picture.

    Only faces towards the camera are drawn, the farthest first.
    """
    light = _LIGHT / np.linalg.norm(_LIGHT)
    polygons, colours, shadow = [], [], []
    for shape in hulls:
        rotation = data.geom_xmat[shape.geom].reshape(3, 3)
        corners = shape.corners @ rotation.T + data.geom_xpos[shape.geom]
        normals = shape.normals @ rotation.T
        seen = normals @ camera.axes[2] > 0
        shade = _AMBIENT + (1 - _AMBIENT) * np.clip(normals[seen] @ light, 0, 1)
        polygons.append(camera.project(corners[shape.triangles[seen]]))
        colours.append(shade[:, None] * shape.colour)
        shadow.append(camera.project((corners * [1, 1, 0])[shape.triangles[seen]]))
    faces, tints = np.concatenate(polygons), np.concatenate(colours)
    order = np.argsort(faces[:, :, 2].mean(axis=1))
    solid = PolyCollection(
        list(faces[order, :, :2] + offset), facecolors=tints[order], edgecolors=tints[order], linewidths=0.3, zorder=2
    )
    ground = PolyCollection(list(np.concatenate(shadow)[:, :, :2] + offset), color="#e2e5ea", linewidths=0.3, zorder=1)
    return solid, ground


def _corners(model: mujoco.MjModel, geom: int) -> Float | None:
    size, kind = model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return size * (np.stack(np.meshgrid(*[[-1, 1]] * 3), axis=-1).reshape(-1, 3))
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return size[0] * _ball()
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return size * _ball()
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        ball = _ball()
        return size[0] * ball + np.where(ball[:, 2:] >= 0, 1, -1) * [0, 0, size[1]]
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        angle = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)
        rim = size[0] * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        return np.concatenate([rim + [0, 0, size[1]], rim - [0, 0, size[1]]])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        return model.mesh_vert[start : start + model.mesh_vertnum[mesh]].astype(float)
    return None


def _ball() -> Float:
    """Corners of a unit ball, its equator doubled so that a capsule can be split there."""
    latitude = np.radians([-90, -60, -30, -1e-6, 0, 30, 60, 90])[:, None]
    longitude = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)
    x, y = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude)
    return np.stack([x, y, np.broadcast_to(np.sin(latitude), x.shape)], axis=-1).reshape(-1, 3)
