"""Zero-moment point, divergent component of motion, and the centre of mass that follows from them.

The linear inverted pendulum with natural frequency w = sqrt(g / h): the divergent component xi = c + c'/w obeys
xi' = w (xi - p), so it is determined by the *future* of the zero-moment point p, and by c' = w (xi - c) the centre of
mass follows it (Englsberger et al. 2015, IEEE T-RO 31(2), eqs. 6, 7 and 15).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.filters import recursive
from flexmotion.spatial.transitions import minimum_jerk

Float = NDArray[np.float64]


def divergent_component(zmp: Float, omega: float, dt: float) -> Float:
    """The bounded solution of xi' = omega (xi - p) for a piecewise constant p that stays at its last row.

    Args:
        zmp: (T, 2) [m]; omega: [1/s]; dt: time a row [s].

    Returns:
        xi at the start of each row, (T, 2) [m].
    """
    decay = np.exp(-omega * dt)
    backwards = recursive([1.0 - decay], [-decay], zmp[::-1], decay * zmp[-1:])
    return backwards[::-1]


def absorb_offset(seconds: float, omega: float, dt: float, rows: int | None = None) -> Float:
    """Displacement of the zero-moment point by `absorb`, per metre of jump, (rows,).

    Args:
        seconds: how long the jump takes to decay [s]; omega: [1/s]; dt: time a row [s].
        rows: number of rows; those until the jump has decayed where not given.
    """
    count = int(np.ceil(seconds / dt)) + 1 if rows is None else rows
    t: Float = np.arange(count, dtype=np.float64) * dt
    # The derivative over the row that follows, so that the discrete recursion holds too.
    share, following = _remaining(t, seconds), _remaining(t + dt, seconds)
    growth = np.exp(omega * dt)
    offset: Float = (growth * share - following) / (growth - 1.0)
    return offset


def _remaining(t: Float, seconds: float) -> Float:
    """Share of a jump that remains after a time [s]."""
    return 1.0 - minimum_jerk(t / seconds)


def absorb(zmp: Float, dcm: Float, error: Float, omega: float, dt: float, seconds: float) -> tuple[Float, Float]:
    """Replace a jump of the divergent component at row 0 by a smooth decay.

    The error e(t) = e0 s(t) decays smoothly to zero, which needs a zero-moment point offset of e - e'/omega.

    Args:
        zmp, dcm: the plan, (T, 2) [m]; error: DCM now minus DCM of row 0, (2,) [m].
        seconds: how long the error takes to decay [s].

    Returns:
        zmp and dcm, (T, 2) [m].
    """
    t: Float = np.arange(len(zmp), dtype=np.float64) * dt
    share = _remaining(t, seconds)
    offset = absorb_offset(seconds, omega, dt, len(zmp))
    return zmp + offset[:, None] * error, dcm + share[:, None] * error


def centre_of_mass(dcm: Float, start: Float, omega: float, dt: float) -> tuple[Float, Float]:
    """Centre of mass that follows the divergent component.

    Args:
        dcm: (T, 2) [m]; start: centre of mass at row 0, (2,) [m].

    Returns:
        Position (T, 2) [m] and velocity (T, 2) [m/s].
    """
    decay = np.exp(-omega * dt)
    tail = recursive([1.0 - decay], [-decay], dcm[:-1], decay * start[None])
    com = np.concatenate([start[None], tail])
    return com, omega * (dcm - com)
