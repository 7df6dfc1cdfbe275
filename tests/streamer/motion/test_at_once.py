"""Two motions at the same time: a gesture of free arms or of the head beside another motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.shipped import bundle_folder
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import load_robot
from flexmotion.human.kinematics import forward
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.motion.hearing import Hearing
from flexmotion.streamer.motion.intents import Heading, Text, Velocity, Waypoint
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.programs import Program
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.targets import Target


@pytest.fixture(scope="module")
def sampler(bundle: Path) -> Sampler:
    return Sampler(Bundle(bundle))


@pytest.fixture(scope="module")
def hearing(sampler: Sampler) -> Hearing:
    return Hearing(sampler, human_pace(load_robot("op3"), sampler.body))


def hear(hearing: Hearing, say: str, after: str | None = None) -> Program:
    before = None if after is None else hearing(Text(after))
    return hearing(Text(say), before, before)


def motions(program: Program) -> list[str]:
    return [step.told.motion for step in program.steps]


@pytest.mark.parametrize(
    ("say", "does"),
    [
        ("walk while waving", ["walk with wave-right-hand"]),
        ("wave with your left hand while walking backwards", ["walk-back with wave-left-hand"]),
        ("while walking, wave", ["walk with wave-right-hand"]),
        ("walk forward and nod at the same time", ["walk with nod"]),
        ("walk, and at the same time nod", ["walk with nod"]),
        ("turn left with your hands on your hips", ["walk-turn-left with hands-on-hips"]),
        ("walk with raised hands, then bow", ["walk with raise-up-both-hands", "bow"]),
        ("wave while nodding", ["wave-right-hand with nod"]),
        ("wave while bowing", ["bow with wave-right-hand"]),
        ("stand still while waving", ["wave-right-hand"]),
        ("step to the left, nodding", ["walk-left with nod"]),
    ],
)
def test_both_are_done(hearing: Hearing, say: str, does: list[str]) -> None:
    """One of both was done, and the other told as left out."""
    program = hear(hearing, say)
    assert program.heard.state in ("accepted", "slowed") and motions(program) == does
    assert program.heard.heard_as == ", ".join(does)


@pytest.mark.parametrize(
    ("say", "does", "dropped"),
    [
        ("walk while punching", "walk", "while punching"),
        ("clap while waving", "clap", "while waving"),
        ("walk while singing", "walk", "while singing"),
        ("walk with your eyes closed", "walk", "with your eyes closed"),
        ("walk with your knees bent", "walk", "with your knees bent"),
        ("wave at me while i walk", "wave-right-hand", "while i walk"),
        ("walk while she waves", "walk", "while she waves"),
        ("stop walking while waving", "stand", "while waving"),
        ("walk three metres while waving for two seconds", "walk with wave-right-hand", "wave two seconds"),
    ],
)
def test_what_does_not_fit_is_told_as_left_out(hearing: Hearing, say: str, does: str, dropped: str) -> None:
    program = hear(hearing, say)
    assert program.heard.state == "partly" and motions(program) == [does]
    assert dropped in program.heard.dropped


def test_the_count_of_a_gesture_is_the_time_of_both(hearing: Hearing) -> None:
    """A walk "while waving three times" would have gone on without an end."""
    (step,) = hear(hearing, "wave three times while walking").steps
    assert step.kind == "walk" and step.amount is not None and step.amount.quantity == "time"
    (nods,) = hear(hearing, "walk while nodding twice").steps
    assert nods.amount is not None and 1.0 < nods.amount.value < step.amount.value
    (way,) = hear(hearing, "walk two metres while waving three times").steps
    assert way.amount is not None and way.amount.quantity == "length"


@pytest.mark.parametrize(
    "say",
    [
        *(
            "stop waving",
            "don't wave",
            "no more waving",
            "please stop waving",
            "ok stop waving now",
            "you can stop waving",
        ),
        *(
            "quit waving",
            "enough waving",
            "don't wave anymore",
            "stop waving, keep walking",
            "keep walking but stop waving",
        ),
        *("lower your right hand", "lower your hand", "lower your arms"),
    ],
)
def test_the_gesture_ends_and_the_walk_goes_on(hearing: Hearing, say: str) -> None:
    """The robot stood."""
    program = hear(hearing, say, after="walk while waving")
    assert motions(program) == ["walk"] and program.heard.notes == ("walk goes on without it",)


@pytest.mark.parametrize("say", ["stop", "stop walking", "halt", "don't move", "stand still"])
def test_a_stop_is_one_whatever_is_under_way(hearing: Hearing, say: str) -> None:
    assert motions(hear(hearing, say, after="walk while waving")) == ["stand"]


@pytest.mark.parametrize(
    "say",
    [
        *("stop moving and waving", "stop waving and moving", "stop waving or moving", "no waving or walking"),
        *(
            "stop waving and everything else",
            "halt waving",
            "stop in front of the waving man",
            "don't hit the waving man",
        ),
        *("stop with your hand up", "stop the moment I wave", "stop walking and waving", "stop, waving"),
    ],
)
def test_a_stop_that_means_more_than_the_gesture_is_a_stop(hearing: Hearing, say: str) -> None:
    """The walk went on: "stop moving and waving" was heard as the end of the wave."""
    assert motions(hear(hearing, say, after="walk while waving")) == ["stand"]


@pytest.mark.parametrize(
    "say",
    [
        *(
            "wave while telling him to walk",
            "wave while you are waiting for me to walk",
            "nod while waiting to turn left",
        ),
        *("wave while showing me how to walk", "wave while jogging his memory", "wave while you stop walking"),
    ],
)
def test_what_others_do_moves_no_foot(hearing: Hearing, say: str) -> None:
    """The robot walked, ran and turned."""
    program = hear(hearing, say)
    assert program.heard.state == "partly" and not program.steps[0].moves and program.heard.dropped


@pytest.mark.parametrize("say", ["walk between people waving", "walk past the people clapping"])
def test_the_gestures_of_others_are_none_of_the_robot(hearing: Hearing, say: str) -> None:
    assert hear(hearing, say).heard.state == "refused"


@pytest.mark.parametrize(
    ("say", "does"),
    [
        ("stand still for five seconds while waving", "wave-right-hand"),
        ("wave while standing still for five seconds", "wave-right-hand"),
        ("nod and wait five seconds at the same time", "nod"),
    ],
)
def test_the_time_of_a_stand_is_that_of_the_gesture(hearing: Hearing, say: str, does: str) -> None:
    """It was lost: the robot waved without an end."""
    (step,) = hear(hearing, say).steps
    assert step.kind == does and step.amount is not None and step.amount.value == 5.0


def test_then_is_an_order_of_doing_whatever_is_at_the_same_time(hearing: Hearing) -> None:
    """The bow was made beside what comes after it."""
    program = hear(hearing, "walk and bow at the same time, then wave")
    assert motions(program) == ["walk", "bow", "wave-right-hand"] and program.heard.dropped == ("at the same time",)


def test_a_gesture_is_beside_its_motion_at_a_rate_and_on_the_spot(hearing: Hearing) -> None:
    for say in ("walk forward at 0.3 m/s while waving", "turn left on the spot while waving"):
        (step,) = hear(hearing, say).steps
        assert isinstance(step.intent, Velocity) and step.beside == Text("wave"), say


def test_an_intent_with_a_gesture_is_no_item_of_a_script(sampler: Sampler) -> None:
    """The gesture was left out without a word: words say both."""
    with pytest.raises(ConfigError, match="beside 'wave': say both in words"):
        ModelSource(sampler, [Item(0.0, Text("walk", beside=Text("wave")))], "walk")


def test_an_arm_that_is_held_out_during_a_bow_takes_its_place(hearing: Hearing) -> None:
    """The robot bowed on for twelve seconds, with one arm out, and said "bow goes on"; a walk does go on."""
    bow, walk = hear(hearing, "bow"), hear(hearing, "walk forward")
    after = [hearing(Text("hold out your right hand"), under_way, under_way).heard for under_way in (bow, walk)]
    assert [one.heard_as for one in after] == ["hold-out-right-hand", "walk with hold-out-right-hand"]


def test_a_gesture_comes_to_what_is_under_way(hearing: Hearing) -> None:
    """The walk ended."""
    program = hear(hearing, "wave at the same time", after="walk slowly")
    assert motions(program) == ["walk with wave-right-hand"] and isinstance(program.steps[0].intent, Velocity)
    counted = hear(hearing, "meanwhile nod twice", after="walk")
    assert motions(counted) == ["walk with nod"] and counted.heard.dropped == ("2 times",)


@pytest.mark.parametrize(
    ("say", "reason"),
    [
        ("wave while walking, don't walk", "asked for and forbidden"),
        ("don't walk but wave while walking", "asked for and forbidden"),
        ("wave while walking, don't move your feet", "asked for and forbidden"),
        ("nod while turning left, don't turn", "asked for and forbidden"),
        ("walk while waving, don't wave", "asked for and forbidden"),
        ("walk with raised hands, don't raise your hands", "asked for and forbidden"),
        ("turn while waving", "to the left or to the right"),
        ("turn on the spot with your hands up", "is not understood"),
        ("sit down while waving", "is not understood"),
    ],
)
def test_what_is_forbidden_or_not_known_is_so_at_the_same_time_too(hearing: Hearing, say: str, reason: str) -> None:
    """A walk in "while walking" was done though it was forbidden, and "sit down while waving" only waved."""
    heard = hear(hearing, say).heard
    assert heard.state == "refused" and reason in str(heard.reason)


@pytest.mark.parametrize("say", ["don't walk, wave while turning left", "wave while turning left, do not walk"])
def test_a_turn_without_walking_is_one_on_the_spot_beside_a_gesture_too(hearing: Hearing, say: str) -> None:
    (step,) = hear(hearing, say).steps
    assert isinstance(step.intent, Velocity) and step.intent.forward == 0.0 < step.intent.turning
    assert step.told.beside == "wave-right-hand"


@pytest.mark.parametrize(
    ("say", "does"),
    [
        ("keep your hands up and walk", ["walk with raise-up-both-hands"]),
        ("hands on hips, turn left, then bow", ["walk-turn-left with hands-on-hips", "bow"]),
        ("with your hands on your hips, turn left 90 degrees", ["walk-turn-left with hands-on-hips"]),
        ("one step back with hands up", ["walk-back with raise-up-both-hands"]),
        ("back away with your hands up", ["walk-back with raise-up-both-hands"]),
        (
            "turn 90 degrees left waving then 90 right nodding",
            ["walk-turn-left with wave-right-hand", "walk-turn-right with nod"],
        ),
        ("walk a metre while waving, then stop waving and walk a metre", ["walk with wave-right-hand", "walk"]),
        ("raise your hand and walk", ["raise-up-right-hand", "walk"]),
        ("with your left hand, wave", ["wave-left-hand"]),
    ],
)
def test_no_half_of_a_sentence_is_lost(hearing: Hearing, say: str, does: list[str]) -> None:
    """Only the hands, or only the feet, of these were moved, and nothing was told."""
    assert motions(hear(hearing, say)) == does


@pytest.mark.parametrize(
    ("say", "dropped"),
    [
        ("walk while waving slowly", "slowly"),
        ("walk while waving like a child", "like a child"),
        ("walk nodding and waving", "waving"),
        ("walk with your head turned to the left", "with your head turned to the left"),  # walked to the left
    ],
)
def test_how_a_gesture_is_not_made_is_told(hearing: Hearing, say: str, dropped: str) -> None:
    heard = hear(hearing, say).heard
    assert heard.state == "partly" and heard.dropped == (dropped,) and str(heard.heard_as).startswith("walk")


def test_a_manner_behind_a_posture_is_that_of_the_walk(hearing: Hearing) -> None:
    """It was taken for a part of the posture, and lost."""
    heard = hear(hearing, "walk with your hands on your hips like an old man").heard
    assert heard.manner == "old" and heard.heard_as == "walk with hands-on-hips"


@pytest.mark.parametrize("say", ["keep waving", "don't stop waving", "keep walking", "don't stop walking", "go on"])
def test_what_goes_on_goes_on_whole(hearing: Hearing, say: str) -> None:
    """The walk ended, or the wave."""
    assert motions(hear(hearing, say, after="walk while waving")) == ["walk with wave-right-hand"]


@pytest.mark.parametrize("say", ["for two metres", "ten steps", "for three seconds"])
def test_an_amount_that_comes_later_is_of_both(hearing: Hearing, say: str) -> None:
    (step,) = hear(hearing, say, after="walk while waving").steps
    assert step.amount is not None and step.told.beside == "wave-right-hand" and step.beside is not None


def test_one_hand_is_lowered_and_the_other_stays(hearing: Hearing) -> None:
    """Both hands came down."""
    assert motions(hear(hearing, "lower your left hand", after="walk with raised hands")) == [
        "walk with raise-up-right-hand"
    ]
    heard = hear(hearing, "lower your left hand", after="walk while waving").heard
    assert heard.state == "refused" and "does not raise the left hand; it goes on" in str(heard.reason)


@pytest.mark.parametrize(
    ("say", "does"),
    [
        ("the other hand", "walk with wave-left-hand"),
        ("nod at the same time", "walk with nod"),
        ("also nod", "walk with nod"),
        ("nod as well", "walk with nod"),
        ("with raised hands", "walk with raise-up-both-hands"),
    ],
)
def test_the_gesture_changes_and_the_walk_goes_on(hearing: Hearing, say: str, does: str) -> None:
    """The walk ended."""
    assert motions(hear(hearing, say, after="walk while waving")) == [does]


@pytest.mark.parametrize("way", [Heading(1.0), Waypoint(1.0, 0.0)])
def test_a_gesture_comes_to_a_way_to_a_place_and_to_a_measured_turn(hearing: Hearing, way: Heading | Waypoint) -> None:
    """The words "wave at the same time" replaced the way, and "stop waving" ended a measured turn."""
    goes = hearing(way)
    waves = hearing(Text("wave at the same time"), goes, goes)
    assert waves.steps[0].goal == way and waves.steps[0].told.beside == "wave-right-hand"
    turns = hear(hearing, "turn left 90 degrees while waving")
    (step,) = hearing(Text("stop waving"), turns, turns).steps
    assert step.is_led and step.amount == turns.steps[0].amount and step.beside is None


@pytest.mark.parametrize("say", ["slower", "like an old man", "the other way", "again"])
def test_a_gesture_outlives_changes_of_the_walk(hearing: Hearing, say: str) -> None:
    program = hear(hearing, say, after="walk while waving")
    assert program.heard.state != "refused" and program.steps[0].told.beside == "wave-right-hand"
    assert program.steps[0].beside is not None


@pytest.mark.parametrize(
    ("after", "say"),
    [
        ("walk while waving", "halt stop waving"),
        ("walk while waving", "stand still stop waving"),
        ("walk while waving", "don't move stop waving"),
        ("walk while waving", "he should stop waving"),
        ("walk while waving", "stop to wave at me"),
        ("walk while waving", "stop hands up"),
        ("walk while waving", "keep waving while standing still"),
        ("walk while waving", "keep waving where you are"),
        ("walk while waving", "keep waving in place"),
        ("walk while waving", "also nod where you are"),
        ("walk", "keep your hands up and stand still"),
        ("walk", "with your hands on your hips stand still"),
        ("walk", "nod too while standing still"),
    ],
)
def test_whatever_else_is_said_of_a_gesture_ends_the_walk(hearing: Hearing, after: str, say: str) -> None:
    """The walk went on, though a stand, a place or a stop was said as well."""
    assert not any(step.moves for step in hear(hearing, say, after=after).steps)


@pytest.mark.parametrize("say", ["stop waving", "don't wave", "no more waving"])
@pytest.mark.parametrize("after", ["walk while waving with your left hand", "walk while waving with both hands"])
def test_the_end_of_a_gesture_is_that_of_any_hand(hearing: Hearing, say: str, after: str) -> None:
    """Only that of the right hand ended: words without a side are heard as of the right one."""
    assert motions(hear(hearing, say, after=after)) == ["walk"]
    assert motions(hear(hearing, "keep waving", after=after)) == motions(hear(hearing, after))
    assert motions(hear(hearing, "stop waving your right hand", after="walk while waving with your left hand")) == [
        "stand"
    ]


def test_what_is_said_behind_an_amount_counts(hearing: Hearing) -> None:
    """A prohibition, and another gesture, were lost: the wave went on."""
    for say, does in (
        ("without waving", "walk"),
        ("while nodding", "walk with nod"),
        ("", "walk with wave-right-hand"),
    ):
        program = hear(hearing, f"for two metres {say}".strip(), after="walk while waving")
        assert motions(program) == [does] and program.steps[0].amount is not None


def test_an_end_behind_while_is_asked_for_in_order(hearing: Hearing) -> None:
    """The words "wave while walking and stop" walked without an end, "walk while waving for two metres" too."""
    for say in ("wave while walking and stop", "walk while waving and stand still", "walk while waving and halt"):
        heard = hear(hearing, say).heard
        assert heard.state == "refused" and "say when, with 'then'" in str(heard.reason)
    (step,) = hear(hearing, "walk while waving for two metres").steps
    assert step.amount is not None and step.amount.quantity == "length"


def test_a_motion_that_the_model_lacks_is_refused_behind_a_posture_too() -> None:
    """The free bundle put its hands on its hips, and said nothing of the turn."""
    heard = hear(Hearing(Sampler(Bundle(bundle_folder("free"))), None), "hands on hips, turn left").heard
    assert heard.state == "refused" and "cannot turn left" in str(heard.reason)


STOPS = (
    *("halt", "freeze", "stop moving", "stand still", "don't move", "hold still", "wait", "stop walking", "no walking"),
    *("do not walk", "stay where you are", "come to a stop", "stop there", "no more walking", "quit walking"),
)
GESTURES = (
    *("waving", "wave", "your hands up", "nod", "raise your hand", "hands on hips", "stop waving", "keep waving"),
    *("keep your hands up", "wave at the same time", "also nod", "meanwhile wave", "the other hand", "lower your hand"),
)


@settings(deadline=None, max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    stop=st.sampled_from(STOPS),
    joint=st.sampled_from([" ", ", ", " and ", " while ", " with ", " then ", ". ", " but ", " as you "]),
    gesture=st.sampled_from(GESTURES),
    first=st.booleans(),
    walks=st.sampled_from(["walk while waving", "walk", "walk with raised hands"]),
)
def test_no_gesture_in_a_sentence_outweighs_a_stop(
    hearing: Hearing, stop: str, joint: str, gesture: str, first: bool, walks: str
) -> None:
    """Went wrong: 742 of 22,032 such sentences let the robot walk on ("keep waving as you halt")."""
    say = f"{stop}{joint}{gesture}" if first else f"{gesture}{joint}{stop}"
    assert not any(step.moves for step in hear(hearing, say, after=walks).steps), say


def test_a_stick_goes_on_beside_a_gesture_until_that_ends(hearing: Hearing) -> None:
    """A wave ended the walk of a stick, and the stick's next message, a tenth of a second later, the wave."""
    stick = hearing(Velocity(0.4, 0.0, 0.0))
    waves = hearing(Text("wave at the same time"), stick, stick)
    assert motions(waves) == ["velocity with wave-right-hand"]
    turns = hearing(Velocity(0.4, 0.0, 0.2), waves, waves)
    assert motions(turns) == [turns.heard.heard_as] == ["velocity with wave-right-hand"]
    assert turns.steps[0].beside == waves.steps[0].beside is not None
    assert motions(hearing(Velocity(0.0, 0.0, 0.0), turns, turns)) == ["velocity"], "a stick at rest is a stand"
    assert motions(hearing(Text("stop waving"), turns, turns)) == ["velocity"]
    assert motions(hearing(Velocity(0.4, 0.0, 0.0), hear(hearing, "walk while waving"), None)) == ["velocity"]


