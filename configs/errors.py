"""The exception tree that every room shares.

An error names what is wrong (file, field, joint, servo) and what would be valid, in one line: the command line
prints that line and exits with the class's `exit_code` (see `docs/architecture.md`, "Exit codes").
"""


class FlexMotionError(Exception):
    """Base of every error this project raises on purpose.

    Attributes:
        exit_code: what the command line exits with when the error reaches it.
    """

    exit_code = 2


class ConfigError(FlexMotionError):
    """A configuration, robot, servo or script file is missing, malformed or contradicts another."""


class MotionFormatError(FlexMotionError):
    """A motion file cannot be read as motion of a human."""


class RetargetError(FlexMotionError):
    """A motion cannot be mapped onto the robot at all (not: it is hard to follow)."""


class DriverError(FlexMotionError):
    """The hardware, its bus or its driver failed."""

    exit_code = 3
