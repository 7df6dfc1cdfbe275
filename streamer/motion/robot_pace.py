"""`human_pace`, `human_scale`: the speed to which a human is limited so that a robot keeps up, and its metres."""

from __future__ import annotations

from flexmotion.configs.robot import Robot
from flexmotion.human.body import Body
from flexmotion.retarget.whole_body import WholeBody
from flexmotion.sampling.pace import Pace


def human_scale(robot: Robot, body: Body) -> float:
    """Metres of a human for one of a robot, by the length of their legs."""
    return float(body.leg / WholeBody(robot).leg_length)


def human_pace(robot: Robot, body: Body) -> Pace | None:
    """A robot's pace in the scale of a human, lengths by the ratio of their legs.

    None if the robot file has no pace.
    """
    own = robot.gait.pace
    if own is None:
        return None
    ratio = human_scale(robot, body)
    reached = None if own.reached is None else own.reached * ratio
    ahead, back, aside = own.ahead * ratio, own.back * ratio, own.aside * ratio
    return Pace(ahead, back, aside, own.turning, reached, own.curve_with_arms)
