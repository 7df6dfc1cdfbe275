"""The OP3's retargeter, and humans who stand, walk, shuffle and turn as asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import StreamSettings, load_stream
from flexmotion.human.body import Body
from flexmotion.human.contacts import ContactDetector
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.importers.default_clip import Script, build_clip, default_clip
from flexmotion.retarget.footholds import Scaling
from flexmotion.retarget.human import HumanWindow
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.steps import Step
from flexmotion.retarget.swing import Swings
from flexmotion.retarget.view import HumanView

FPS = 30.0
RATE = 125
"""Loop ticks a second of the OP3."""

Windows = Callable[[Motion], HumanWindow]
Views = Callable[..., HumanView]


def in_time(swings: Swings, step: Step) -> bool:
    """Whether the servos swing the foot as fast as a step asks."""
    return swings.shortest_s(step.side, step.start, step.target) <= (step.land - step.lift) / RATE + 1e-6


def step_script(steps: Sequence[tuple[str, float, float, float]], seconds: float, clearance: float = 0.09) -> Script:
    """A human with hanging arms and slightly bent knees; steps are (foot, lift [s], land [s], x [m])."""
    return Script(
        fps=FPS,
        seconds=seconds,
        joints={"shoulder_adduction_l": [(0, -8)], "shoulder_adduction_r": [(0, -8)]},
        pelvis_tilt=[(0, 0)],
        pelvis_drop=[(0, 0.05)],
        clearance=clearance,
        steps=[{"foot": foot, "lift": lift, "land": land, "x": x} for foot, lift, land, x in steps],
    )


@pytest.fixture(scope="session")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="session")
def stream() -> StreamSettings:
    return load_stream()


@pytest.fixture(scope="session")
def retargeter(op3: Robot, stream: StreamSettings) -> Retargeter:
    return Retargeter(op3, stream)


@pytest.fixture(scope="session")
def swings(retargeter: Retargeter) -> Swings:
    return retargeter.swings


@pytest.fixture(scope="session")
def clip() -> Motion:
    return default_clip()


@pytest.fixture(scope="session")
def walk() -> Motion:
    """Eight steps of .3 m, right foot first, half a second each; a second of standing before and after."""
    steps = [("rl"[k % 2], 1.06 + 0.5 * k, 1.44 + 0.5 * k, 0.15 + 0.3 * k) for k in range(7)]
    return build_clip(step_script([*steps, ("l", 4.56, 4.94, steps[-1][3])], 6.0), Body())


@pytest.fixture(scope="session")
def shuffle() -> Motion:
    """Eight swings of 3 cm, too low and short to count as steps."""
    swings = [("rl"[k % 2], 1.06 + 0.5 * k, 1.44 + 0.5 * k, 0.015 * (k + 1)) for k in range(8)]
    return build_clip(step_script(swings, 6.0, clearance=0.03), Body())


@pytest.fixture(scope="session")
def stand() -> Callable[..., Motion]:
    """Function (frames, joint=angle, ...) -> an upright human who stands still, with these joint angles [rad]."""

    def make(frames: int, **joints: float) -> Motion:
        body = Body()
        angles = np.zeros((frames, len(JOINTS)))
        for name, angle in joints.items():
            angles[:, JOINTS.index(name)] = angle
        return Motion(
            fps=FPS,
            root_position=np.tile([0.0, 0.0, body.standing_height], (frames, 1)),
            root_quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
            joints=angles,
            body=body,
        )

    return make


@pytest.fixture(scope="session")
def spin(stand: Callable[..., Motion]) -> Motion:
    """A human who stands, turns left by 80 degrees in two seconds on planted feet, and stands."""
    still = stand(150)
    yaw = np.radians(80) * np.clip((np.arange(150) / FPS - 1.0) / 2.0, 0.0, 1.0)
    turned = Rotation.from_euler("z", yaw[:, None]).as_quat(scalar_first=True)
    return Motion(
        fps=FPS, root_position=still.root_position, root_quaternion=turned, joints=still.joints, body=still.body
    )


@pytest.fixture(scope="session")
def window() -> Windows:
    """Function motion -> the window of all its frames."""

    def make(motion: Motion) -> HumanWindow:
        return HumanWindow(motion, 0.0, ContactDetector().initial(), None)

    return make


@pytest.fixture(scope="session")
def view(retargeter: Retargeter, window: Windows) -> Views:
    """Function (motion, first tick of the plan) -> all of the motion from tick 0 on, for the OP3."""

    def make(motion: Motion, now: int = 0) -> HumanView:
        scaling = Scaling(retargeter.body.leg_length / motion.body.leg, 0.0, motion.body.segments.hip_width)
        seen = window(motion)
        return HumanView(seen, scaling, 0.0, RATE, now, max(int(seen.end_s * RATE) + 1 - now, 1), whole=True)

    return make
