"""Angles in messages: in radians, as files and messages have them, and in degrees, as commands do."""

from __future__ import annotations

from math import degrees


def told_angle(angle: float) -> str:
    """An angle [rad] as text: "0.7854 rad (45°)"."""
    return f"{angle:.4g} rad ({degrees(angle):.4g}°)"


def told_range(least: float, most: float) -> str:
    """A range of angles [rad] as text: "-2.2 to 0 rad (-126.1° to 0°)"."""
    return f"{least:.4g} to {most:.4g} rad ({degrees(least):.4g}° to {degrees(most):.4g}°)"
