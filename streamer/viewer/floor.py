"""Marks on the floor: footprints, balance, and the path of the torso."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.viewer.colours import COM, DCM, FORCE, PATH, SIDES, ZMP, rgb

Float = NDArray[np.float64]
Row = np.ndarray[Any, Any]

_PRINT_Z, _PATH_Z, _MARK_Z = 0.001, 0.002, 0.012
"""Heights above the floor, in drawing order; the last one is above the foot plates [m]."""
_BORDER = 0.006
"""Border of a footprint around the sole [m]."""
_THICK = 0.0015
_PRINTS_KEPT = 60
_PATH_STEP, _PATH_KEPT = 0.01, 600
"""Distance between points of the path [m], and number of points kept."""
_FORCE_SCALE = 0.4
"""Length of an arrow for the robot's weight, as a share of its standing height."""


class Footprints:
    """Planned soles, strong in contact, pale in swing; outlines of earlier footprints."""

    def __init__(self, scene: viser.SceneApi, under: str, robot: Robot) -> None:
        self.half = robot.sole_half_size + _BORDER
        self.root = scene.add_frame(under, show_axes=False)
        self._shown_contact = [True, True]
        self.soles = [
            scene.add_box(
                f"{under}/{side}",
                color=rgb(SIDES[foot], pale=0.3),
                dimensions=(*(2 * self.half[foot]), _THICK),
                cast_shadow=False,
                visible=False,
            )
            for foot, side in enumerate(("left", "right"))
        ]
        self.earlier = scene.add_line_segments(
            f"{under}/earlier", np.zeros((1, 2, 3)), (0, 0, 0), thickness=0.002, visible=False
        )
        self._lines: deque[tuple[Float, NDArray[np.uint8]]] = deque(maxlen=_PRINTS_KEPT)
        self._contact = np.zeros(2, bool)

    def take(self, rows: Row) -> None:
        """Take all rows (k,) of `flexmotion.streamer.control.tick_row` in order: store where soles have landed."""
        contact = np.concatenate([self._contact[None], rows["contact_ref"]])
        self._contact = contact[-1].copy()
        landed = np.argwhere(contact[1:] & ~contact[:-1])
        for row, foot in landed:
            self._lines.append(self._outline(rows["foot_ref"][row, foot], int(foot)))
        if len(landed):
            self.earlier.points = np.concatenate([line for line, _ in self._lines]).astype(np.float32)
            self.earlier.colors = np.concatenate([colour for _, colour in self._lines])
            self.earlier.visible = True

    def show(self, row: Row) -> None:
        """Show the planned soles of a row."""
        for foot, sole in enumerate(self.soles):
            x, y, _, yaw = row["foot_ref"][foot]
            sole.visible = known = bool(np.isfinite(x))
            if not known:
                continue
            sole.position = (x, y, _PRINT_Z)
            sole.wxyz = (np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2))
            if self._shown_contact[foot] != bool(row["contact_ref"][foot]):
                self._shown_contact[foot] = bool(row["contact_ref"][foot])
                sole.color = rgb(SIDES[foot], pale=0.3 if self._shown_contact[foot] else 0.75)

    def _outline(self, sole: Float, foot: int) -> tuple[Float, NDArray[np.uint8]]:
        x, y, _, yaw = sole
        along, across = self.half[foot]
        corners = np.array([[along, across], [-along, across], [-along, -across], [along, -across]])
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        ring = np.column_stack([corners @ turn.T + [x, y], np.full(4, _PRINT_Z)])
        lines = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
        return lines, np.full((4, 2, 3), rgb(SIDES[foot], pale=0.35), np.uint8)


