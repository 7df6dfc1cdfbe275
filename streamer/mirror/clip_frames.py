"""A clip as the datagrams of a sender of live motion, for examples, tests and benchmarks."""

from __future__ import annotations

import json

import numpy as np

from flexmotion.configs.errors import ConfigError
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.streamer.mirror.named_joints import LANDMARKS

_SIDED = ("hip", "knee", "ankle", "toe", "shoulder", "elbow", "wrist")
_OF_LANDMARKS = {"heel": "heel", "foot_index": "toe", **{name: name for name in _SIDED if name != "toe"}}
PROTOCOLS = ("joints", "mediapipe")


def clip_frames(motion: Motion, protocol: str = "joints") -> list[tuple[float, bytes]]:
    """Time [s] and datagram of every frame of a clip.

    Args:
        protocol: "joints", or "mediapipe": hips at the origin, and what a camera does not see of the face is a guess.

    Raises:
        ConfigError: another protocol.
    """
    if protocol not in PROTOCOLS:
        raise ConfigError(f"protocol: {protocol!r}, expected one of: {', '.join(PROTOCOLS)}")
    human = forward(motion)
    encode = _joints if protocol == "joints" else _landmarks
    times = np.arange(len(motion)) / motion.fps
    return [(float(time_s), json.dumps(encode(human, frame, time_s)).encode()) for frame, time_s in enumerate(times)]


def _joints(human: HumanKinematics, frame: int, time_s: float) -> dict[str, object]:
    middle = 0.5 * (human.shoulder[frame, 0] + human.shoulder[frame, 1])
    joints = {"neck": middle, "head": human.vertex[frame]}
    for name in _SIDED:
        joints |= {f"{side}_{name}": getattr(human, name)[frame, at] for at, side in enumerate(("left", "right"))}
    rounded = {name: [round(float(value), 5) for value in place] for name, place in joints.items()}
    return {"t": float(time_s), "up": "z", "units": "m", "joints": rounded}


def _landmarks(human: HumanKinematics, frame: int, time_s: float) -> dict[str, object]:
    head = human.vertex[frame] - 0.1 * human.head_rotation[frame, :, 2]
    ears = {"left_ear": 0.07, "right_ear": -0.07}
    places = {name: head + side * human.head_rotation[frame, :, 1] for name, side in ears.items()}
    for name, field in _OF_LANDMARKS.items():
        places |= {f"{side}_{name}": getattr(human, field)[frame, at] for at, side in enumerate(("left", "right"))}
    # Of a person who faces the camera: x to the left of the person, y down, z backwards.
    turn = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    rows = (turn @ (places.get(name, head) - human.pelvis_position[frame]) for name in LANDMARKS)
    return {"t": float(time_s), "landmarks": [[*(round(float(value), 5) for value in row), 0.99] for row in rows]}
