"""Units and axes of motion files; units are those of the header, else those in which the file shows a human."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import MotionFormatError
from flexmotion.importers.capture import Capture
from flexmotion.importers.mapping import Units, Up

Float = NDArray[np.float64]

METRES: dict[Units, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254}

TO_Z_UP: dict[Up, Float] = {
    "z": np.eye(3),
    # y up, z forward, x left becomes z up, x forward, y left.
    "y": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
}

UNITS: dict[str, Units] = {
    "m": "m",
    "meters": "m",
    "metres": "m",
    "cm": "cm",
    "centimeters": "cm",
    "centimetres": "cm",
    "mm": "mm",
    "millimeters": "mm",
    "millimetres": "mm",
    "in": "inch",
    "inch": "inch",
    "inches": "inch",
}
"""Names of units in headers of files."""


@dataclass(frozen=True)
class Size:
    """A size of a human by which units are told.

    Attributes:
        what: name for messages.
        low, high: range among children and adults [m].
        typical: of an adult [m]; it decides where two units are possible.
    """

    what: str
    low: float
    high: float
    typical: float

    def holds(self, value: float) -> bool:
        """Whether a human has this size [m]."""
        return self.low <= value <= self.high


LEG = Size("a leg", 0.45, 1.25, 0.83)
"""Leg length, hip to ankle over the knee."""

PELVIS_WIDTH = Size("a distance between both ASIS", 0.15, 0.42, 0.24)
"""Distance between the markers on both anterior iliac spines."""


def metres_per_unit(
    size: Size, found: float, capture: Capture, given: Units | None, usual: Units | None = None
) -> tuple[float, list[str]]:
    """Factor from the positions of a capture to metres, and a warning where the header is wrong.

    Args:
        size: by which units are told.
        found: that size in the capture, in units of its positions.
        capture: positions are in metres by the unit of its header, `capture.units`, else in unknown units.
        given: units of the file if known; they are taken in any case.
        usual: units of such files, for one whose header names none.

    Raises:
        MotionFormatError: the size is not a human's in any unit.
    """
    header = capture.units
    of_file = found if header is None else found / METRES[header]
    known = given or (usual if header is None else None)
    if known is not None:
        return METRES[known] / (1.0 if header is None else METRES[header]), []
    if header is not None and size.holds(found):
        return 1.0, []
    possible = {unit: of_file * metres for unit, metres in METRES.items() if size.holds(of_file * metres)}
    if not possible:
        said = f" (the header says {header})" if header else ""
        raise MotionFormatError(
            f"{capture.path}: {size.what} of {of_file:.4g}{said} is not a human's in any of {', '.join(METRES)}, "
            f"expected {size.low} to {size.high} m; is the mapping right?"
        )
    unit = min(possible, key=lambda name: abs(np.log(possible[name] / size.typical)))
    if header is None:
        return METRES[unit], []
    return METRES[unit] / METRES[header], [
        f"the header says {header}, in which {size.what} would be {found:.3g} m: the coordinates are taken as {unit}, "
        f"in which it is {possible[unit]:.2f} m"
    ]
