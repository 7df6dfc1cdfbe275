"""Messages from JSON and back, and what is no message."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.streamer.gateway.messages import (
    KINDS,
    MESSAGE,
    Answer,
    MessageError,
    decode,
    encode,
    intent_of,
)
from flexmotion.streamer.gateway.schema import schema_text
from flexmotion.streamer.motion.intents import FASTEST, Clip, Heading, Stop, Text, Velocity, Waypoint
from flexmotion.streamer.motion.part_intents import FootPlace, Hand, HeadPlace, JointAngle, Look, Point, Relax
from flexmotion.streamer.motion.restriction_intents import Contact, Tension, TorqueCap

DOCUMENT = Path(__file__).parents[3] / "docs" / "messages.schema.json"

NAMES = st.from_regex(r"\A[a-z0-9_.:@/ -]{1,64}\Z")
COMMON = {
    "id": st.none() | NAMES,
    "source": NAMES,
    "sequence": st.none() | st.integers(0, 2**53),
    "stamp_s": st.none() | st.floats(0.0, 1e12),
    "ttl_s": st.none() | st.floats(1e-3, 600.0),
}
WORDS = (
    st.text(st.characters(min_codepoint=32, max_codepoint=0x2FF), min_size=1, max_size=120)
    .map(lambda text: "".join(c for c in text if c.isprintable()))
    .filter(lambda text: bool(text.strip()))
)
JOINTS = st.lists(st.from_regex(r"[a-zA-Z0-9_./-]{1,7}", fullmatch=True), min_size=1, max_size=8, unique=True)
SIDE = st.sampled_from(["left", "right"])
PLACE = st.tuples(*[st.floats(-2.0, 2.0)] * 3)
DIRECTION = PLACE.filter(lambda direction: max(map(abs, direction)) > 0.01)
TIMED = {"in_s": st.floats(0.0, 10.0), "ttl_s": st.none() | st.floats(10.5, 600.0)}
OWN: dict[str, dict[str, Any]] = {
    **dict.fromkeys(("limp", "stiff", "reboot"), {"joints": JOINTS.map(tuple)}),
    "text": {"text": WORDS},
    "clip": {"clip": WORDS},
    "velocity": {"velocity": st.tuples(*(st.floats(-limit, limit) for limit in FASTEST))},
    "heading": {"heading_rad": st.floats(-6.0, 6.0), "turning_rad_s": st.none() | st.floats(0.05, 3.0)},
    "waypoint": {
        "position_m": st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
        "heading_rad": st.none() | st.floats(-6.0, 6.0),
        "tolerance_m": st.floats(0.03, 1.0),
    },
    "hand": {"side": SIDE, "position_m": PLACE, "tolerance_m": st.floats(0.0, 2.0), **TIMED},
    "foot": {
        "side": SIDE,
        "position_m": st.tuples(*[st.floats(-1.0, 1.0)] * 2),
        "heading_rad": st.floats(-3.0, 3.0),
        "tolerance_m": st.floats(0.0, 1.0),
        "tolerance_rad": st.floats(0.0, 3.0),
        **TIMED,
    },
    "head": {
        "position_m": st.tuples(*[st.none() | st.floats(-2.0, 2.0)] * 2, st.floats(-2.0, 2.0)),
        "tolerance_m": st.floats(0.0, 2.0),
        **TIMED,
    },
    "point": {"side": SIDE, "direction": DIRECTION, "tolerance_rad": st.floats(0.0, 3.0), **TIMED},
    "look": {"direction": DIRECTION, "tolerance_rad": st.floats(0.0, 3.0), **TIMED},
    "joint": {"joint": st.just("l_el"), "angle_rad": st.floats(-6.0, 6.0), **TIMED},
    "relax": {
        "part": st.sampled_from(
            ["all", "left hand", "head", "head place", "joint l_el", "both feet", "torque left knee", "tension head"]
        )
    },
    "contact": {"foot": st.sampled_from(["left", "right", "both"])},
    "torque": {"joint": st.sampled_from(["knee", "left knee", "l_el"]), "limit_nm": st.floats(0.01, 1000.0)},
    "tension": {
        "limb": st.sampled_from(["left arm", "right arm", "both arms", "head"]),
        "tension": st.floats(0.0, 1.0),
    },
    "kill": {"confirm": st.just("the robot will fall")},
}


@pytest.mark.parametrize("word", KINDS)
def test_a_message_of_every_type_is_the_same_after_its_way_over_json(word: str) -> None:
    @given(st.fixed_dictionaries({"type": st.just(word), **COMMON, **OWN.get(word, {})}))
    def same(content: dict[str, Any]) -> None:
        message = decode(json.dumps(content).encode())
        assert type(message) is KINDS[word]
        assert {key: getattr(message, key) for key in content} == content
        assert decode(encode(message).encode()) == message

    same()


@given(st.binary(max_size=300))
def test_bytes_that_are_no_message_are_refused_and_nothing_else_happens(data: bytes) -> None:
    with pytest.raises(MessageError) as error:
        decode(data)
    assert error.value.answer.state == "refused"
    Answer.model_validate_json(encode(error.value.answer))


@given(st.recursive(st.none() | st.booleans() | st.floats() | st.text(), lambda one: st.lists(one) | st.dictionaries(
    st.sampled_from(["type", "id", "text", "velocity", "version", "ttl_s", "x"]), one), max_leaves=8))  # fmt: skip
def test_json_that_is_no_message_is_refused(content: Any) -> None:
    with pytest.raises(MessageError):
        decode(json.dumps(content).encode())


def test_a_hundred_thousand_random_byte_strings_are_each_read_or_refused() -> None:
    """Half of them are valid messages with one byte changed: they come further into the decoder."""
    random = np.random.default_rng(20)
    whole = [
        b'{"type":"velocity","velocity":[0.3,0.0,-0.5],"id":"a","sequence":7,"ttl_s":0.5}',
        b'{"type":"text","text":"wave with the right hand","source":"page","stamp_s":1.7e9}',
        b'{"type":"kill","confirm":"the robot will fall"}',
    ]
    read = 0
    for number in range(100_000):
        if number % 2:
            data = bytearray(whole[number % 3])
            data[int(random.integers(len(data)))] = int(random.integers(256))
        else:
            data = bytearray(random.bytes(int(random.integers(64))))
        try:
            message = decode(bytes(data))
        except MessageError:
            continue
        read += 1
        assert MESSAGE.validate_json(encode(message)) == message
    # Another digit or letter is another message; all others were refused.
    assert 0 < read < 50_000


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('{"type":"fly"}', "type: expected one of: text, velocity"),
        ("{}", "type: expected one of"),
        ('{"type":"stop","version":2}', "version"),
        # These were answered in pydantic's words, without the phrase, the fields, the unit.
        # It said "hand.position_m.0: 5.0, expected -2 to 2 (and 2 more)".
        (
            '{"type":"hand","side":"left","position_m":[5,5,5]}',
            "hand.position_m.x: 5, expected -2 to 2 (and 2 more: position_m.y, position_m.z)",
        ),
        ('{"type":"kill"}', "kill.confirm: missing, expected 'the robot will fall'"),
        ('{"type":"text","text":""}', "text.text: empty, expected at least one character"),
        ('{"type":"stop","speed":2}', "speed: unknown field, expected one of: version, id"),
        ('{"type":"velocity","velocity":[9,0,0]}', "velocity.0: 9, expected -3 to 3 m/s"),
        ('{"type":"velocity","velocity":[NaN,0,0]}', "velocity.0"),
        ('{"type":"velocity","velocity":["1",0,0]}', "velocity.0"),
        ('{"type":"velocity","velocity":[true,0,0]}', "velocity.0"),
        ('{"type":"text","text":"wave\\nbow"}', "expected a line of"),
        ('{"type":"text","text":"%s"}' % ("é" * 130), "260 bytes in UTF-8, expected at most 240"),
        ('{"type":"waypoint","position_m":[1e9,0]}', "position_m.x: 1000000000.0, expected -1000 to 1000 m"),
        ('{"type":"waypoint","position_m":[1,0],"tolerance_m":0.001}', "tolerance_m: 0.001, expected 0.03 to 1"),
        ('{"type":"heading","heading_rad":1,"turning_rad_s":0}', "turning_rad_s: 0, expected 0.05 to 3"),
        # Degrees by mistake: headings of 90 and of 1000 rad were accepted, a joint was refused without the unit.
        ('{"type":"heading","heading_rad":90}', "heading_rad: 90, expected -6.28319 to 6.28319 rad"),
        ('{"type":"waypoint","position_m":[1,0],"heading_rad":-90}', "-90, expected -6.28319 to 6.28319 rad"),
        ('{"type":"joint","joint":"l_el","angle_rad":-45}', "angle_rad: -45, expected -6.28319 to 6.28319 rad"),
        ('{"type":"kill"}', "confirm"),
        ('{"type":"stop","ttl_s":0}', "ttl_s"),
        ('{"type":"stop","source":"<script>"}', "source"),
    ],
)
def test_a_refusal_names_the_field_and_what_is_valid(text: str, reason: str) -> None:
    with pytest.raises(MessageError, match=".") as error:
        decode(text.encode())
    assert reason in str(error.value)


def test_an_answer_to_an_invalid_message_still_carries_its_id() -> None:
    with pytest.raises(MessageError) as error:
        decode(b'{"type":"velocity","velocity":[9,9,9],"id":"no. 7","source":"stick"}')
    answer = error.value.answer
    assert (answer.id, answer.source, answer.asked) == ("no. 7", "stick", "velocity")


def test_targets_become_intents_and_a_released_stick_a_stop() -> None:
    def intent(text: str) -> object:
        return intent_of(decode(text.encode()))

    assert intent('{"type":"text","text":"wave"}') == Text("wave")
    assert intent('{"type":"velocity","velocity":[0.5,0,0.1]}') == Velocity(0.5, 0.0, 0.1)
    assert intent('{"type":"velocity","velocity":[0,0,-0.0]}') == Stop()
    assert intent('{"type":"clip","clip":"walk"}') == Clip("walk")
    assert intent('{"type":"hold"}') == Stop()
    assert intent('{"type":"waypoint","position_m":[1,0]}') == Waypoint(1.0, 0.0, None, 0.1)
    assert intent('{"type":"waypoint","position_m":[1,0],"heading_rad":-3,"tolerance_m":0.2}') == Waypoint(
        1, 0, -3, 0.2
    )
    assert intent('{"type":"heading","heading_rad":1.5,"turning_rad_s":0.3}') == Heading(1.5, 0.3)
    hand = '{"type":"hand","side":"left","position_m":[0.1,0.2,0],"in_s":1,"tolerance_m":0.02}'
    assert intent(hand) == Hand("left", (0.1, 0.2, 0.0), 1.0, 0.02)
    foot = '{"type":"foot","side":"left","position_m":[0.06,0.1],"heading_rad":0.2,"in_s":2,"tolerance_m":0.02}'
    assert intent(foot) == FootPlace("left", (0.06, 0.1), 0.2, 2.0, 0.02)
    assert intent('{"type":"foot","side":"right","position_m":[0,-0.1]}') == FootPlace("right", (0.0, -0.1))
    assert intent('{"type":"point","side":"right","direction":[1,0,0]}') == Point("right", (1.0, 0.0, 0.0))
    assert intent('{"type":"look","direction":[1,1,0]}') == Look((1.0, 1.0, 0.0))
    assert intent('{"type":"joint","joint":"l_el","angle_rad":0.5}') == JointAngle("l_el", 0.5)
    assert intent('{"type":"relax"}') == Relax("all")
    assert intent('{"type":"head","position_m":[0.02,null,0.38]}') == HeadPlace((0.02, None, 0.38))
    assert intent('{"type":"contact","foot":"left"}') == Contact("left")
    assert intent('{"type":"torque","joint":"left knee","limit_nm":1}') == TorqueCap("left knee", 1.0)
    assert intent('{"type":"tension","limb":"head","tension":0.5}') == Tension("head", 0.5)
    assert intent('{"type":"arm"}') is None


def test_a_misspelt_part_is_answered_with_the_parts_there_are() -> None:
    """The answer to "relax al" was a regular expression."""
    for message, expected in (
        ('{"type":"relax","part":"al"}', "relax.part: 'al', expected all, left hand, right hand"),
        ('{"type":"joint","joint":"l el","angle_rad":0}', "joint.joint: 'l el', expected the name of a joint"),
        ('{"type":"torque","joint":"!","limit_nm":1}', "torque.joint: '!', expected the name of a joint"),
        ('{"type":"hold","source":"a;b"}', "hold.source: 'a;b', expected letters, digits"),
        ('{"type":"relax","part":"' + 900 * "x" + '"}', "tension head"),
    ):
        with pytest.raises(MessageError) as error:
            decode(message)
        assert expected in str(error.value) and "pattern" not in str(error.value)


def test_a_part_that_is_let_go_before_it_is_there_is_refused() -> None:
    with pytest.raises(MessageError, match=r"ttl_s: 0.4 s, expected more than in_s, 0.5 s"):
        decode(b'{"type":"look","direction":[1,0,0],"ttl_s":0.4}')


def test_the_schema_in_the_documents_is_that_of_the_messages() -> None:
    assert DOCUMENT.read_text(encoding="utf-8") == schema_text(), (
        "write it: python -m flexmotion.streamer.gateway.schema docs/messages.schema.json"
    )
    named = json.loads(schema_text())["$defs"]
    assert {kind.__name__ for kind in KINDS.values()} <= named.keys()
