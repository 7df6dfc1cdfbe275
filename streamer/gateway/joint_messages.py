"""Messages about single joints: their torque, and restarts of their servos."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints, field_validator

from flexmotion.configs.problems import Wording
from flexmotion.streamer.gateway.message_base import MessageBase

Joint = Annotated[str, StringConstraints(pattern=r"^[\w./-]{1,64}$"), Wording("the name of a joint")]
"""Name of a joint: letters, digits and `_./-`, 64 at most."""

MOST_JOINTS, LONGEST_JOINTS = 32, 240
"""Joints of one message, and bytes of their names together: half of what an event of the loop holds."""


class JointsMessage(MessageBase):
    """The fields of a message about single joints.

    Attributes:
        joints: their names in the robot file.
    """

    joints: Annotated[tuple[Joint, ...], Field(min_length=1, max_length=MOST_JOINTS)]

    @field_validator("joints")
    @classmethod
    def _fit(cls, joints: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(joints)) < len(joints):
            raise ValueError("a joint is named twice")
        if len(",".join(joints).encode()) > LONGEST_JOINTS:
            raise ValueError(f"expected at most {LONGEST_JOINTS} bytes of names")
        return joints


class LimpMessage(JointsMessage):
    """Switch the torque of joints of arms and head off while the robot stands; it stands on until they are stiff."""

    type: Literal["limp"] = "limp"


class StiffMessage(JointsMessage):
    """Switch the torque of limp joints on where they are; they come back to the robot's pose slowly."""

    type: Literal["stiff"] = "stiff"


class RebootMessage(JointsMessage):
    """Restart servos, such as those in shutdown, while all torque is off; the answer comes when they are ready."""

    type: Literal["reboot"] = "reboot"
