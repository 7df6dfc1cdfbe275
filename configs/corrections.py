"""`Corrections`: what one trained model does not do as asked, and what the sampler does about it."""

from __future__ import annotations

from pydantic import Field

from flexmotion.configs.schema import Strict

Velocity = tuple[float, float, float]
"""Forward, left [m/s], turning left [rad/s]."""


class Corrections(Strict):
    """Corrections fitted to one trained model; the default is none.

    `docs/model.md` gives the corrections of the shipped bundle and the measurement behind each.

    Attributes:
        standing_noise: noise scale while standing, relative to other motions.
        aside: gain of sideways velocities.
        ahead_per_aside: forward velocity taken off per sideways velocity.
        turning_per_aside: turning added per sideways velocity, to the same side [rad/m].
        catch_up: share of the velocity that the history lacks which is added to the request, forward, and sideways
            where a sideways velocity is asked for.
        catch_up_limit: greatest velocity that `catch_up` adds [m/s].
        speeds: velocity at which the model moves for a kind of motion without a velocity, by kind. A kind
            without one cannot be slowed to a `Pace`.
    """

    standing_noise: float = Field(default=1.0, ge=0)
    aside: float = Field(default=1.0, gt=0)
    ahead_per_aside: float = 0.0
    turning_per_aside: float = 0.0
    catch_up: float = Field(default=0.0, ge=0)
    catch_up_limit: float = Field(default=0.0, ge=0)
    speeds: dict[str, Velocity] = Field(default_factory=dict)
