"""Every format but BVH (`test_bvh`), on files made in that format: fidelity and faults."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import MotionFormatError
from flexmotion.dataset.captions import read_captions
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.importers import load, read
from flexmotion.importers.smpl import NAMES

TO_Y_UP = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def joints22(motion: Motion, human: HumanKinematics) -> np.ndarray:
    """The 22 joints of a motion, y up [m]."""
    size = motion.body.segments
    ball = human.toe + np.einsum("tsij,j->tsi", human.foot_rotation, [0.0, 0.0, 0.03])
    neck = human.vertex - size.head * human.head_rotation[:, :, 2]
    lumbar = neck - size.neck_height * human.torso_rotation[:, :, 2]
    points = {"pelvis": human.pelvis_position, "spine1": lumbar, "neck": neck, "head": 0.7 * neck + 0.3 * human.vertex}
    points |= {"spine2": lumbar, "spine3": lumbar, "left_collar": neck, "right_collar": neck}
    for side, name in enumerate(("left", "right")):
        points |= {
            f"{name}_{point}": getattr(human, point)[:, side]
            for point in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
        }
        points[f"{name}_foot"] = ball[:, side]
    return np.stack([points[name] for name in NAMES], axis=1) @ TO_Y_UP.T


@pytest.fixture(scope="module")
def positions(clip: Motion, clip_kinematics: HumanKinematics) -> np.ndarray:
    return joints22(clip, clip_kinematics)


def same_limbs(motion: Motion, human: HumanKinematics, tolerance: float) -> None:
    found = forward(motion)
    count = min(len(found), len(human))
    for point in ("knee", "ankle", "elbow", "wrist"):
        mine, theirs = getattr(found, point)[:count], getattr(human, point)[:count]
        distance = (mine - found.pelvis_position[:count, None]) - (theirs - human.pelvis_position[:count, None])
        assert np.linalg.norm(distance, axis=-1).max() < tolerance, point


def test_humanml3d(tmp_path: Path, positions: np.ndarray, clip_kinematics: HumanKinematics) -> None:
    path = tmp_path / "000001.npy"
    np.save(path, positions.astype(np.float32))
    found = read(path, fps=None)
    assert found.motion.fps == 20.0
    assert found.mapping == "smpl22"
    same_limbs(found.motion, clip_kinematics, 0.03)
    assert len(load(path, fps=30.0)) == pytest.approx(1.5 * len(positions), abs=2)


def test_packed(tmp_path: Path, positions: np.ndarray, clip_kinematics: HumanKinematics) -> None:
    path = tmp_path / "packed.npz"
    np.savez(path, **{"01_01": np.round(1000 * positions).astype(np.int16), "01_02": np.zeros((9, 22, 3), np.int16)})
    same_limbs(load(path, clip="01_01"), clip_kinematics, 0.03)
    with pytest.raises(MotionFormatError, match=r"name one of its 2 clips \(01_01, 01_02"):
        load(path)
    with pytest.raises(MotionFormatError, match="no clip '77_01' among"):
        load(path, clip="77_01")


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((5, 263)), "feature vectors; give the joints"),
        (np.zeros((5, 24, 3)), r"shape \(5, 24, 3\), expected \(frames, 22, 3\)"),
        (np.zeros((0, 22, 3)), "no frames"),
        (np.full((5, 22, 3), np.nan), "joint 'pelvis' is not finite in frame 0"),
        (np.full((5, 22, 3), "x"), "expected numbers"),
        (np.zeros((5, 22, 3)), "no length"),
    ],
)
def test_bad_humanml3d(tmp_path: Path, array: np.ndarray, message: str) -> None:
    np.save(tmp_path / "bad.npy", array)
    with pytest.raises(MotionFormatError, match=message):
        load(tmp_path / "bad.npy")


def amass(frames: int = 40, **changes: object) -> dict[str, object]:
    """A walker without a walk: T pose facing x in a z-up world, whose right knee bends to 1 rad."""
    poses = np.zeros((frames, 156))
    poses[:, :3] = [2 * np.pi / 3 / np.sqrt(3)] * 3  # y up to z up: a third of a turn about (1, 1, 1)
    poses[:, 3 * NAMES.index("right_knee")] = np.linspace(0.0, 1.0, frames)
    trans = np.zeros((frames, 3))
    trans[:, 2] = 0.9
    content: dict[str, object] = {"poses": poses, "trans": trans, "mocap_framerate": 60.0, "gender": "female"}
    return content | changes


def test_amass(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", **amass(betas=np.ones(16)))
    with pytest.warns(UserWarning, match="betas"):
        motion = load(tmp_path / "a.npz", fps=None)
    assert motion.fps == 60.0
    knee = motion.joints[:, JOINTS.index("knee_flexion_r")]
    # A first frame with every rotation at zero is not motion and is dropped.
    assert knee == pytest.approx(np.linspace(0.0, 1.0, 40)[-len(knee) :], abs=0.03)
    assert len(motion) >= 39
    assert np.abs(motion.joints[:, JOINTS.index("hip_flexion_l")]).max() < 0.03
    # Arms raised sideways.
    assert motion.joints[:, JOINTS.index("shoulder_adduction_l")] == pytest.approx(
        np.full(len(motion), -np.pi / 2), abs=0.1
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"poses": np.zeros((40, 30))}, r"poses have shape \(40, 30\)"),
        ({"trans": np.zeros((7, 3))}, "trans has shape"),
        ({"mocap_framerate": 0.0}, "not finite"),
        ({"trans": np.full((40, 3), np.nan)}, "not finite"),
    ],
)
def test_bad_amass(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    np.savez(tmp_path / "a.npz", **amass(**changes))
    with pytest.raises(MotionFormatError, match=message):
        load(tmp_path / "a.npz")


def bone(name: str, direction: str, length: float, dof: str = "rx ry rz", axis: str = "0 0 0") -> str:
    return (
        f"begin\n id 1\n name {name}\n direction {direction}\n length {length}\n axis {axis} XYZ\n"
        + (f" dof {dof}\n limits (-180 180)\n" if dof else "")
        + "end\n"
    )


@pytest.fixture
def acclaim(tmp_path: Path) -> Path:
    """A figure in Acclaim's units whose left knee bends to 57°, its axis turned about so that the axis matters."""
    bones = [bone("lowerback", "0 1 0", 2.0), bone("upperback", "0 1 0", 2.0), bone("thorax", "0 1 0", 2.0)]
    bones += [bone("lowerneck", "0 1 0", 1.0), bone("head", "0 1 0", 3.0)]
    hierarchy = ["root lowerback lhipjoint rhipjoint", "lowerback upperback", "upperback thorax", "lowerneck head"]
    hierarchy.append("thorax lowerneck lclavicle rclavicle")
    for side, out in (("l", "1 0 0"), ("r", "-1 0 0")):
        bones += [bone(f"{side}hipjoint", out, 1.5, ""), bone(f"{side}femur", "0 -1 0", 7.2)]
        # Turned by 90° about z, the knee's own x is the world's y, and its y the world's -x.
        bones += [bone(f"{side}tibia", "0 -1 0", 7.3, "ry", "0 0 90"), bone(f"{side}foot", "0 -0.6 0.8", 2.2)]
        bones += [
            bone(f"{side}toes", "0 0 1", 1.0),
            bone(f"{side}clavicle", out, 3.0),
            bone(f"{side}humerus", out, 5.0),
        ]
        bones += [bone(f"{side}radius", out, 3.0), bone(f"{side}wrist", out, 1.5), bone(f"{side}hand", out, 1.0)]
        hierarchy.append(" ".join(f"{side}{name}" for name in ("hipjoint", "femur")))
        chain = ("femur", "tibia", "foot", "toes")
        hierarchy += [f"{side}{a} {side}{b}" for a, b in zip(chain, chain[1:], strict=False)]
        chain = ("clavicle", "humerus", "radius", "wrist", "hand")
        hierarchy += [f"{side}{a} {side}{b}" for a, b in zip(chain, chain[1:], strict=False)]
    (tmp_path / "07.asf").write_text(
        "# a comment\n:version 1.10\n:units\n mass 1.0\n length 0.45\n angle deg\n:root\n order TX TY TZ RX RY RZ\n"
        " axis XYZ\n position 0 0 0\n orientation 0 0 0\n:bonedata\n"
        + "".join(bones)
        + ":hierarchy\nbegin\n"
        + "\n".join(hierarchy)
        + "\nend\n"
    )
    lines = [":FULLY-SPECIFIED", ":DEGREES"]
    for frame in range(60):
        lines += [str(frame + 1), f"root 0 17 {0.05 * frame} 0 0 0", f"ltibia {-frame - 0.0:.3f}"]
    path = tmp_path / "07_01.amc"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_acclaim(acclaim: Path) -> None:
    found = read(acclaim, fps=None)
    assert found.mapping == "acclaim"
    motion = found.motion
    assert motion.fps == 120.0
    assert motion.body.segments.thigh == pytest.approx(7.2 / 0.45 * 0.0254, rel=1e-6)
    # y of an axis frame turned by 90° is -x of the world: negative values bend the knee.
    assert np.degrees(motion.joints[-1, JOINTS.index("knee_flexion_l")]) == pytest.approx(59, abs=0.5)
    assert motion.joints[:, JOINTS.index("knee_flexion_r")] == pytest.approx(np.zeros(len(motion)), abs=0.02)
    assert motion.root_position[-1, 0] == pytest.approx(0.05 * 58 / 0.45 * 0.0254, abs=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ltibia -3.000", "ltibia", "0 values for 'ltibia', expected 1"),
        ("ltibia -3.000", "tail 4", "bone 'tail' is not in the skeleton"),
        ("ltibia -3.000\n", "", "no values for 'ltibia'"),
        ("ltibia -3.000", "ltibia x", "expected numbers"),
        (":DEGREES\n1\n", ":DEGREES\n", "before the first frame"),
    ],
)
def test_bad_acclaim(acclaim: Path, old: str, new: str, message: str) -> None:
    text = acclaim.read_text()
    assert old in text
    acclaim.write_text(text.replace(old, new, 1))
    with pytest.raises(MotionFormatError, match=message):
        load(acclaim)


