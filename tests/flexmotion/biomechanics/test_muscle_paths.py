"""Muscle paths of the legs against the published model."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("myo_sim", reason="extra 'biomech' is not installed")

from flexmotion.biomechanics import muscle_geometry
from flexmotion.biomechanics.muscle_geometry import muscle_models
from flexmotion.configs.errors import ConfigError

Float = NDArray[np.float64]

LEFT, RIGHT = 0, 1


@pytest.mark.parametrize("side", [LEFT, RIGHT])
@pytest.mark.parametrize(
    ("muscle", "joint", "pose", "published"),
    [
        # MyoLegs lacked the pelvic brim: 12 mm, and psoas hardly took part in walking.
        ("psoas", "hip_flexion", {"hip_flexion": -20}, 25.5),
        ("iliacus", "hip_flexion", {"hip_flexion": -20}, 36.1),
        # MyoLegs had the knee's axis 8 mm too far forward: 41, 29 and 42 mm.
        # MyoLegs lacked the surface at the condyles: 10 mm.
        ("gasmed", "knee_flexion", {}, 17.6),
        ("gasmed", "knee_flexion", {"knee_flexion": 60}, 29.0),
        ("semimem", "knee_flexion", {}, 32.2),
        ("bfsh", "knee_flexion", {}, 21.3),
        ("vasint", "knee_flexion", {}, -45.9),
        ("glmax1", "hip_flexion", {"hip_flexion": 30}, -45.0),
        ("soleus", "ankle_dorsiflexion", {}, -38.0),
    ],
)
def test_moment_arms_are_those_of_the_2016_model(
    side: int, muscle: str, joint: str, pose: dict[str, float], published: float
) -> None:
    leg = muscle_models()[side]
    letter = "lr"[side]
    angles = np.radians([pose.get(name.removesuffix(f"_{letter}"), 0.0) for name in leg.joints])
    _, slopes = leg.lengths_and_slopes(angles)
    found = -1e3 * slopes[leg.muscles.index(f"{muscle}_{letter}"), leg.joints.index(f"{joint}_{letter}")]
    # Published: computed by OpenSim from the model file, other angles of the hip near zero.
    assert found == pytest.approx(published, abs=4.0)


def test_paths_do_not_jump_to_the_other_side_of_a_bone() -> None:
    """Psoas passed behind the pelvic brim at 25 degrees of flexion, and was 200 mm longer."""
    generator = np.random.default_rng(0)
    for leg, letter in zip(muscle_models()[:2], "lr", strict=True):
        # Beyond 110 degrees of knee flexion the medial gastrocnemius leaves its surface, with a step of 6 mm.
        poses = generator.uniform([-0.6, -0.5, -0.6, 0.0, -0.5], [2.0, 0.35, 0.6, 1.85, 0.4], (300, 5))
        lengths = np.array([leg.lengths_and_slopes(pose)[0] for pose in poses])
        near = np.array([leg.lengths_and_slopes(pose + 0.01)[0] for pose in poses])
        worst = np.abs(near - lengths).max(axis=0)
        for name in ("psoas", "iliacus", "glmax1", "glmax2", "gasmed"):
            # Arms of at most 100 mm about three axes turned by .01 rad.
            assert worst[leg.muscles.index(f"{name}_{letter}")] < 0.003, name


def test_legs_are_mirror_images() -> None:
    generator = np.random.default_rng(1)
    left, right = muscle_models()[:2]
    for pose in generator.uniform([-0.5, -0.4, -0.5, 0.0, -0.4], [1.5, 0.3, 0.5, 1.8, 0.4], (20, 5)):
        (one, one_slopes), (two, two_slopes) = left.lengths_and_slopes(pose), right.lengths_and_slopes(pose)
        assert one == pytest.approx(two, abs=2e-4)
        assert one_slopes == pytest.approx(two_slopes, abs=2e-3)


def test_a_model_with_another_knee_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: any later `myo-sim` was taken, and its corrected knee would have been replaced without a word."""
    legs, trunk = muscle_geometry._specs()
    for side in "lr":
        for joint in legs.body(f"tibia_{side}").joints:
            if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
                joint.pos = muscle_geometry.KNEE_AXIS
    monkeypatch.setattr(muscle_geometry, "_specs", lambda: (legs, trunk))
    with pytest.raises(ConfigError, match=r"knee_angle_l is at \(-8.1, -3.5, 1.5\) mm .*myo-sim<0.3"):
        muscle_models.__wrapped__()
