"""A robot in viser's scene: a tree of frames, one for each body, with the meshes of its geoms."""

from __future__ import annotations

import numpy as np
import trimesh
import viser

from flexmotion.streamer.viewer.colours import RGB
from flexmotion.streamer.viewer.geometry import GeomMesh
from flexmotion.streamer.viewer.pose import Pose

_HALO_M, _HALO_OPACITY = 0.002, 0.45
_STILL = 1e-5
"""Changes below this are not sent [m; component of a quaternion]."""


class Figure:
    """Bodies under a node of the scene. Frames are relative to their parents: a moved joint is one message.

    Args:
        under: name of the node.
        meshes: meshes of `geometry.geom_meshes`.
        halo: colour of a figure that shows only as an outline around what covers it: translucent, slightly larger,
            without its front faces. None: a solid figure in its geoms' colours.

    Attributes:
        frames: frames of the bodies by id, without the world.
        meshes: handles of the meshes, in their order.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        under: str,
        pose: Pose,
        meshes: list[GeomMesh],
        *,
        halo: RGB | None = None,
    ) -> None:
        self.pose = pose
        self._position, self._quaternion = pose.in_parents()
        self.root = scene.add_frame(under, show_axes=False)
        self.frames: dict[int, viser.FrameHandle] = {}
        names = {0: under}
        for body in range(1, pose.model.nbody):
            names[body] = f"{names[int(pose.model.body_parentid[body])]}/{pose.model.body(body).name or body}"
            self.frames[body] = scene.add_frame(
                names[body], show_axes=False, wxyz=self._quaternion[body], position=self._position[body]
            )
        self.meshes = [_add(scene, f"{names[mesh.body]}/geom_{mesh.geom}", mesh, halo) for mesh in meshes]

    def update(self) -> None:
        """Show the present `pose`; only frames that moved are sent."""
        position, quaternion = self.pose.in_parents()
        moved = np.abs(position - self._position).max(axis=1) > _STILL
        turned = np.abs(quaternion - self._quaternion).max(axis=1) > _STILL
        for body, frame in self.frames.items():
            if moved[body]:
                frame.position = self._position[body] = position[body]
            if turned[body]:
                frame.wxyz = self._quaternion[body] = quaternion[body]


def _add(scene: viser.SceneApi, name: str, mesh: GeomMesh, halo: RGB | None) -> viser.MeshHandle:
    if halo is None:
        return scene.add_mesh_simple(name, mesh.vertices, mesh.faces, color=mesh.colour)
    # Vertices that were split for sharp edges are merged, so that the enlarged surface stays closed.
    whole = trimesh.Trimesh(mesh.vertices, mesh.faces)
    return scene.add_mesh_simple(
        name,
        whole.vertices + _HALO_M * whole.vertex_normals,
        whole.faces,
        color=halo,
        opacity=_HALO_OPACITY,
        side="back",
        cast_shadow=False,
        receive_shadow=False,
    )
