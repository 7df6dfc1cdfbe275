"""`advice`, `headline`: what happened and what to do about it, for the person in front of the page."""

from __future__ import annotations

import re

_ADVICE = (
    (
        r"FAULT: e-stop",
        "The torque is off. If the robot has tipped over, put it into its rest pose by hand. See that nobody is in its "
        "way, clear the fault, then arm the robot: it stands up.",
    ),
    (
        r"e-stop",
        "The robot stops, lowers itself, and its torque goes off. If it tips over then, put it into its rest pose by "
        "hand. See that nobody is in its way, clear the fault, then arm the robot: it stands up.",
    ),
    (r"kill", "The torque was cut. Put the robot into its rest pose by hand, clear the fault, then arm the robot."),
    (
        r"get up: ",
        "It could not get up, and gave way. Look what was in its way; let it try again, or put it into its rest pose "
        "by hand, clear the fault and arm it.",
    ),
    (
        r"\bfall\b",
        "Switch the supply off before you touch it. Put it up, look for damage, clear the fault, arm it. Or, where "
        "nobody is within its reach, let it get up: `flexmotion clear --get-up`.",
    ),
    (r"bus lost", "Check the servos' cable and supply; `flexmotion check bus` finds the rest."),
    (r"does not answer", "Check this servo's plug and the cable to it: `flexmotion servo scan`."),
    (r"hardware error", "The servo was too hot or overloaded: let it cool, then `flexmotion servo reboot`."),
    (r"shuts down at", "The servo is hot. Let the robot rest in its parked pose until it has cooled down."),
    (r"supply at", "The supply is low: charge or change the battery, then start the run again."),
    (r"gyro's bias", "Let the robot stand still on its feet for a second while it starts."),
    (r"\bIMU\b", "The IMU is silent: check its cable. Without it falls are not noticed; keep a hand at the robot."),
    (r"robot lies", "Put the robot into its rest pose by hand, then arm it; or let it get up, if it can."),
    (r"waits to be armed", "See that nobody is in its way, then arm the robot: it stands up."),
    (r"no start", "The robot did not start; the message says what to mend. Nothing has moved."),
    (r"time limit", "The run was ended by its --seconds."),
    (r"planner", "The planner hangs or has ended. The robot stands by itself; start the run again."),
    (r"^stops over", "The robot cannot be stopped this way now. Keep another at hand: this page, `flexmotion stop`."),
    (r"^targets over", "No targets come this way now; it is started again by itself. The message says what to mend."),
    (r"feet are in the air", "The robot hangs: balance is off until its feet bear it."),
)  # fmt: skip


_BUS_LOST, _TOO_BUSY = re.compile(r"bus lost"), re.compile(r"the loop itself woke")
_BUSY = (
    "This computer was too busy to read the servos in time. Close other programs. If it comes back, check the cable."
)
_BUSY_SIMULATION = (
    "This computer was too busy to simulate the robot in real time. Close other programs, or switch off the "
    "planned pose and the human in the picture."
)

_HEADLINES = (
    (r"e-stop", "Emergency stop pressed"),
    (r"kill", "Torque cut"),
    (r"\bfall\b", "The robot fell"),
    (r"bus lost", "The servos do not answer"),
)
_HEADLINES_OF_SIMULATION = ((r"bus lost", "The simulation fell behind"),)


def advice(message: str, *, simulated: bool = False) -> str | None:
    """What to do about the message of a fault, a warning or a note; None: nothing is known, or needed.

    Args:
        simulated: the robot is; no cable of it can be loose.
    """
    busy = _TOO_BUSY.search(message) is not None
    if busy or (simulated and _BUS_LOST.search(message)):
        return _BUSY_SIMULATION if simulated else _BUSY
    return next((text for pattern, text in _ADVICE if re.search(pattern, message)), None)


def headline(message: str, *, simulated: bool = False) -> str | None:
    """What happened, in a few words; None: the message itself says it."""
    known = (*_HEADLINES_OF_SIMULATION, *_HEADLINES) if simulated else _HEADLINES
    return next((text for pattern, text in known if re.search(pattern, message)), None)
