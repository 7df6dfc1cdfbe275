"""Options of `flexmotion send` for one part of the body: where it is to be, or what it may not do."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import typer

_IN_S_MOST = 10.0


@dataclass(frozen=True)
class PartOptions:
    """One part, and where it is to be or what it may not do."""

    hand: Annotated[
        tuple[str, float, float, float] | None,
        typer.Option(
            "--hand",
            metavar="SIDE X Y Z",
            help="Bring the left or right hand there: ahead, left, up in the trunk's frame \\[m].",
            show_default=False,
        ),
    ] = None
    foot: Annotated[
        tuple[str, float, float] | None,
        typer.Option(
            "--foot",
            metavar="SIDE X Y",
            help="Step there with the left or right foot: ahead, left of the other sole \\[m]; --heading: of its toes.",
            show_default=False,
        ),
    ] = None
    head: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            "--head",
            metavar="X Y Z",
            help="Bring the head there by hips and trunk: ahead, left of the middle between the soles, up from the "
            "floor \\[m]; nan for X or Y: wherever the height leads.",
            show_default=False,
        ),
    ] = None
    point: Annotated[
        tuple[str, float, float, float] | None,
        typer.Option(
            "--point",
            metavar="SIDE X Y Z",
            help="Point there with the left or right arm: a direction.",
            show_default=False,
        ),
    ] = None
    look: Annotated[
        tuple[float, float, float] | None,
        typer.Option("--look", metavar="X Y Z", help="Turn the head there: a direction.", show_default=False),
    ] = None
    joint: Annotated[
        tuple[str, float] | None,
        typer.Option(
            "--joint", metavar="NAME DEGREES", help="Bring a joint of arms or head to an angle.", show_default=False
        ),
    ] = None
    contact: Annotated[
        str | None,
        typer.Option(
            "--contact", metavar="FOOT", help="Keep a foot on the ground: left, right or both.", show_default=False
        ),
    ] = None
    torque: Annotated[
        tuple[str, float] | None,
        typer.Option(
            "--torque",
            metavar="JOINT NM",
            help='Ask no more torque of a joint: its name, "knee", "left knee" \\[N·m].',
            show_default=False,
        ),
    ] = None
    tension: Annotated[
        tuple[str, float] | None,
        typer.Option(
            "--tension",
            metavar="LIMB TENSION",
            help='Let "left arm", "right arm", "both arms" or head follow as stiffly as that: 0 soft, 1 stiff.',
            show_default=False,
        ),
    ] = None
    relax: Annotated[
        str | None,
        typer.Option(
            "--relax",
            metavar="PART",
            help='Let a part go: "left hand", "right hand", "head", "head place", "joint NAME", "left foot", '
            '"right foot", "both feet", "torque NAME", "tension LIMB", or all.',
            show_default=False,
        ),
    ] = None
    in_s: Annotated[
        float | None,
        typer.Option(
            "--in",
            min=0.0,
            max=_IN_S_MOST,
            help="The part is there after so many seconds.",
            show_default="0.5, a foot or --head: 1",
        ),
    ] = None

    @property
    def given(self) -> dict[str, object]:
        """The options that name a part, by their names; None where one is not given."""
        return {
            "--hand": self.hand,
            "--foot": self.foot,
            "--head": self.head,
            "--point": self.point,
            "--look": self.look,
            "--joint": self.joint,
            "--contact": self.contact,
            "--torque": self.torque,
            "--tension": self.tension,
            "--relax": self.relax,
        }

    def message(self, tolerance_m: float | None, heading: float | None = None) -> dict[str, Any]:
        """The fields of the message of the one that is given; those that are None are left out when it is sent.

        Args:
            tolerance_m: of the place of a hand, a foot or the head [m].
            heading: of a foot [rad].
        """
        if self.hand is not None:
            side, *place = self.hand
            return {"type": "hand", "side": side, "position_m": place, "tolerance_m": tolerance_m, "in_s": self.in_s}
        if self.foot is not None:
            side, *place = self.foot
            fields = {"side": side, "position_m": place, "heading_rad": heading, "tolerance_m": tolerance_m}
            return {"type": "foot", **fields, "in_s": self.in_s}
        if self.head is not None:
            x, y, height = self.head
            there = [*(None if math.isnan(value) else value for value in (x, y)), height]
            return {"type": "head", "position_m": there, "tolerance_m": tolerance_m, "in_s": self.in_s}
        if self.point is not None:
            side, *direction = self.point
            return {"type": "point", "side": side, "direction": direction, "in_s": self.in_s}
        if self.look is not None:
            return {"type": "look", "direction": list(self.look), "in_s": self.in_s}
        if self.joint is not None:
            name, degrees = self.joint
            return {"type": "joint", "joint": name, "angle_rad": math.radians(degrees), "in_s": self.in_s}
        if self.contact is not None:
            return {"type": "contact", "foot": self.contact}
        if self.torque is not None:
            named, limit = self.torque
            return {"type": "torque", "joint": named, "limit_nm": limit}
        if self.tension is not None:
            limb, tension = self.tension
            return {"type": "tension", "limb": limb, "tension": tension}
        return {"type": "relax", "part": self.relax}
