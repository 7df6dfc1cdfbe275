"""Sizes and inertia of the human."""

from __future__ import annotations

from dataclasses import replace

import pytest

from flexmotion.human.body import Body, Segments

PAIRED = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")


@pytest.mark.parametrize("sex", ["male", "female"])
def test_masses_of_segments_add_up_to_the_body(sex):
    body = Body(mass=62.0, sex=sex)
    total = sum(body.inertia(name).mass for name in ("head", "torso", "lower_trunk"))
    total += 2 * sum(body.inertia(name).mass for name in PAIRED)
    # Shares in the table are rounded to .01 %.
    assert total == pytest.approx(62.0, rel=2e-4)


@pytest.mark.parametrize("sex", ["male", "female"])
def test_torso_and_pelvis_are_the_whole_trunk_of_the_table(sex):
    # Cervicale to mid hip: centre at 51.38 and 49.64 % from the top; within 1 %, since the spine is not straight.
    body = Body(sex=sex)
    torso, pelvis = body.inertia("torso"), body.inertia("lower_trunk")
    lengths = {"male": (457.6, 145.7), "female": (433.3, 181.5)}[sex]
    from_top = (1 - torso.com) * lengths[0], lengths[0] + pelvis.com * lengths[1]
    centre = (torso.mass * from_top[0] + pelvis.mass * from_top[1]) / (torso.mass + pelvis.mass) / sum(lengths)
    assert centre == pytest.approx({"male": 0.5138, "female": 0.4964}[sex], abs=0.01)


def test_default_segments_add_up_to_the_stature():
    size = Body(height=1.8).segments
    assert size.ankle_height + size.leg + size.lumbar_height + size.neck_height + size.head == pytest.approx(1.8)


def test_segments_scale_with_stature():
    assert Segments.of_height(2.0).thigh == pytest.approx(2 * Segments.of_height(1.0).thigh)


def test_bodies_are_equal_and_hash_by_value():
    assert hash(Body(1.7)) == hash(Body(1.7))
    assert Body(1.7) != Body(1.7, fitted=replace(Segments.of_height(1.7), thigh=0.5))


@pytest.mark.parametrize(
    ("field", "value"), [("height", 0.0), ("mass", -1.0), ("mass", float("nan")), ("sex", "unknown")]
)
def test_wrong_bodies_are_refused(field, value):
    with pytest.raises(ValueError, match=field):
        Body(**{field: value})


def test_a_bone_without_length_is_refused():
    with pytest.raises(ValueError, match="thigh"):
        Body(fitted=replace(Segments.of_height(1.7), thigh=0.0))


def test_unknown_segment():
    with pytest.raises(KeyError):
        Body().inertia("tail")
