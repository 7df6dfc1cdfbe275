"""Recipes of gestures."""

from __future__ import annotations

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import parse
from flexmotion.gestures.recipes import Recipes, recipes
from flexmotion.text.phrases import wordings
from flexmotion.text.sides import mirrored, sides

NOD = {"kind": "nod", "poses": {"down": {"head": {"up": [-20, -10]}}}, "steps": [{"pose": "down"}], "captions": ["nod"]}


def test_every_gesture_has_wordings_on_each_of_its_sides() -> None:
    for gesture in recipes():
        assert wordings(gesture.kind) and wordings(mirrored(gesture.kind)), gesture.kind
        sided = any("right" in text for text in gesture.captions)
        assert bool(sides(gesture.kind)) == sided or gesture.kind == "look-around", gesture.kind


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"steps": [{"pose": "up"}]}, "steps name unknown poses: up; known: down"),
        ({"steps": [{}]}, "a step needs either pose or repeat"),
        ({"steps": [{"repeat": ["down"], "count": [3, 2]}]}, "expected the least number, 1 or more, first"),
        ({"poses": {"down": {"head": {"up": [-10, -20]}}}}, "expected the least value first"),
        ({"poses": {"down": {"arm": {"upper": [0, 0, 1]}}}}, "either upper and forearm, or hand and elbow"),
        ({"poses": {"down": {"arm": {"upper": [0, 0, 0], "forearm": [1, 0, 0]}}}}, "a direction of length zero"),
        ({"poses": {"down": {"nose": {}}}}, "nose"),
        ({"over": ["swim"]}, "over"),
    ],
)
def test_a_wrong_recipe_is_refused_with_its_field(change: dict, said: str) -> None:
    with pytest.raises(ConfigError, match="ours.yaml: field gestures.0") as caught:
        parse(Recipes, {"gestures": [NOD | change]}, "ours.yaml")
    assert said in str(caught.value)


def test_both_arms_exclude_one() -> None:
    arm = {"upper": [0, 1, 0], "forearm": [0, 1, 0]}
    with pytest.raises(ConfigError, match="both_arms excludes arm"):
        parse(Recipes, {"gestures": [NOD | {"poses": {"down": {"both_arms": arm, "arm": arm}}}]}, "ours.yaml")
