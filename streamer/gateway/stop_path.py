"""What clients and the processes of a run agree on about stops over HTTP."""

from __future__ import annotations

STOPS = "/stops"
"""Path at which gateway and stop process tell the port for stops, without the token."""
SOURCE_HEADER = "FlexMotion-Source"
"""Header with the name of the program that presses a stop, percent-encoded."""
