"""Motions for tests, and a writer of BVH files in several conventions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.body import Body
from flexmotion.human.human_model import human_model
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.importers.body_fit import BALL_HEIGHT
from flexmotion.importers.default_clip import default_clip

# From y up, z forward, x left to z up, x forward, y left.
FROM_Y_UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

MIXAMO = {
    "pelvis": "mixamorig:Hips",
    "torso": "mixamorig:Spine",
    "neck": "mixamorig:Neck",
    "head": "mixamorig:Head",
    "hip": "mixamorig:{}UpLeg",
    "knee": "mixamorig:{}Leg",
    "ankle": "mixamorig:{}Foot",
    "toe": "mixamorig:{}ToeBase",
    "shoulder": "mixamorig:{}Arm",
    "elbow": "mixamorig:{}ForeArm",
    "wrist": "mixamorig:{}Hand",
}


def standing(frames: int = 1, body: Body | None = None, fps: float = 30.0, **joints: float) -> Motion:
    """Upright stance with the given joint angles."""
    body = body or Body()
    angles = np.zeros((frames, len(JOINTS)))
    for name, angle in joints.items():
        angles[:, JOINTS.index(name)] = angle
    return Motion(
        fps=fps,
        root_position=np.tile([0.0, 0.0, body.standing_height], (frames, 1)),
        root_quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
        joints=angles,
        body=body,
    )


@pytest.fixture(scope="session")
def clip() -> Motion:
    return default_clip()


@pytest.fixture(scope="session")
def clip_kinematics(clip: Motion) -> HumanKinematics:
    return forward(clip)


@dataclass(frozen=True)
class Figure:
    """A tree of joints that stands with hanging arms, palms inward; the axes of every joint are those of the world."""

    names: list[str]
    parents: list[int]
    positions: np.ndarray
    rotations: np.ndarray
    offsets: np.ndarray


def figure(motion: Motion, names: dict[str, str]) -> Figure:
    """Joints of a motion with the names of an animation program; `{}` is the side."""
    tree: list[tuple[str, int, str, tuple[float, float, float]]] = [("pelvis", -1, "pelvis", (0, 0, 0))]
    size = motion.body.segments
    neck = (size.neck_forward, 0, size.neck_height)
    tree += [("torso", 0, "torso", (0, 0, 0)), ("neck", 1, "torso", neck), ("head", 2, "head", (0, 0, 0.1))]
    rise = BALL_HEIGHT * size.leg / 0.491 - size.ankle_height
    for word, side in (("Left", "l"), ("Right", "r")):
        at = len(tree)
        tree += [
            (f"hip {word}", 0, f"femur_{side}", (0, 0, 0)),
            (f"knee {word}", at, f"tibia_{side}", (0, 0, 0)),
            (f"ankle {word}", at + 1, f"talus_{side}", (0, 0, 0)),
            (f"toe {word}", at + 2, f"calcaneus_{side}", (size.ball, 0, rise)),
            (f"shoulder {word}", 1, f"humerus_{side}", (0, 0, 0)),
            (f"elbow {word}", at + 4, f"ulna_{side}", (0, 0, 0)),
            (f"wrist {word}", at + 5, f"hand_{side}", (0, 0, 0)),
        ]
    zero = standing(body=motion.body)
    moving, still = _bodies(motion, tree), _bodies(zero, tree)
    # The palms face forward at the zero of the model, inward at that of animation programs.
    for index, (part, *_) in enumerate(tree):
        if part.startswith("wrist"):
            quarter = np.pi / 2 if part.endswith("Left") else -np.pi / 2
            moving[1][:, index] = moving[1][:, index] @ Rotation.from_euler("z", quarter).as_matrix()
    parents = [parent for _, parent, _, _ in tree]
    offsets = np.array([still[0][0, i] - (still[0][0, p] if p >= 0 else 0) for i, p in enumerate(parents)])
    labels = [names[part.partition(" ")[0]].format(part.partition(" ")[2]) for part, *_ in tree]
    return Figure(labels, parents, *moving, offsets)


def _bodies(motion: Motion, tree: list[tuple[str, int, str, tuple[float, float, float]]]) -> tuple[np.ndarray, ...]:
    human = human_model(motion.body)
    data = mujoco.MjData(human.model)
    index = [human.body_index[body] for _, _, body, _ in tree]
    positions, rotations = np.empty((len(motion), len(tree), 3)), np.empty((len(motion), len(tree), 3, 3))
    for frame, qpos in enumerate(human.qpos(motion)):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(human.model, data)
        rotations[frame] = data.xmat[index].reshape(-1, 3, 3)
        positions[frame] = data.xpos[index] + np.einsum("jik,jk->ji", rotations[frame], [o for *_, o in tree])
    return positions, rotations


@pytest.fixture(scope="session")
def write_bvh() -> Callable[..., Path]:
    """Function that writes a motion as BVH: `(path, motion, up=, scale=, all_positions=, t_pose=, names=) -> path`."""

    def write(
        path: Path,
        motion: Motion,
        *,
        up: str = "y",
        scale: float = 100.0,
        all_positions: bool = False,
        leading: int = 0,
        names: dict[str, str] = MIXAMO,
    ) -> Path:
        shape = figure(motion, names)
        turn = FROM_Y_UP if up == "y" else np.eye(3)
        rotations = turn.T @ shape.rotations @ turn
        local = rotations.copy()
        for joint, parent in enumerate(shape.parents):
            if parent >= 0:
                local[:, joint] = rotations[:, parent].swapaxes(1, 2) @ rotations[:, joint]
        frames = len(motion)
        angles = Rotation.from_matrix(local.reshape(-1, 3, 3)).as_euler("YZX", degrees=True).reshape(frames, -1, 3)
        root = scale * shape.positions[:, 0] @ turn
        offsets = scale * shape.offsets @ turn
        lines = ["HIERARCHY", *_hierarchy(shape, offsets, 0, all_positions)]
        lines += ["MOTION", f"Frames: {frames + leading}", f"Frame Time: {1 / motion.fps:.7f}"]
        for frame in [None] * leading + list(range(frames)):
            row: list[float] = []
            for joint in _depth_first(shape.parents):
                if joint == 0:
                    row += list(root[frame or 0])
                elif all_positions:
                    row += list(offsets[joint])
                row += [0.0] * 3 if frame is None else list(angles[frame, joint])
            lines.append(" ".join(f"{value:.4f}" for value in row))
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


def _depth_first(parents: list[int], joint: int = 0) -> list[int]:
    children = [child for child, parent in enumerate(parents) if parent == joint]
    return [joint, *(below for child in children for below in _depth_first(parents, child))]


def _hierarchy(shape: Figure, offsets: np.ndarray, joint: int, all_positions: bool) -> list[str]:
    children = [child for child, parent in enumerate(shape.parents) if parent == joint]
    positions = "Xposition Yposition Zposition " if joint == 0 or all_positions else ""
    lines = [
        f"{'JOINT' if joint else 'ROOT'} {shape.names[joint]}",
        "{",
        "OFFSET " + " ".join(f"{value:.6f}" for value in (offsets[joint] if joint else np.zeros(3))),
        f"CHANNELS {6 if positions else 3} {positions}Yrotation Zrotation Xrotation",
    ]
    for child in children:
        lines += _hierarchy(shape, offsets, child, all_positions)
    return [*lines, *([] if children else ["End Site", "{", "OFFSET 0 0 0", "}"]), "}"]


@pytest.fixture(scope="session")
def make_standing() -> Callable[..., Motion]:
    """Function `(frames=, body=, fps=, joint=angle ...) -> Motion` in upright stance."""
    return standing