def test_acclaim_without_skeleton(acclaim: Path) -> None:
    acclaim.with_name("07.asf").unlink()
    with pytest.raises(MotionFormatError, match=r"no skeleton beside it, expected 07_01\.asf or 07\.asf"):
        load(acclaim)


def write_trc(path: Path, names: list[str], positions: np.ndarray, fps: float = 100.0, units: str = "mm") -> None:
    """A TRC file; NaN becomes an empty field."""
    frames, count = positions.shape[:2]
    lines = [f"PathFileType\t4\t(X/Y/Z)\t{path.name}"]
    lines += ["DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames"]
    lines += [f"{fps}\t{fps}\t{frames}\t{count}\t{units}\t{fps}\t1\t{frames}"]
    lines += ["Frame#\tTime\t" + "\t\t\t".join(names), "\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(count))]
    for frame in range(frames):
        row = [f"{1000 * v:.3f}" if np.isfinite(v) else "" for v in positions[frame].ravel()]
        lines.append("\t".join([str(frame + 1), f"{frame / fps:.4f}", *row]))
    path.write_text("\n".join(lines) + "\n")


def test_trc(tmp_path: Path, positions: np.ndarray, clip_kinematics: HumanKinematics) -> None:
    gappy = positions.copy()
    gappy[50:54, NAMES.index("left_wrist")] = np.nan
    write_trc(tmp_path / "a.trc", list(NAMES), gappy, fps=30.0)
    motion = load(tmp_path / "a.trc")
    assert motion.fps == 30.0
    same_limbs(motion, clip_kinematics, 0.03)


def test_trc_markers_become_joints(tmp_path: Path, positions: np.ndarray, clip_kinematics: HumanKinematics) -> None:
    at = NAMES.index("left_knee")
    aside = np.array([0.05, 0.0, 0.0])
    names = [*NAMES[:at], "LKneeLat", *NAMES[at + 1 :], "LKneeMed"]
    markers = np.concatenate([positions, positions[:, at : at + 1] - aside], axis=1)
    markers[:, at] += aside
    write_trc(tmp_path / "a.trc", names, markers, fps=30.0)
    mapping = Path(__file__).parents[3] / "configs" / "skeletons" / "smpl22.yaml"
    (tmp_path / "m.yaml").write_text(mapping.read_text().replace("left_knee", "LKneeLat + LKneeMed"))
    same_limbs(load(tmp_path / "a.trc", mapping=tmp_path / "m.yaml"), clip_kinematics, 0.03)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("PathFileType", "Path", "does not begin with PathFileType"),
        ("\tmm\t", "\tparsec\t", "missing or invalid"),
        ("NumFrames", "Frames", "missing or invalid"),
    ],
)
def test_bad_trc(tmp_path: Path, positions: np.ndarray, old: str, new: str, message: str) -> None:
    path = tmp_path / "a.trc"
    write_trc(path, list(NAMES), positions[:20])
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(MotionFormatError, match=message):
        load(path)


def test_trc_with_a_long_gap(tmp_path: Path, positions: np.ndarray) -> None:
    gappy = positions.copy()
    gappy[100:250, NAMES.index("left_ankle")] = np.nan
    write_trc(tmp_path / "a.trc", list(NAMES), gappy)
    with pytest.raises(MotionFormatError, match=r"'left_ankle' is missing for 1\.50 s from 1\.00 s on"):
        load(tmp_path / "a.trc")


def test_captions(tmp_path: Path) -> None:
    path = tmp_path / "captions.csv"
    path.write_text('trial,start_s,end_s,caption,source\n01_01,0,2.5,"hops, turns",me\n01_01,2.5,3,waves,me\n')
    first, second = read_captions(path)["01_01"]
    assert (first.start, first.end, first.text) == (0.0, 2.5, "hops, turns")
    assert second.text == "waves"
    path.write_text("trial,start_s,end_s,caption,source\n01_01,3,2,a,b\n")
    with pytest.raises(MotionFormatError, match="line 2: from"):
        read_captions(path)
