"""`ViewPage`: the web page of a run."""

from __future__ import annotations

import math
import sys
import threading
import time
from functools import partial

import numpy as np
import rich
import viser

from flexmotion.configs.robot import Robot
from flexmotion.streamer.control.telemetry import Telemetry, events
from flexmotion.streamer.viewer.colours import PLAN, rgb
from flexmotion.streamer.viewer.figure import Figure
from flexmotion.streamer.viewer.floor import BalanceMarks, Footprints, Path, Row
from flexmotion.streamer.viewer.geometry import geom_meshes
from flexmotion.streamer.viewer.health import Health
from flexmotion.streamer.viewer.panel import Panel
from flexmotion.streamer.viewer.pose import MeasuredPose, PlannedPose

_DRAW_S, _IDLE_S, _TEXT_S = 0.04, 1.0, 0.25
"""Time between pictures, between pictures without a client, and between updates of the panel [s]."""
_CLOSE_S = 1.0
"""Time for the server to close its connections [s]."""
_FOLLOW_S = 0.4
"""Time constant with which the view follows the robot, long enough to filter its sway [s]."""
_CELL_M, _SECTION_M = 0.05, 0.25
_AMBIENT = 0.8
"""Intensity of the ambient light, beside viser's own lights."""


class ViewPage:
    """A viser server that shows the robot.

    To follow the robot the world moves under it, not the camera: the user can turn the view meanwhile, and following
    costs one message for each picture.

    Attributes:
        server: viser's server.
        measured, planned: figures of the robot.
    """

    def __init__(self, robot: Robot, telemetry: Telemetry, host: str, port: int) -> None:
        self.rows, self.events = telemetry.ticks.reader(), telemetry.events.reader()
        self.health = Health(robot)
        self.is_pose, self.plan_pose = MeasuredPose(robot), PlannedPose(robot)
        height = 2.0 * float(self.is_pose.base[2])
        rich.reconfigure(quiet=True)  # viser writes to stdout, which is for results
        self.server = viser.ViserServer(host, port, label=f"FlexMotion · {robot.name}", verbose=False)
        if self.server.get_port() != port:  # the port was taken meanwhile
            print(f"view: http://{host}:{self.server.get_port()}", file=sys.stderr, flush=True)
        scene = self.server.scene
        self._light(scene, height)
        self.world = scene.add_frame("/world", show_axes=False)
        scene.add_grid(
            "/world/floor",
            infinite_grid=True,
            cell_size=_CELL_M,
            section_size=_SECTION_M,
            cell_color=(233, 235, 239),
            section_color=(214, 218, 225),
            plane_color=(250, 250, 251),
            plane_opacity=1.0,
            shadow_opacity=0.25,
            fade_distance=12.0 * height,
        )
        meshes = geom_meshes(robot.model)
        self.measured = Figure(scene, "/world/robot", self.is_pose, meshes)
        self.planned = Figure(scene, "/world/plan", self.plan_pose, meshes, halo=rgb(PLAN))
        self.footprints = Footprints(scene, "/world/footprints", robot)
        self.balance = BalanceMarks(scene, "/world/balance", robot, height)
        self.path = Path(scene, "/world/path")
        self.panel = Panel(self.server.gui, robot.name)
        self._follows, self._shows_plan = True, True
        self._add_toggles()
        self._centre: np.ndarray | None = None
        self._drawn = self._written = -math.inf

    def follow(self, last: bool) -> None:
        """Draw what is new, if it is time; the last call ends the server."""
        now = time.perf_counter()
        since = now - self._drawn
        if last or since >= (_DRAW_S if self.server.get_clients() else _IDLE_S):
            self._drawn = now
            rows = self.rows.read()
            self.health.events.extend(events(self.events))
            if len(rows):
                with self.server.atomic():
                    self._draw(rows, min(since, 1.0))
            if last or now - self._written >= _TEXT_S:
                self._written = now
                self.panel.show(self.health)
        if last:
            self._close()

    def _close(self) -> None:
        """End the server without waiting for a stalled client."""
        self.server.flush()
        closing = threading.Thread(target=self.server.stop, daemon=True)
        closing.start()
        closing.join(_CLOSE_S)

    def _draw(self, rows: Row, elapsed_s: float) -> None:
        row = rows[-1]
        self.health.take(rows)
        known = self.is_pose.show(row)
        if known:
            self.measured.update()
            self._move_world(elapsed_s)
        self.planned.root.visible = self.plan_pose.show(row) and self._shows_plan
        if self.planned.root.visible:
            self.planned.update()
        self.path.take(rows)
        self.footprints.take(rows)
        self.footprints.show(row)
        self.balance.show(row, self.is_pose.com if known else None)

    def _move_world(self, elapsed_s: float) -> None:
        place = self.is_pose.base[:2]
        if self._centre is None:
            self._centre = place.copy()
        if self._follows:
            self._centre += (1.0 - math.exp(-elapsed_s / _FOLLOW_S)) * (place - self._centre)
        self.world.position = (-self._centre[0], -self._centre[1], 0.0)

    def _light(self, scene: viser.SceneApi, height: float) -> None:
        scene.set_up_direction("+z")
        scene.add_light_ambient("/ambient", intensity=_AMBIENT)
        camera = self.server.initial_camera
        camera.position = (1.45 * height, -1.5 * height, 0.95 * height)
        camera.look_at = (0.0, 0.0, 0.42 * height)
        camera.fov = math.radians(40.0)
        self.server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")

    def _add_toggles(self) -> None:
        toggle = self.panel.toggle
        toggle("Follow the robot", "the view stays with the robot", lambda on: setattr(self, "_follows", on))
        toggle("Planned robot", "a halo in the pose of the plan", lambda on: setattr(self, "_shows_plan", on))
        for label, hint, node in (
            ("Balance", "zero-moment point, divergent component, centre of mass, forces", self.balance.root),
            ("Footprints", "planned soles: strong where they bear load", self.footprints.root),
            ("Path", "path of the torso", self.path.root),
        ):
            toggle(label, hint, partial(setattr, node, "visible"))
