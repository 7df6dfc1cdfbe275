"""`Corrections`: what one trained model does not do as asked, and what the sampler does about it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import Strict

Velocity = tuple[float, float, float]
"""Forward, left [m/s], turning left [rad/s]."""


class Corrections(Strict):
    """Corrections fitted to one trained model; the default is none.

    `docs/model.md` gives the corrections of the shipped bundle and the measurement behind each.

    Attributes:
        standing_noise: noise scale while standing, relative to other motions.
        travelling_noise: most noise of windows that travel. Less of it makes bodies turn less from window to window;
            with too little, slow walks stand: the mean of standing and stepping.
        spot_noise: the same for turning on the spot, which is done with raised hands and bent knees otherwise.
        pose_noise: the same for a pose that is reached and held: with more of it hands sink and rise again by chance.
        ahead: forward velocities that are wanted, and those to ask for, (wanted, asked) in growing order [m/s]; linear
            between them, and parallel to what is wanted beyond them. None: as wanted.
        turning: gain of turning.
        aside: gain of sideways velocities.
        ahead_per_aside: forward velocity taken off per sideways velocity.
        turning_per_aside: turning added per sideways velocity, to the same side [rad/m].
        catch_up: share of the velocity that the history lacks which is added to the request, forward, and sideways
            where a sideways velocity is asked for.
        catch_up_limit: greatest velocity that `catch_up` adds [m/s]; `catch_up` needs one.
        speeds: velocity at which people do a kind of motion for which no velocity is said, by kind. A kind
            without one cannot be slowed to a `Pace`.
        manner_speeds: the same of a manner in which people go at another speed, by manner and kind.
        guidance: scale of the guidance of kinds that need another than the bundle's: with more of it gestures are made
            more surely, and poses beyond what people do.
        normal_guidance: scale of the guidance of the normal manner; None: that of other manners, which need more of it.
    """

    standing_noise: float = Field(default=1.0, ge=0)
    travelling_noise: float = Field(default=1.0, ge=0)
    spot_noise: float = Field(default=1.0, ge=0)
    pose_noise: float = Field(default=1.0, ge=0)
    ahead: tuple[tuple[float, float], ...] = ()
    turning: float = Field(default=1.0, gt=0)
    aside: float = Field(default=1.0, gt=0)
    ahead_per_aside: float = 0.0
    turning_per_aside: float = 0.0
    catch_up: float = Field(default=0.0, ge=0)
    catch_up_limit: float = Field(default=0.0, ge=0)
    speeds: dict[str, Velocity] = Field(default_factory=dict)
    manner_speeds: dict[str, dict[str, Velocity]] = Field(default_factory=dict)
    guidance: dict[str, Annotated[float, Field(gt=0)]] = Field(default_factory=dict)
    normal_guidance: float | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _limited(self) -> Corrections:
        if self.catch_up and not self.catch_up_limit:
            raise ValueError(
                f"catch_up {self.catch_up} has no effect with catch_up_limit 0, expected a limit > 0 [m/s]"
            )
        return self

    @model_validator(mode="after")
    def _grows(self) -> Corrections:
        wanted = [pair[0] for pair in self.ahead]
        if wanted != sorted(set(wanted)):
            raise ValueError(f"ahead is for velocities {wanted}, expected growing ones")
        return self

    def asked_ahead(self, wanted: float) -> float:
        """Forward velocity to ask for [m/s], for the one that is wanted."""
        if not self.ahead:
            return wanted
        at, asked = np.array(self.ahead).T
        inside = float(np.clip(wanted, at[0], at[-1]))
        return float(np.interp(inside, at, asked)) + wanted - inside

    def speed(self, kind: str, manner: str) -> Velocity | None:
        """Velocity of a kind of motion in a manner, for which none is said; None: it is not known."""
        return self.manner_speeds.get(manner, {}).get(kind, self.speeds.get(kind))

    def require_known(self, kinds: Iterable[str], manners: Iterable[str], origin: Path | str) -> None:
        """Raise `ConfigError` if a field names a kind of motion, or a manner, that the model does not know.

        Args:
            kinds, manners: that the model knows.
            origin: file of the corrections, for messages.
        """
        known, ways = sorted(set(kinds)), sorted(set(manners))
        named: dict[str, Iterable[str]] = {"speeds": self.speeds, "guidance": self.guidance}
        for manner, speeds in self.manner_speeds.items():
            if manner not in ways:
                expected = f"expected one of: {', '.join(ways)}" if ways else "this model knows none"
                raise ConfigError(f"{origin}: field manner_speeds.{manner}: unknown manner, {expected}")
            named[f"manner_speeds.{manner}"] = speeds
        for field, of_kinds in named.items():
            for kind in of_kinds:
                if kind not in known:
                    raise ConfigError(
                        f"{origin}: field {field}.{kind}: unknown kind, expected one of: {', '.join(known)}"
                    )
