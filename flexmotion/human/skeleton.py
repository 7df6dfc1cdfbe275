"""The human skeleton: joint coordinates, their order and signs.

29 degrees of freedom as in full-body models of biomechanics (6 of the pelvis, 3 lumbar, 5 per leg, 5 per arm), and 3 of
the neck, since robots have heads.

Zero is upright stance facing x with hanging arms, palms forward; every segment's frame then has x forward, y left,
z up. Joints of three coordinates rotate in the order listed, intrinsically. Positive extension of lumbar and neck leans
back (-y), bending leans to the right (+x), rotation turns to the left (+z). Positive flexion of hip, shoulder and elbow
brings the limb forward (-y), knee flexion brings the heel to the seat (+y), ankle dorsiflexion lifts the toes (-y),
adduction brings a limb to the midline (right +x, left -x); rotation and pronation are internal: the front of the limb
turns towards the midline (right +z, left -z).
"""

LEFT, RIGHT = 0, 1
SIDES = ("l", "r")
"""Every array with an axis of two sides is ordered left, right."""

TRUNK_JOINTS = (
    "lumbar_extension",
    "lumbar_bending",
    "lumbar_rotation",
    "neck_extension",
    "neck_bending",
    "neck_rotation",
)
LEG_JOINTS = ("hip_flexion", "hip_adduction", "hip_rotation", "knee_flexion", "ankle_dorsiflexion")
ARM_JOINTS = ("shoulder_flexion", "shoulder_adduction", "shoulder_rotation", "elbow_flexion", "forearm_pronation")

JOINTS: tuple[str, ...] = TRUNK_JOINTS + tuple(f"{joint}_{side}" for side in SIDES for joint in LEG_JOINTS + ARM_JOINTS)
"""The 26 joint coordinates, in the order of `Motion.joints`."""

ROOT_DOFS = ("pelvis_tx", "pelvis_ty", "pelvis_tz", "pelvis_list", "pelvis_tilt", "pelvis_rotation")
"""Linear, then angular degrees of freedom of the root, in the order of `Motion.torques`."""

DOF_COUNT = len(ROOT_DOFS) + len(JOINTS)

CONTACT_JOINTS: tuple[str, ...] = (
    *(f"{joint}_{side}" for side in SIDES for joint in ("hip", "knee", "ankle")),
    "lumbar",
)
"""The joints whose contact force is computed, in the order of `Motion.joint_contact`."""
