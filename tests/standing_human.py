"""A human who stands, without recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexmotion.dataset.clips import Clip
from flexmotion.dataset.gestures.bases import ARMS, hanging
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS

FPS = 30.0


def standing(seconds: float, body: Body | None = None) -> Motion:
    """A human who stands on slightly bent legs and sways by a centimetre, arms hanging."""
    body = body or Body()
    frames = round(seconds * FPS)
    joints = np.zeros((frames, len(JOINTS)))
    joints[:, ARMS] = hanging("someone", body)
    bend = np.radians(5.0) + np.radians(0.8) * np.sin(2 * np.pi * 0.3 * np.arange(frames) / FPS)
    for side in "lr":
        joints[:, JOINTS.index(f"hip_flexion_{side}")] = bend
        joints[:, JOINTS.index(f"knee_flexion_{side}")] = 2 * bend
        joints[:, JOINTS.index(f"ankle_dorsiflexion_{side}")] = bend
    size = body.segments
    place = np.zeros((frames, 3))
    place[:, 2] = size.ankle_height + (size.thigh + size.shank) * np.cos(bend)
    place[:, 0] = (size.shank - size.thigh) * np.sin(bend)
    quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1))
    return Motion(FPS, place, quaternions, joints, body)


def clip(name: str, split: str = "train", collection: str = "ours") -> Clip:
    """A clip without a file."""
    return Clip(name, Path(f"{name}.bvh"), collection=collection, split=split)
