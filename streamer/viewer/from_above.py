"""The balance from above, a small picture in the panel; in the scene the feet hide it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.spatial.heading import heading
from flexmotion.streamer.plots.palette import FAINT, MUTED
from flexmotion.streamer.viewer.colours import COM, DCM, SIDES, ZMP

Float = NDArray[np.float64]
Row = np.ndarray[Any, Any]

_WIDTH, _HEIGHT = 280, 130
"""Size of the picture [pixels]."""
_SPAN_STANCES = 3.0
"""Height of the picture, in widths of the stance."""
_BAR_M = 0.05


def draw_from_above(row: Row, robot: Robot) -> str:
    """Planned soles, zero-moment point, divergent component and centre of mass as SVG; "" without a plan.

    The robot faces the top of the picture; its middle is the planned centre of mass.
    """
    if not (np.isfinite(row["foot_ref"]).all() and np.isfinite(row["com_ref"]).all()):
        return ""
    # From the soles, not from the steps, so that the scale stays constant.
    stance = 2 * float(np.abs(robot.sole_half_size).max() + robot.sole_half_size[:, 1].max())
    scale = _HEIGHT / (_SPAN_STANCES * stance / 2)
    yaw = float(heading(row["base_ref"][3:]))
    turn = np.array([[np.sin(yaw), -np.cos(yaw)], [-np.cos(yaw), -np.sin(yaw)]])

    def to_picture(points: Float) -> Float:
        return (points - row["com_ref"]) @ turn.T * scale + [_WIDTH / 2, _HEIGHT / 2]

    shapes = [_bar(scale)]
    for foot, sole in enumerate(row["foot_ref"]):
        corners = to_picture(_corners(sole, robot.sole_half_size[foot]))
        outline = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
        opacity = 0.35 if row["contact_ref"][foot] else 0.08
        shapes.append(
            f'<polygon points="{outline}" fill="{SIDES[foot]}" fill-opacity="{opacity}" stroke="{SIDES[foot]}"/>'
        )
    for points, colour, filled in (
        (row["zmp_ref"], ZMP, False),
        (row["dcm_ref"], DCM, False),
        (row["zmp_ref"] + row["zmp_shift"], ZMP, True),
        (row["dcm"], DCM, True),
        (row["com"], COM, True),
    ):
        if np.isfinite(points).all():
            shapes.append(_dot(to_picture(points), colour, filled))
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" style="width:100%;border:1px solid {FAINT};border-radius:4px">'
        f"{''.join(shapes)}</svg>"
    )


def _corners(sole: Float, half: Float) -> Float:
    x, y, _, yaw = sole
    corners = half * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return corners @ np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]) + [x, y]


def _dot(place: Float, colour: str, filled: bool) -> str:
    look = f'fill="{colour}" r="3.5"' if filled else f'fill="none" stroke="{colour}" stroke-width="1.6" r="6"'
    return f'<circle cx="{place[0]:.1f}" cy="{place[1]:.1f}" {look}/>'


def _bar(scale: float) -> str:
    """The scale bar."""
    y, end = _HEIGHT - 10, 10 + _BAR_M * scale
    return (
        f'<line x1="10" y1="{y}" x2="{end:.1f}" y2="{y}" stroke="{MUTED}"/>'
        f'<text x="{end + 5:.1f}" y="{y + 3}" font-size="10" fill="{MUTED}">{100 * _BAR_M:g} cm</text>'
    )
