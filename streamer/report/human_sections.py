"""The report's sections that compare the robot with the human."""

from __future__ import annotations

import math
from dataclasses import asdict

from flexmotion.streamer.report.figure import Figure, Maybe, Section
from flexmotion.streamer.report.likeness import Likeness
from flexmotion.streamer.report.metrics import MotionFigures
from flexmotion.streamer.report.torque_profile import TorqueProfile


class LikenessSection(Section):
    """How much of the human's motion the robot did; see `flexmotion.streamer.report.likeness.Likeness`.

    `net_path` and `heading_deg` are those of the motion; `left_out` names the parts of which it did less than half.
    """

    score: Figure
    left_out: tuple[str, ...]
    parts: dict[str, Figure]
    net_path: Maybe
    heading_deg: Maybe
    arm_direction_deg: Maybe
    upper_arm_deg: Maybe
    forearm_deg: Maybe
    trunk_deg: Maybe
    trunk_range: Maybe
    unreachable_share: Maybe
    human_turned_deg: Figure
    human_bend_deg: Figure
    human_flight_s: Figure

    @classmethod
    def of(cls, found: Likeness, motion: MotionFigures) -> LikenessSection:
        """The section of a run."""
        heading = motion.heading_rms_rad
        return cls(
            **asdict(found),
            left_out=found.left_out,
            net_path=motion.net_path_ratio,
            heading_deg=None if heading is None else math.degrees(heading),
        )


class JointProfileSection(Section):
    """Mean relative effort of a human's joint and the robot's, greatest load of the robot's, correlation over time."""

    human_joint: str
    human: Figure
    robot: Figure
    peak_load: Figure
    correlation: Maybe


class TorqueProfileSection(Section):
    """The human's torque beside the robot's; see `flexmotion.streamer.report.torque_profile`."""

    correlation: Maybe
    joints: dict[str, JointProfileSection]

    @classmethod
    def of(cls, profile: TorqueProfile) -> TorqueProfileSection:
        """The figures of a profile."""
        joints = {
            name: JointProfileSection(
                human_joint=one.human_joint,
                human=one.human.mean(),
                robot=one.robot.mean(),
                peak_load=one.load.max(),
                correlation=one.correlation,
            )
            for name, one in profile.joints.items()
        }
        return cls(correlation=profile.correlation, joints=joints)