class BalanceMarks:
    """Zero-moment point and divergent component: rings are planned; discs are commanded and estimated.

    The centre of mass is a ball with a plumb line; in simulation arrows show the ground forces.
    """

    def __init__(self, scene: viser.SceneApi, under: str, robot: Robot, standing_height: float) -> None:
        self.root = scene.add_frame(under, show_axes=False)
        radius = 0.25 * float(robot.sole_half_size.min())
        self._newton_m = _FORCE_SCALE * standing_height / (robot.mass * GRAVITY)
        self.zmp_ref = _ring(scene, f"{under}/zmp_planned", 1.5 * radius, ZMP)
        self.zmp = _disc(scene, f"{under}/zmp", radius, ZMP)
        self.dcm_ref = _ring(scene, f"{under}/dcm_planned", 1.5 * radius, DCM)
        self.dcm = _disc(scene, f"{under}/dcm", radius, DCM)
        self.com = scene.add_icosphere(f"{under}/com", radius, rgb(COM), visible=False, cast_shadow=False)
        self.plumb = scene.add_cylinder(
            f"{under}/plumb", 0.0012, 1.0, rgb(COM), radial_segments=8, visible=False, cast_shadow=False
        )
        self.forces = scene.add_arrows(
            f"{under}/forces",
            np.zeros((2, 2, 3)),
            rgb(FORCE),
            shaft_radius=0.3 * radius,
            head_radius=0.8 * radius,
            head_length=2 * radius,
            visible=False,
        )

    def show(self, row: Row, com: Float | None) -> None:
        """Show a row; `com` is the centre of mass of the robot as drawn, (3,) [m], None if unknown."""
        for mark, place in (
            (self.zmp_ref, row["zmp_ref"]),
            (self.zmp, row["zmp_ref"] + row["zmp_shift"]),
            (self.dcm_ref, row["dcm_ref"]),
            (self.dcm, row["dcm"]),
        ):
            mark.visible = known = bool(np.isfinite(place).all())
            if known:
                mark.position = (place[0], place[1], _MARK_Z)
        self.com.visible = self.plumb.visible = com is not None
        if com is not None:
            self.com.position = com
            self.plumb.position = (com[0], com[1], com[2] / 2)
            self.plumb.scale = (1.0, 1.0, float(com[2]))
        self._show_forces(row)

    def _show_forces(self, row: Row) -> None:
        known = bool(np.isfinite(row["true_foot_force"]).all() and row["true_foot_force"][:, 2].max() > 0)
        self.forces.visible = known
        if known:
            foot = row["true_foot"]
            self.forces.points = np.stack([foot, foot + self._newton_m * row["true_foot_force"]], axis=1)


class Path:
    """Path of the torso on the floor."""

    def __init__(self, scene: viser.SceneApi, under: str) -> None:
        self.root = scene.add_frame(under, show_axes=False)
        self.line = scene.add_line_segments(
            f"{under}/line", np.zeros((1, 2, 3)), rgb(PATH), thickness=0.003, visible=False
        )
        self._points: deque[Float] = deque(maxlen=_PATH_KEPT)

    def take(self, rows: Row) -> None:
        """Take rows (k,): the true position of the torso, or the planned one if unknown."""
        base = np.where(np.isfinite(rows["true_base"]), rows["true_base"], rows["base_ref"])[:, :2]
        grown = False
        for x, y in base[np.isfinite(base).all(axis=1)]:
            place = np.array([x, y, _PATH_Z])
            if not self._points or np.linalg.norm(place - self._points[-1]) >= _PATH_STEP:
                self._points.append(place)
                grown = True
        if grown and len(self._points) > 1:
            path = np.array(self._points, np.float32)
            self.line.points = np.stack([path[:-1], path[1:]], axis=1)
            self.line.visible = True


def _disc(scene: viser.SceneApi, name: str, radius: float, colour: str) -> viser.CylinderHandle:
    return scene.add_cylinder(name, radius, _THICK, rgb(colour), visible=False, cast_shadow=False)


def _ring(scene: viser.SceneApi, name: str, radius: float, colour: str) -> viser.MeshHandle:
    ring = trimesh.creation.annulus(0.75 * radius, radius, _THICK, sections=48)
    return scene.add_mesh_simple(
        name, ring.vertices, ring.faces, color=rgb(colour), flat_shading=True, visible=False, cast_shadow=False
    )
