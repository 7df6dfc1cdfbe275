"""`part_of_words`: the intent of a sentence that asks for head or arm alone, or only restricts the robot.

A robot that was judged not to do what such a sentence means refuses it (`unoffered_part`); targets by place, direction
or joint are no kinds of motion, and are solved.
"""

from __future__ import annotations

from flexmotion.configs.repertoire import RobotRepertoire
from flexmotion.streamer.motion.intents import Intent, Text, words_of
from flexmotion.streamer.motion.part_intents import Look, PartIntent, Point, Relax
from flexmotion.streamer.motion.restriction_intents import MOST_NM, Contact, Tension, TorqueCap
from flexmotion.text.part_phrases import part_phrase
from flexmotion.text.restriction_phrases import LEAST_NM, restriction_phrase
from flexmotion.text.robot_refusal import robot_refusal

WORDS_HOLD_S = 5.0
"""A look or a point that was asked for in words is held this long; words say no end [s]."""
_IN_S = 0.8
_TOLERANCE = 0.8
"""Words name a direction to within this angle [rad]."""


def part_of_words(intent: Intent) -> PartIntent | None:
    """What the words of an intent ask of head or arm alone, or restrict; None where they ask for anything else."""
    if not isinstance(intent, Text):
        return None
    found = part_phrase(intent.text)
    if found is None:
        return _restriction(intent.text)
    if found.side is None:
        return Look(found.direction, _IN_S, _TOLERANCE)
    return Point(found.side, found.direction, _IN_S, _TOLERANCE)


def unoffered_part(intent: Intent, robot: RobotRepertoire | None) -> str | None:
    """Why a robot does not do what words ask of head or arm alone; None where it does, or they ask for anything else.

    Args:
        robot: what it was judged to do; None: it was not judged.
    """
    found = part_phrase(intent.text) if isinstance(intent, Text) else None
    if robot is None or found is None or found.kind is None or robot.offers(found.kind):
        return None
    return f"{words_of(intent)!r}: {robot_refusal(robot, found.kind)}"


def _restriction(sentence: str) -> PartIntent | None:
    found = restriction_phrase(sentence)
    if found is None:
        return None
    if found.foot is not None:
        contact = Contact(found.foot)
        return Relax(contact.part) if found.lets_go else contact
    if found.limb is not None and found.tension is not None:
        return Tension(found.limb, found.tension)
    assert found.joint is not None
    # A limit beyond what a message could name binds nothing; of a cap that is let go it does not matter.
    cap = TorqueCap(found.joint, min(found.limit or LEAST_NM, MOST_NM))
    return Relax(cap.part) if found.lets_go else cap
