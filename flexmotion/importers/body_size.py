"""Mass of the human in a clip, as given or guessed, and checks of mass and stature."""

from __future__ import annotations

import math
from dataclasses import replace

from flexmotion.configs.errors import ConfigError
from flexmotion.human.body import Body

BODY_MASS_INDEX = Body().mass / Body().height ** 2
"""Mass over squared stature of a mean adult [kg/m²], 22.9, that of the default body; the normal range is 18.5 to 25."""

MASS_ERROR = 0.3
"""How far a mass guessed from the stature may be off; the greatest error found on gait trials is 29 %."""

MASSES, HEIGHTS = (10.0, 300.0), (0.8, 2.5)
"""Ranges of mass [kg] and stature [m] that are accepted."""


SAME_SIZE = 1e-6
"""Greatest relative difference of equal masses or heights."""


def is_guess(body: Body) -> bool:
    """Whether a body of unknown origin has the default mass, or the mass that `with_mass` guesses."""
    guesses = (Body().mass, BODY_MASS_INDEX * body.height**2)
    return any(math.isclose(body.mass, guess, rel_tol=SAME_SIZE) for guess in guesses)


def check_size(mass: float | None, height: float | None) -> None:
    """Check a given mass [kg] and stature [m].

    Raises:
        ConfigError: one of them is not a human's.
    """
    for name, unit, value, (low, high) in (("mass", "kg", mass, MASSES), ("height", "m", height, HEIGHTS)):
        if value is not None and not low <= value <= high:
            raise ConfigError(f"{name} is {value:g} {unit}, expected {low:g} to {high:g} {unit}")


def with_mass(body: Body, mass: float | None, height: float | None) -> tuple[Body, str]:
    """A fitted body with its mass [kg], and a warning where it is guessed from the stature, else an empty text.

    Args:
        body: as fitted, or of a motion whose mass is a guess.
        mass: [kg]; None for a guess.
        height: stature as given [m]; None if it is an estimate too.
    """
    if mass is not None:
        return replace(body, mass=mass), ""
    guess = BODY_MASS_INDEX * body.height**2
    of = "the given" if height is not None else "the estimated"
    return replace(body, mass=guess), (
        f"mass of {guess:.0f} kg is guessed from {of} height of {body.height:.2f} m (body mass index "
        f"{BODY_MASS_INDEX:.1f}); it may be off by {100 * MASS_ERROR:.0f} %, and forces with it: give the mass"
    )
