"""The viewer's colours: those of the project's pictures, as viser takes them."""

from __future__ import annotations

from flexmotion.streamer.plots import style

RGB = tuple[int, int, int]


def rgb(colour: str, *, pale: float = 0.0) -> RGB:
    """Red, green, blue in 0 .. 255 of "#rrggbb", mixed with `pale` parts of white."""
    red, green, blue = (round(int(colour[i : i + 2], 16) * (1 - pale) + 255 * pale) for i in (1, 3, 5))
    return red, green, blue


SIDES = (style.LEFT, style.RIGHT)
"""Left and right."""
PLAN = "#3b82c4"
"""The planned robot."""
ZMP, DCM, COM = style.MIDDLE, style.HUMAN, style.INK
FORCE = "#e69f00"
PATH = style.MUTED
"""Zero-moment point, divergent component of motion, centre of mass, ground forces, the way that was gone."""
