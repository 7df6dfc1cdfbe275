"""What a person reads in a terminal of answers and of the status."""

from __future__ import annotations

import math

from flexmotion.streamer.commands.answer_text import answer_line, status_lines, stop_line
from flexmotion.streamer.gateway.connection import StopAnswer
from flexmotion.streamer.gateway.messages import Answer
from flexmotion.streamer.gateway.status import Followed, Holds, Status
from flexmotion.streamer.motion.heard import HeardStep


def lines(**known: object) -> dict[str, str]:
    status = Status.model_validate({"robot": "op3", "driver": "sim", "loop": "ticks", "state": "HOLD"} | known)
    return {line[:18].strip(): line[18:] for line in status_lines(status.model_dump(mode="json"))}


def test_a_refusal_says_why_first_and_names_no_tick() -> None:
    """It read "refused, from tick 4315, 'fly' is not understood"."""
    told = answer_line(Answer(state="refused", reason="'fly' is not understood", heard_as="stand", tick=4315))
    assert told == "refused: 'fly' is not understood"


def test_what_was_heard_how_surely_and_what_differs() -> None:
    told = Answer(state="slowed", heard_as="walk-left", certainty=0.62, slowed="0.18 m/s", tick=7, dropped=("a song",))
    assert (
        answer_line(told) == "slowed: heard as walk-left (62 % sure); slowed to 0.18 m/s; not done: a song; from tick 7"
    )
    assert answer_line(Answer(state="accepted", heard_as="wave", certainty=1.0)) == "accepted: heard as wave"
    assert answer_line(Answer(state="superseded", reason="a newer target came first")).endswith(
        ": a newer target came first"
    )


def test_a_stop_says_what_the_robot_does_and_how_to_go_on() -> None:
    told = stop_line("estop", StopAnswer(asked="estop", state="accepted", tick=12))
    assert told.startswith("accepted before tick 12: the robot stops, parks") and "flexmotion arm" in told
    assert stop_line("stop", StopAnswer(asked="stop", state="refused", reason="the loop did not take it")) == (
        "refused: the loop did not take it"
    )


def test_the_status_is_for_a_person_to_read() -> None:
    """It printed the lists of the JSON: "odometry [0.0793, -0.0521, -0.6089]", "limp []", "cause none"."""
    follows = Followed(
        source="page 3f", asked={"velocity": [0.3, 0.0, -0.5]}, heard_as="velocity", slowed=None, target=3, tick=9
    )
    told = lines(
        time_s=68.0,
        odometry=(0.0793, -0.0521, -0.6089),
        tilt=(-0.0032, 0.1745),
        hottest=26.0,
        supply=12.0,
        missed_deadlines=0,
        following=follows,
        operator="page 3f",
        counts={"received": 3, "accepted": 2, "refused": 1},
        ways={"stop process": "works"},
    )
    assert told == {
        "robot": "op3 on sim, for 68.0 s",
        "state": "HOLD",
        "follows": "velocity 0.3 0 -0.5, of page 3f",
        "operator": "page 3f",
        "place": "0.08 m ahead, 0.05 m right, turned 35° right",
        "torso": "tilted 10.00° forward, 0.18° left",
        "hottest servo": "26 °C",
        "supply": "12 V",
        "missed deadlines": "0",
        "messages": "3, accepted 2, refused 1",
        "stop process": "works",
    }


def test_the_status_names_what_holds_and_answers_tell_a_step_from_a_foot_that_is_kept_down() -> None:
    """Both were "heard as left foot", and the status said nothing of either."""
    kept = Answer(state="accepted", asked="contact", part="left foot", heard_as="left foot")
    step = Answer(state="accepted", asked="foot", part="place of left foot", heard_as="left foot")
    words = Answer(state="accepted", asked="text", part="left foot", heard_as="left foot")
    told = [answer_line(answer) for answer in (kept, step, words)]
    assert told == [
        "accepted: left foot kept down",
        "accepted: a step of the left foot",
        "accepted: heard as left foot",
    ]
    holds = {
        "target": 3,
        "source": "a",
        "restricts": False,
        "there": None,
        "missed": None,
        "slowed": None,
        "moved": None,
    }
    hand = Holds.model_validate(holds | {"asked": "left hand to [0.1, 0.1, 0] m in 1 s", "parts": ["left hand"]})
    foot = Holds.model_validate(holds | {"asked": "keep left foot down", "parts": ["left foot"], "restricts": True})
    there = hand.model_copy(update={"there": "0.3 cm from there", "parts": ("right hand",)})
    away = hand.model_copy(update={"missed": "25.0 cm from there", "parts": ("head",), "source": None})
    found = lines(holding=(hand, foot, there, away))
    assert found["head"] == "left hand to [0.1, 0.1, 0] m in 1 s: not there: 25.0 cm from there"
    assert found["left hand"] == "left hand to [0.1, 0.1, 0] m in 1 s, of a: on its way"
    assert found["left foot"] == "keep left foot down, of a: restricts"
    assert found["right hand"].endswith("of a: there, 0.3 cm from there")


