"""Which joint is which."""

from __future__ import annotations

import re

import pytest
import yaml

from flexmotion.configs.errors import ConfigError, MotionFormatError
from flexmotion.importers.mapping import REQUIRED_POINTS, find_mapping, guess_mapping, shipped_mappings

MIXAMO = """Hips Spine Spine1 Neck Head LeftShoulder LeftArm LeftForeArm LeftHand LeftHandThumb1 RightShoulder RightArm
RightForeArm RightHand LeftUpLeg LeftLeg LeftFoot LeftToeBase RightUpLeg RightLeg RightFoot RightToeBase"""
ACCLAIM = """Hips LeftHip LeftKnee LeftAnkle LeftAnkle/end RightHip RightKnee RightAnkle RightAnkle/end Chest LeftCollar
LeftShoulder LeftElbow LeftWrist RightCollar RightShoulder RightElbow RightWrist Neck Head"""
BLENDER = """hips spine neck head upper_arm.L forearm.L hand.L upper_arm.R forearm.R hand.R thigh.L shin.L foot.L toe.L
thigh.R shin.R foot.R toe.R"""
BIPED = """Bip01 Bip01_Spine Bip01_Neck Bip01_Head Bip01_L_Clavicle Bip01_L_UpperArm Bip01_L_Forearm Bip01_L_Hand
Bip01_R_Clavicle Bip01_R_UpperArm Bip01_R_Forearm Bip01_R_Hand Bip01_L_Thigh Bip01_L_Calf Bip01_L_Foot Bip01_L_Toe0
Bip01_R_Thigh Bip01_R_Calf Bip01_R_Foot Bip01_R_Toe0"""


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (MIXAMO, {"hip_l": "LeftUpLeg", "knee_r": "RightLeg", "shoulder_l": "LeftArm", "toe_r": "RightToeBase"}),
        (
            ACCLAIM,
            {"hip_l": "LeftHip", "shoulder_r": "RightShoulder", "toe_l": "LeftAnkle/end", "wrist_l": "LeftWrist"},
        ),
        (BLENDER, {"hip_r": "thigh.R", "shoulder_l": "upper_arm.L", "ankle_l": "foot.L", "lumbar": "spine"}),
        (BIPED, {"hip_l": "Bip01_L_Thigh", "toe_l": "Bip01_L_Toe0", "elbow_r": "Bip01_R_Forearm"}),
    ],
)
def test_guess(names, expected):
    mapping = guess_mapping(tuple(names.split()), "clip.bvh")
    assert expected.items() <= mapping.joints.items()
    assert set(REQUIRED_POINTS) <= set(mapping.joints)


def test_missing_legs_are_reported():
    names = tuple(name for name in MIXAMO.split() if "Leg" not in name and "Foot" not in name and "Toe" not in name)
    with pytest.raises(MotionFormatError, match=r"clip\.bvh: no legs found: .*hip_l, knee_l.*joints are Hips, Spine"):
        guess_mapping(names, "clip.bvh")


def test_unmapped_joints_are_listed():
    names = tuple(MIXAMO.replace("LeftFoot ", "Paw ").split())
    with pytest.raises(MotionFormatError, match=r"ankle_l \(names such as LeftAnkle\); joints are .*Paw"):
        guess_mapping(names, "clip.bvh")


def test_arms_may_be_missing():
    """Files of the lower body were refused."""
    names = tuple(name for name in MIXAMO.split() if "Arm" not in name and "Hand" not in name)
    assert not {"elbow_l", "wrist_r"} & guess_mapping(names, "clip.bvh").joints.keys()


def test_shipped_ones_are_found_by_their_joints():
    for name, mapping in shipped_mappings().items():
        names = (*mapping.joints.values(), *(item.joint for item in mapping.orientations.values()))
        names += tuple(re.split(r" \| |, | \+ ", " | ".join(mapping.markers.values())))
        assert find_mapping(names, "clip.bvh").name == name
    assert {"cmu", "bandai", "plug_in_gait"} <= set(shipped_mappings())


def test_a_shipped_one_does_not_take_the_arms_from_a_skeleton_with_other_names():
    """Only the legs of a mapping are required, and skeletons share the names of legs."""
    mapping = shipped_mappings()["bandai"]
    joints = {**mapping.joints, "elbow_l": "Forearm_L", "elbow_r": "Forearm_R"}
    found = find_mapping((*joints.values(), *(item.joint for item in mapping.orientations.values())), "clip.bvh")
    assert found.joints["elbow_l"] == "Forearm_L"


def test_names_of_markers_are_compared_without_case_and_separators():
    mapping = shipped_mappings()["gait2354"]
    found = mapping.landmarks(["r_asis", "L ASIS", "L.Thigh.Rear", "LTHIGHFRONT", "R.Heel"])
    assert found["asis_r"] == [["r_asis"]]
    assert found["thigh_l"] == [["LTHIGHFRONT"], ["L.Thigh.Rear"]]
    assert "heel_l" not in found


def test_joints_or_markers(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("name: mine\n")
    with pytest.raises(ConfigError, match="expected either 'joints' or 'markers'"):
        find_mapping(("LASI",), "a.trc", path)
    path.write_text("name: mine\nmarkers: {nose: A}\n")
    with pytest.raises(ConfigError, match="unknown landmark 'nose', expected one of sacrum, c7"):
        find_mapping(("LASI",), "a.trc", path)


def test_a_mapping_that_does_not_fit():
    with pytest.raises(MotionFormatError, match="mapping 'cmu' needs joints that the file lacks: chest"):
        find_mapping(tuple(MIXAMO.split()), "clip.bvh", "cmu")


def test_unknown_mapping():
    with pytest.raises(
        ConfigError, match="'vicon': expected acclaim, bandai, cmu, .*plug_in_gait, .*, vmc or the path of a YAML file"
    ):
        find_mapping(tuple(MIXAMO.split()), "clip.bvh", "vicon")


def test_a_mapping_of_a_user(tmp_path):
    mapping = guess_mapping(tuple(MIXAMO.split()), "clip.bvh")
    path = tmp_path / "mine.yaml"
    content = {
        "name": "mine",
        "joints": mapping.joints,
        "orientations": {"chest": {"joint": "Spine1", "forward": "+z", "up": "+y"}},
    }
    path.write_text(yaml.safe_dump(content))
    found = find_mapping(tuple(MIXAMO.split()), "clip.bvh", path)
    assert found.name == "mine"
    assert found.orientations["chest"].matrix()[:, 1] == pytest.approx([1, 0, 0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joints": {"hip_l": "a"}}, "missing knee_l, ankle_l"),
        ({"joints": {"tail": "a"}}, "unknown point 'tail', expected one of hip_l"),
        ({"orientations": {"tail": {"joint": "a", "forward": "+x", "up": "+y"}}}, "unknown segment 'tail'"),
        ({"orientations": {"chest": {"joint": "a", "forward": "x", "up": "+y"}}}, "'x' is not an axis"),
        ({"units": "miles"}, "units"),
        ({"colour": "red"}, "unknown field"),
    ],
)
def test_a_wrong_mapping_file(tmp_path, change, message):
    mapping = guess_mapping(tuple(MIXAMO.split()), "clip.bvh")
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({"name": "mine", "joints": mapping.joints} | change))
    with pytest.raises(ConfigError, match=message):
        find_mapping(tuple(MIXAMO.split()), "clip.bvh", path)
