"""`STRENGTH`: the greatest torque of human joints."""

from __future__ import annotations

from collections.abc import Mapping

STRENGTH: Mapping[str, float] = {
    "lumbar": 5.0,
    "neck": 1.0,
    "hip": 5.0,
    "knee": 5.0,
    "ankle": 4.5,
    "shoulder": 2.0,
    "elbow": 1.5,
    "forearm": 0.3,
}
"""Greatest torque about each axis per body mass [N·m/kg].

Legs: peaks of sprinting, 4 to 5 at hip and knee, 4 at the ankle (Schache et al., Med. Sci. Sports Exerc. 43(7), 2011).
Trunk and arms: greatest isometric strength of strong adults, about 350 N·m at the lumbar joint, 70 N·m at the neck,
140 N·m at the shoulder, 100 N·m at the elbow, 20 N·m in pronation.
"""
