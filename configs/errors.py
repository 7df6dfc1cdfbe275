"""The exceptions of all packages.

A message names in one line what is wrong (file, field, joint, servo) and what would be valid. The command line prints
it and exits with the class's `exit_code` (see `docs/architecture.md`, "Exit codes").
"""


class FlexMotionError(Exception):
    """Base of all errors that this project raises on purpose.

    Attributes:
        exit_code: exit code of the command line for this error.
    """

    exit_code = 2


class ConfigError(FlexMotionError):
    """A configuration, robot, servo or script file is missing, malformed or contradicts another."""


class MotionFormatError(FlexMotionError):
    """A motion file does not contain readable human motion."""


class SamplingError(FlexMotionError, ValueError):
    """A motion model is asked for what cannot be sampled: a condition, a constraint, a history or a seed.

    It is a `ValueError` as well, which is what these raised before.
    """


class RetargetError(FlexMotionError):
    """A motion cannot be mapped onto the robot at all."""


class SessionError(FlexMotionError):
    """A run is used in a way that it does not allow: stepped before its begin, say, or sent a target after its end."""


class DriverError(FlexMotionError):
    """The hardware, a bus or a driver failed."""

    exit_code = 3


class GatewayError(FlexMotionError):
    """A run that listens for targets cannot be reached, refuses the connection or does not answer."""

    exit_code = 3


class FrameError(FlexMotionError):
    """A datagram is no frame of a person."""


class FilmError(FlexMotionError):
    """A film cannot be written."""
