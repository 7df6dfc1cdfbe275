"""`Gamepad`: what the sticks and buttons of a gamepad do."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from flexmotion.configs.schema import Strict


class Gamepad(Strict):
    """Sticks and buttons by their names in Linux (`evtest` shows those of a gamepad).

    Attributes:
        device: part of the name of the gamepad; None: the first one that is plugged in.
        forward, left, turning: axes; pushed up or to the left they count as forward, left and turning left.
        fastest: speed at full deflection: forward, left [m/s of the human], turning left [rad/s].
        dead_band: deflection that counts as none, as a share of the full one.
        expo: share of the cube in the curve from deflection to speed; 0: straight, 1: finest near the centre.
        enable: button that is held while the sticks are to count; None: they always do.
        buttons: the message that a button sends, without its `source`.
    """

    device: str | None = None
    forward: str = "ABS_Y"
    left: str = "ABS_X"
    turning: str = "ABS_RX"
    fastest: tuple[float, float, float] = (0.6, 0.3, 0.8)
    dead_band: float = Field(default=0.12, ge=0.01, le=0.5)
    expo: float = Field(default=0.4, ge=0, le=1)
    enable: str | None = "BTN_TL"
    buttons: dict[str, dict[str, Any]] = {
        "BTN_EAST": {"type": "stop"},
        "BTN_MODE": {"type": "estop"},
        "BTN_START": {"type": "clear"},
        "BTN_TR": {"type": "arm"},
        "BTN_SELECT": {"type": "take"},
        "BTN_NORTH": {"type": "text", "text": "wave with the right hand"},
        "BTN_WEST": {"type": "text", "text": "bow"},
    }
