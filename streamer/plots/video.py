"""`write_video`: motions side by side as an MP4, drawn without a screen; needs the extra `video`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol

import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError, FilmError
from flexmotion.configs.robot import Robot
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.plots.filmstrip import known_poses, limbs, shown_base, standing_height
from flexmotion.streamer.plots.palette import FAINT, MUTED, WARN
from flexmotion.streamer.plots.solid import Camera, draw_solid, shapes
from flexmotion.streamer.plots.style import styled

Float = NDArray[np.float64]

FPS = 20
"""Frames a second of a video."""

DOTS = 100
"""Dots per inch; a panel is `PANEL_IN` wide and high [inch], its size in dots even, as the format asks."""

PANEL_IN = (2.6, 3.2)
_AZIMUTH_DEG, _ELEVATION_DEG = -55.0, 12.0
_TILE = 0.5
"""Distance of the lines on the floor, in heights."""


class Scene(Protocol):
    """What one panel shows."""

    @property
    def height(self) -> float:
        """By which the picture is scaled [m]."""
        ...

    def draw(self, axes: Axes, camera: Camera, at_s: float) -> Float:
        """Draw a moment; returns the place that the picture is centred on, on the floor, (3,) [m]."""
        ...


@dataclass(frozen=True)
class HumanScene:
    """A human as lines; arrows are ground reaction forces, a body weight as long as a leg.

    Attributes:
        motion: that is shown from its first frame; its last one stays.
        clock: time of the video to time of the motion [s].
    """

    motion: Motion
    clock: Callable[[float], float] = field(default=lambda at_s: at_s)

    @property
    def height(self) -> float:
        """Of the human [m]."""
        return float(self.motion.body.height)

    def draw(self, axes: Axes, camera: Camera, at_s: float) -> Float:
        """See `Scene`."""
        frame = int(np.clip(round(self.clock(at_s) * self.motion.fps), 0, len(self.motion) - 1))
        pose = forward(self.motion[frame : frame + 1])
        centre: Float = pose.pelvis_position[0] * [1.0, 1.0, 0.0]
        for points, colour in limbs(pose):
            line = camera.project(points - centre)[:, :2]
            axes.add_collection(LineCollection([line], colors=colour, linewidths=2.4, capstyle="round", zorder=3))
        if self.motion.wrenches is not None and self.motion.pressure_centres is not None:
            weight = self.motion.body.mass * GRAVITY
            forces, places = self.motion.wrenches[frame, :, :3], self.motion.pressure_centres[frame]
            for force, place in zip(forces, places, strict=True):
                arrow = np.stack([place, place + force / weight * self.motion.body.leg]) - centre
                line = camera.project(arrow)[:, :2]
                axes.add_collection(LineCollection([line], colors=WARN, linewidths=1.1, zorder=4))
        return centre


class RobotScene:
    """A robot as it moved in a run, by the simulation's truth where there is one, else as planned.

    Args:
        record: of the run.
        robot: its model.
        begin_s: time of the run at which the video begins [s].

    Raises:
        ValueError: no pose of the robot is known, see `known_poses`.
    """

    def __init__(self, record: RunTrace, robot: Robot, begin_s: float = 0.0) -> None:
        valid = known_poses(record)
        if not valid.any():
            raise ValueError("no tick of the run has a known pose")
        self._time = record.time_s[: record.used][valid] - begin_s
        self._base, self._joints = shown_base(record)[valid], record.q[: record.used][valid]
        self._robot, self._hulls = robot, shapes(robot.model)
        self._data = mujoco.MjData(robot.model)
        self._height = standing_height(robot)

    @property
    def height(self) -> float:
        """Of the robot as it stands [m]."""
        return self._height

    def draw(self, axes: Axes, camera: Camera, at_s: float) -> Float:
        """See `Scene`."""
        tick = int(np.clip(np.searchsorted(self._time, at_s), 0, len(self._time) - 1))
        centre: Float = self._base[tick, :3] * [1.0, 1.0, 0.0]
        self._data.qpos[:7] = self._base[tick]
        self._data.qpos[:2] = 0.0
        self._data.qpos[self._robot.qpos_address] = self._joints[tick]
        mujoco.mj_kinematics(self._robot.model, self._data)
        for collection in draw_solid(self._robot.model, self._data, self._hulls, camera, np.zeros(2)):
            axes.add_collection(collection)
        return centre


def source_clock(record: RunTrace, begin_s: float) -> Callable[[float], float]:
    """Time of a video to time of a run's source [s]: its first moment before it plays, its last one afterwards."""
    played = np.flatnonzero(np.isfinite(record.source_s[: record.used]))
    if not len(played):
        return lambda at_s: 0.0
    times, source = record.time_s[played] - begin_s, record.source_s[played]
    return lambda at_s: float(np.interp(at_s, times, source))


