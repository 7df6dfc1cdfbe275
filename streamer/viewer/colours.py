"""The viewer's colours: those of the pictures, in viser's format."""

from __future__ import annotations

from flexmotion.streamer.plots import palette

RGB = tuple[int, int, int]


def rgb(colour: str, *, pale: float = 0.0) -> RGB:
    """Red, green, blue in 0 .. 255 of "#rrggbb", mixed with `pale` parts of white."""
    red, green, blue = (round(int(colour[i : i + 2], 16) * (1 - pale) + 255 * pale) for i in (1, 3, 5))
    return red, green, blue


SIDES = (palette.LEFT, palette.RIGHT)
"""Left and right."""
PLAN = "#3b82c4"
"""The planned robot."""
ZMP, DCM, COM = palette.MIDDLE, palette.HUMAN, palette.INK
FORCE = "#e69f00"
PATH = palette.MUTED
"""Zero-moment point, divergent component of motion, centre of mass, ground forces, path."""
