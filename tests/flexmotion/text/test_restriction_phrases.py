"""Sentences that only restrict the robot, and those that say more or another thing."""

from __future__ import annotations

import pytest

from flexmotion.text.part_phrases import part_phrase
from flexmotion.text.restriction_phrases import RestrictionPhrase, restriction_phrase


@pytest.mark.parametrize(
    ("sentence", "foot"),
    [
        ("keep your left foot down", "left"),
        ("Keep the right foot on the ground, please!", "right"),
        ("keep both feet on the ground", "both"),
        ("keep your feet on the floor", "both"),
        ("keep both of your feet planted", "both"),
        ("leave your left leg down on the floor", "left"),
        ("don't lift your right foot", "right"),
        ("do not lift your feet off the ground", "both"),
        ("keep the left foot still", "left"),  # walked to the left
        ("keep left foot down", "left"),
        ("plant your left foot", "left"),  # walked to the left
        ("your left foot stays down", "left"),  # stood, and kept nothing, as those that follow
        ("dont lift ur left foot", "left"),
        ("make sure your right foot stays on the floor", "right"),
        ("never let your right foot leave the ground", "right"),
        ("your feet must not leave the ground", "both"),
        ("don't move your left foot", "left"),
        ("keep your feet still", "both"),
    ],
)
def test_a_foot_is_kept_on_the_ground(sentence: str, foot: str) -> None:
    assert restriction_phrase(sentence) == RestrictionPhrase(foot=foot)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("sentence", "foot"),
    [
        ("you may lift your feet again", "both"),
        ("You can lift your left foot again.", "left"),
        ("now you may move both feet", "both"),
        ("let your left foot go", "left"),  # walked to the left
        ("release both feet", "both"),
    ],
)
def test_a_foot_is_let_go(sentence: str, foot: str) -> None:
    assert restriction_phrase(sentence) == RestrictionPhrase(foot=foot, lets_go=True)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("sentence", "joint", "limit"),
    [
        ("no more than 1 newton metre at the knee", "knee", 1.0),
        ("No more than 1 N·m at the knee", "knee", 1.0),
        ("at most 1.5 Nm in your left knee", "left knee", 1.5),
        ("limit the right elbow to half a newton metre", "right elbow", 0.5),
        ("limit both knees to one and a half newton meters", "knee", 1.5),
        ("cap the torque of your neck at .2 N m", "neck", 0.2),
        ("use no more than two newton-metres at the hips", "hip", 2.0),
        ("Limit your shoulders to a quarter of a newton metre.", "shoulder", 0.25),
    ],
)
def test_a_torque_is_capped(sentence: str, joint: str, limit: float) -> None:
    assert restriction_phrase(sentence) == RestrictionPhrase(joint=joint, limit=pytest.approx(limit))  # type: ignore[arg-type]


def test_a_torque_is_let_go() -> None:
    expected = RestrictionPhrase(joint="right elbow", lets_go=True)
    assert restriction_phrase("remove the torque limit of the right elbow") == expected
    assert restriction_phrase("lift the limit at your right elbow") == expected
    assert restriction_phrase("take off the torque limit of the right elbow") == expected  # refused as flight


@pytest.mark.parametrize(
    ("sentence", "limb", "tension"),
    [
        ("soften your arms", "both arms", 0.0),
        ("loosen your left arm", "left arm", 0.0),
        ("please let both arms go loose", "both arms", 0.0),
        ("make your right arm stiff", "right arm", 1.0),
        ("tense your arms", "both arms", 1.0),
        ("stiffen your neck", "head", 1.0),
    ],
)
def test_limbs_are_softened_and_stiffened(sentence: str, limb: str, tension: float) -> None:
    assert restriction_phrase(sentence) == RestrictionPhrase(limb=limb, tension=tension)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "sentence",
    [
        "relax",
        "relax your arms",
        "don't stiffen your left arm",  # it let go, and stiffened an arm that was soft
        "stop tensing your arms",
        "make your arms stiffer",
        "stiffen his neck",
        "walk with relaxed arms",
        "raise your arms",
        "keep your feet still and bow",
        "don't move your feet",
        "keep your left foot up",
        "keep your feet on the ground and wave",
        "lift your left foot",
        "keep your left hand down",
        "keep walking",
        "bend the knee",
        "walk no more than 2 metres",
        "no more than a few newton metres at the knee",
        "no more than one newton metre at the nose",
        "stand on one foot",
        "look at your feet",
        "walk two feet ahead",
        "limit your speed to one metre per second",
    ],
)
def test_everything_else_is_left_to_the_grammar(sentence: str) -> None:
    assert restriction_phrase(sentence) is None


def test_a_look_and_a_point_are_no_restriction() -> None:
    for sentence in ("look at the floor", "point to the ground with your left hand"):
        assert part_phrase(sentence) is not None and restriction_phrase(sentence) is None