def film_run(path: Path, record: RunTrace, robot: Robot, motion: Motion | None) -> Path | None:
    """Film a run: the robot, beside its human where that is known; None where no pose of the robot is.

    Raises:
        ConfigError: the extra `video` is not installed.
    """
    check_video()
    if not known_poses(record).any():
        return None
    begin, end = float(record.time_s[0]), float(record.time_s[record.used - 1])
    panels: list[tuple[str, Scene]] = [("robot", RobotScene(record, robot, begin))]
    if motion is not None:
        panels.insert(0, ("human", HumanScene(motion, source_clock(record, begin))))
    return write_video(path, panels, end - begin)


def check_video() -> None:
    """Raise `ConfigError` where the extra `video` is not installed, or has no encoder for this platform."""
    if find_spec("imageio_ffmpeg") is None:
        raise ConfigError("a video needs the extra 'video': pip install 'flexmotion[video]'")
    import imageio_ffmpeg

    try:
        imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise ConfigError("a video needs ffmpeg: the extra 'video' has none for this platform, install it") from error


def write_video(path: Path, panels: Sequence[tuple[str, Scene]], seconds: float) -> Path:
    """Film scenes side by side.

    Args:
        path: of the MP4.
        panels: titles and scenes, from left to right.
        seconds: of the video.

    Raises:
        ConfigError: the extra `video` is not installed.
        FilmError: the file cannot be written.
    """
    check_video()
    import imageio_ffmpeg

    camera = Camera.at(_AZIMUTH_DEG, _ELEVATION_DEG)
    figure = Figure(figsize=(PANEL_IN[0] * len(panels), PANEL_IN[1]), dpi=DOTS)
    canvas = FigureCanvasAgg(figure)
    size = tuple(int(value) for value in figure.get_size_inches() * DOTS)
    # Written under another name, so that a film that was not finished is never taken for one.
    begun = path.with_name(f"{path.stem}.part{path.suffix}")
    writer = imageio_ffmpeg.write_frames(str(begun), size, fps=FPS, codec="libx264", macro_block_size=2)
    try:
        path.unlink(missing_ok=True)
        writer.send(None)
        with styled():
            for number in range(max(1, round(seconds * FPS))):
                figure.clear()
                for place, (title, scene) in enumerate(panels):
                    axes = figure.add_axes((place / len(panels), 0.0, 1.0 / len(panels), 0.94))
                    centre = scene.draw(axes, camera, number / FPS)
                    _floor(axes, camera, centre, scene.height)
                    axes.set(xlim=(-0.75 * scene.height, 0.75 * scene.height))
                    axes.set(ylim=(-0.3 * scene.height, 1.4 * scene.height), aspect="equal")
                    axes.set_title(title, loc="center", color=MUTED)
                    axes.set_axis_off()
                canvas.draw()
                writer.send(np.asarray(canvas.buffer_rgba())[..., :3].tobytes())
        writer.close()
        imageio_ffmpeg.count_frames_and_secs(str(begun))  # fails where its end was not written
        begun.replace(path)
    except (OSError, RuntimeError) as error:
        problem = str(error).strip().splitlines()[-1:]
        raise FilmError(f"{path}: cannot be written: {''.join(problem)}") from error
    finally:
        writer.close()
        begun.unlink(missing_ok=True)
    return path


def _floor(axes: Axes, camera: Camera, centre: Float, height: float) -> None:
    """Lines of a grid that stays where it is while the picture follows the motion."""
    tile = _TILE * height
    ends = np.array([-2.0, 2.0]) * tile
    lines = []
    for axis in range(2):
        for number in range(-2, 3):
            line = np.zeros((2, 3))
            line[:, axis] = number * tile - centre[axis] % tile
            line[:, 1 - axis] = ends - centre[1 - axis] % tile
            lines.append(camera.project(line)[:, :2])
    axes.add_collection(LineCollection(lines, colors=FAINT, linewidths=0.8, zorder=0))