def test_a_walked_turn_with_both_arms_out_is_slower(hearing: Hearing) -> None:
    """A third of such turns of the perturbed robot fell within ten seconds."""
    (step,) = hear(hearing, "turn left with your arms out to the sides").steps
    assert isinstance(step.intent, Velocity) and step.intent.turning == pytest.approx(0.33, abs=0.01)
    assert "0.33 rad/s turning left, so that the robot can follow" in str(step.told.slowed)
    for say in ("turn left while waving", "walk with raised hands", "turn left on the spot with raised hands"):
        (other,) = hear(hearing, say).steps
        plain = hear(hearing, say.split(" w")[0]).steps[0]
        assert replace(other.intent, beside=None) == plain.intent, say


def test_a_measured_turn_is_led_with_its_gesture(hearing: Hearing) -> None:
    (step,) = hear(hearing, "turn left 90 degrees while waving").steps
    assert step.is_led and isinstance(step.begins, Text) and step.begins.beside == step.beside is not None


def test_the_human_walks_and_waves(sampler: Sampler) -> None:
    """From the words to the motion: as far as without the wave, one hand up and moving, the other arm swinging."""

    def made(words: str) -> tuple[float, np.ndarray]:
        motion = ModelSource(sampler, [Item(0.0, Text(words))], words, 1).window(0, round(4.0 * sampler.fps))
        assert motion is not None
        human = forward(motion)
        up = human.wrist[..., 2] - human.shoulder[..., 2]
        return float(np.hypot(*(motion.root_position[-1, :2] - motion.root_position[0, :2]))), up

    (plain, _), (way, up) = made("walk"), made("walk while waving with your left hand")
    assert way == pytest.approx(plain, rel=0.15)
    left, right = up[round(1.5 * sampler.fps) :].T
    assert left.min() > -0.1 and np.ptp(left) > 0.02, "the left hand waves"
    assert right.max() < -0.2, "the right one does not"


def test_a_gesture_goes_on_where_the_walk_changes(sampler: Sampler) -> None:
    """It would have begun anew, from a hanging arm, with every "slower"."""
    source = ModelSource(sampler, [Item(0.0, Text("walk with your right hand up"))], "walk", 1)
    made, gesture = source.window(0, 60), source._gesture
    assert made is not None
    source.turn_to(Target(1, 1, Text("slower")), 50, made[41:51])
    after = source.window(51, 60)
    assert after is not None
    assert source._gesture is gesture is not None, "the gesture is the same one"
    human = forward(after)
    assert (human.wrist[:, 1, 2] > human.shoulder[:, 1, 2]).all(), "the hand stays up"


def test_the_same_seed_makes_the_same_motion(sampler: Sampler) -> None:
    def made() -> np.ndarray:
        motion = ModelSource(sampler, [Item(0.0, Text("walk while waving"))], "walk", 3).window(0, 60)
        assert motion is not None
        return motion.joints

    np.testing.assert_array_equal(made(), made())