def test_a_heading_is_told_within_half_a_turn() -> None:
    """A robot that had turned left by whole turns "turned 281° right", and ended at "heading -273°"."""
    told = lines(odometry=(0.0, 0.0, math.radians(-281.0)))
    assert told["place"].endswith("turned 79° left")
    step = HeardStep(text="heading 90°", heard_as="heading", place=(0.0, 0.0, math.radians(-273.0)))
    assert step.done.endswith("heading 87°")


def test_more_than_was_asked_is_told_as_more() -> None:
    """A robot that waved twice had done "2 times of 1 time"."""
    step = HeardStep(text="wave", heard_as="wave-right-hand", amount=1.0, unit="times", measured=2.0)
    assert step.done == "2 times, 1 asked for"
    assert step.model_copy(update={"measured": 1.0}).done == "1 time of 1 time"


def test_the_status_says_why_targets_are_refused_and_how_a_target_ended() -> None:
    stopped = lines(must_stop=True)
    assert "flexmotion clear" in stopped["targets"] and stopped["follows"].startswith("nothing")
    assert lines(state="OFF", must_stop=True)["targets"] == stopped["targets"], "a stop without torque was not told of"
    limp = lines(state="READY", must_stop=True, limp=("l_el",))
    assert limp["limp joints"] == "l_el" and "targets" not in limp
    fault = lines(state="FAULT", cause="e-stop: frozen by an operator", must_stop=True)
    assert fault["cause"] == "e-stop: frozen by an operator" and "targets" not in fault
    known = {"source": "a", "heard_as": "wave-right-hand", "slowed": None, "target": 1, "tick": 2, "end": "done"}
    ended = lines(following=Followed.model_validate(known | {"asked": {"text": "wave"}}))
    assert ended["follows"] == 'nothing: it stands; over (done): "wave", heard as wave-right-hand, of a'
    assert lines(loop="silent", state=None)["state"] == "the loop does not run; it was never started"


def test_a_velocity_that_expired_is_told_as_over() -> None:
    """In HOLD it was told as "follows velocity 0.3 0 0 ...; ended: expired"."""
    known = {"source": "a", "heard_as": "velocity", "slowed": None, "target": 1, "tick": 2, "end": "expired"}
    asked = {"velocity": {"forward": 0.3, "left": 0.0, "turning": 0.0}}
    found = lines(state="HOLD", following=Followed.model_validate(known | {"asked": asked}))["follows"]
    assert found.startswith("nothing: it stands; over (expired): velocity forward 0.3")


def test_a_place_and_a_heading_are_told_in_metres_and_degrees() -> None:
    """The status read "waypoint 1 0 None 0.1" and "heading 1.5708"."""
    known = {"source": "a", "heard_as": "waypoint", "slowed": None, "target": 1, "tick": 2}
    told = lines(following=Followed.model_validate(known | {"asked": {"waypoint": [1.0, 0.0, None, 0.1]}}))
    assert told["follows"] == "waypoint 1 m ahead, 0 m left, of a"
    known["heard_as"] = "heading"
    told = lines(following=Followed.model_validate(known | {"asked": {"heading": [math.pi / 2]}}))
    assert told["follows"] == "heading 90°, of a"


def test_a_run_that_mirrors_says_whom_and_how_it_goes_on() -> None:
    """After a stop it read "nothing: it stands", while frames of a person kept coming."""
    assert "mirrors" not in lines()
    assert lines(mirrors="a person")["mirrors"] == "the person who is seen"
    assert lines(mirrors="nobody")["mirrors"] == "nobody: nobody is seen"
    for state in ("waits", "not yet"):
        assert "flexmotion send mirror" in lines(mirrors=state)["mirrors"]


def test_what_a_robot_that_follows_nothing_does_is_said_and_not_left_open() -> None:
    """It read "it stands, or its torque is off", whatever the state."""
    assert lines(state="OFF")["follows"] == lines(state="FAULT")["follows"] == "nothing: its torque is off"
    assert lines(state="HOLD")["follows"] == "nothing: it stands"
    # Six minutes after it had been armed it still read "it stands up, then stands".
    assert lines(state="READY", ready=False)["follows"] == "nothing: it stands up"
    assert lines(state="READY", ready=True)["follows"] == "nothing: it stands"
    assert lines(loop="silent", state=None)["follows"] == "nothing"
