"""Surface markers and joint centres on a moving human, and TRC files of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from flexmotion.biomechanics.segment_motion import segment_motion
from flexmotion.human.human_model import human_model
from flexmotion.human.motion import Motion

Tracks = dict[str, np.ndarray]

# The mean pelvis of the regression, in millimetres, its spines tilted down by 10°: depth 150, width 240.
TILT = np.radians(10)
HIP_FROM_SPINES = np.array([-0.24 * 150 - 9.9, 0.0, -0.30 * 240 - 10.9]) / 1e3
SKIN = 0.017


def joint_centres(motion: Motion) -> Tracks:
    """Joint centres by the names of most laboratories, (T, 3) [m], z up."""
    human, segments = human_model(motion.body), segment_motion(motion)

    def at(body: str, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
        index = human.body_index[body]
        return segments.position[:, index] + segments.rotation[:, index] @ np.array(offset)

    points = {"Spine": at("torso"), "Neck": at("head")}
    for side, name in (("l", "Left"), ("r", "Right")):
        points |= {
            f"{name}Hip": at(f"femur_{side}"),
            f"{name}Knee": at(f"tibia_{side}"),
            f"{name}Ankle": at(f"talus_{side}"),
            f"{name}Toe": at(f"toes_{side}", (0.0, 0.0, 0.02)),
            f"{name}Shoulder": at(f"humerus_{side}"),
            f"{name}Elbow": at(f"ulna_{side}"),
            f"{name}Wrist": at(f"hand_{side}"),
        }
    return points


def surface_markers(motion: Motion) -> dict[str, Tracks]:
    """Markers of two sets, `plug_in_gait` and `gait2354`, on the skin of a motion's human, (T, 3) [m], z up."""
    human, segments = human_model(motion.body), segment_motion(motion)

    def at(body: str, *offset: float) -> np.ndarray:
        index = human.body_index[body]
        return segments.position[:, index] + segments.rotation[:, index] @ np.array(offset)

    tilt = np.array([[np.cos(TILT), 0, np.sin(TILT)], [0, 1, 0], [-np.sin(TILT), 0, np.cos(TILT)]])

    def pelvis(x: float, y: float) -> np.ndarray:
        return at("pelvis", *(tilt @ (np.array([x, y, 0.0]) - HIP_FROM_SPINES)))

    front, back = SKIN, -0.150 - SKIN
    gait = {"CLAV": at("torso", 0.09, 0.0, 0.33), "C7": at("torso", -0.06, 0.0, 0.42)}
    gait |= {"STRN": at("torso", 0.12, 0.0, 0.2), "T10": at("torso", -0.1, 0.0, 0.2)}
    clusters = {"V.Sacral": pelvis(back, 0.0), "Sternum": gait["STRN"], "Top.Head": at("head", 0.0, 0.0, 0.24)}
    for side, out in (("l", 1.0), ("r", -1.0)):
        s = side.upper()
        asis, psis = pelvis(front, 0.12 * out), pelvis(back, 0.045 * out)
        heel, fifth = at(f"calcaneus_{side}", -0.06, 0.0, -0.03), at(f"toes_{side}", 0.0, 0.045 * out, 0.02)
        first, shoulder = at(f"toes_{side}", 0.0, -0.045 * out, 0.02), at(f"humerus_{side}", 0.0, 0.01 * out, 0.045)
        elbow, wrist = at(f"ulna_{side}", 0.0, 0.04 * out, 0.0), at(f"hand_{side}", 0.03, 0.0, 0.0)
        other, head = at(f"hand_{side}", -0.03, 0.0, 0.0), at("head", 0.08, 0.07 * out, 0.12)
        gait |= {
            f"{s}ASI": asis,
            f"{s}PSI": psis,
            f"{s}THI": at(f"femur_{side}", 0.02, 0.09 * out, -0.2),
            f"{s}KNE": at(f"tibia_{side}", 0.0, 0.059 * out, 0.0),
            f"{s}TIB": at(f"tibia_{side}", 0.02, 0.06 * out, -0.2),
            f"{s}ANK": at(
                f"tibia_{side}",
                -0.044 * np.sin(np.radians(20)),
                0.044 * out * np.cos(np.radians(20)),
                -motion.body.segments.shank,
            ),
            f"{s}HEE": heel,
            f"{s}TOE": at(f"toes_{side}", 0.0, 0.0, 0.04),
            f"{s}SHO": shoulder,
            f"{s}ELB": elbow,
            f"{s}WRA": wrist,
            f"{s}WRB": other,
            f"{s}FHD": head,
            f"{s}BHD": at("head", -0.08, 0.07 * out, 0.12),
        }
        clusters |= {
            f"{s}.ASIS": asis,
            f"{s}.Thigh.Upper": at(f"femur_{side}", 0.02, 0.09 * out, -0.15),
            f"{s}.Thigh.Front": at(f"femur_{side}", 0.08, 0.04 * out, -0.2),
            f"{s}.Thigh.Rear": at(f"femur_{side}", -0.02, 0.08 * out, -0.28),
            f"{s}.Shank.Upper": at(f"tibia_{side}", 0.01, 0.06 * out, -0.1),
            f"{s}.Shank.Front": at(f"tibia_{side}", 0.05, 0.02 * out, -0.15),
            f"{s}.Shank.Rear": at(f"tibia_{side}", -0.03, 0.05 * out, -0.2),
            f"{s}.Heel": heel,
            f"{s}.Midfoot.Sup": at(f"calcaneus_{side}", 0.06, 0.0, 0.0),
            f"{s}.Midfoot.Lat": at(f"calcaneus_{side}", 0.05, 0.04 * out, -0.03),
            f"{s}.Toe.Lat": fifth,
            f"{s}.Toe.Med": first,
            f"{s}.Acromium": shoulder,
            f"{s}.Elbow": elbow,
            f"{s}.Wrist.Med": other,
            f"{s}.Wrist.Lat": wrist,
            f"{s}.Temple": head,
        }
    return {"plug_in_gait": gait, "gait2354": clusters}


def write_trc(
    path: Path,
    tracks: Mapping[str, np.ndarray],
    *,
    fps: float = 30.0,
    units: str = "mm",
    per_metre: float = 1000.0,
    up: str = "y",
    missing: str = "",
    end: str = "\n",
    trailing: str = "",
) -> Path:
    """A TRC file of positions (T, 3) [m], z up; NaN becomes `missing`."""
    names, count = list(tracks), len(next(iter(tracks.values())))
    table = per_metre * np.stack(list(tracks.values()), axis=1)
    if up == "y":
        table = table[..., [1, 2, 0]]
    lines = [f"PathFileType\t4\t(X/Y/Z)\t{path.name}"]
    lines += ["DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames"]
    lines += [f"{fps}\t{fps}\t{count}\t{len(names)}\t{units}\t{fps}\t1\t{count}"]
    lines += ["Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t"]
    lines += ["\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, len(names) + 1)), ""]
    for frame in range(count):
        row = [f"{value:.5f}" if np.isfinite(value) else missing for value in table[frame].ravel()]
        lines.append("\t".join([str(frame + 1), f"{frame / fps:.4f}", *row]) + trailing)
    path.write_bytes((end.join(lines) + end).encode())
    return path
