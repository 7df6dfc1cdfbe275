"""Mass and stature of the human in a clip, as given or guessed."""

from __future__ import annotations

from dataclasses import replace

from flexmotion.configs.errors import ConfigError
from flexmotion.human.body import Body, Segments

BODY_MASS_INDEX = 23.0
"""Mass over squared stature of a healthy adult [kg/m²]: the middle of the normal range, 18.5 to 25 (WHO), and a little
more, as adults have it in the mean."""

MASS_ERROR = 0.3
"""How far a mass guessed from the stature may be off; the greatest error found on gait trials is 29 %."""

MASSES, HEIGHTS = (10.0, 300.0), (0.8, 2.5)
"""Ranges of mass [kg] and stature [m] that are accepted."""

FREE = ("head", "hand")
"""Sizes that joint centres do not define and that follow the stature."""


def body_of(fitted: Body, mass: float | None, height: float | None) -> tuple[Body, list[str]]:
    """A fitted body with its mass and stature, and a warning where the mass is guessed.

    Args:
        fitted: of `body_fit.fit_body`.
        mass: [kg]; None for a guess from the stature.
        height: stature [m]; None for that of the fit.

    Raises:
        ConfigError: mass or height are not a human's.
    """
    stature = height if height is not None else fitted.height
    guess = BODY_MASS_INDEX * stature**2
    body = sized(fitted, mass if mass is not None else guess, height)
    if mass is not None:
        return body, []
    of = "the given" if height is not None else "the estimated"
    return body, [
        f"mass of {guess:.0f} kg is guessed from {of} height of {stature:.2f} m (body mass index {BODY_MASS_INDEX:g}); "
        f"it may be off by {100 * MASS_ERROR:.0f} %, and forces and torques with it: give --mass"
    ]


def sized(body: Body, mass: float, height: float | None) -> Body:
    """A body with this mass [kg] and, if given, stature [m]: sizes that joint centres do not define follow it.

    Raises:
        ConfigError: mass or height are not a human's.
    """
    for name, value, (low, high) in (("mass", mass, MASSES), ("height", height, HEIGHTS)):
        if value is not None and not low <= value <= high:
            raise ConfigError(f"{name} is {value:g}, expected {low:g} to {high:g} {'kg' if name == 'mass' else 'm'}")
    if height is None:
        return replace(body, mass=mass)
    size = body.fitted
    if size is not None:
        usual = Segments.of_height(height)
        size = replace(size, **{name: getattr(usual, name) for name in FREE})
    return replace(body, mass=mass, height=height, fitted=size)
