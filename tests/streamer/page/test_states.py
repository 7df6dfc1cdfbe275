"""What the page says and offers in each state of a run, in a real browser of several sizes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.streamer.page.advice import advice

from .stand_in import StandIn, browser_page

ACROSS = ((844, 390), (932, 430), (568, 320))
"""Sizes of phones that are held across [pixels]."""
UPRIGHT = ((390, 844), (320, 568))
DESK: Any = {"width": 1280, "height": 800}
PHONE: Any = {"width": 390, "height": 844}
CAUSE = "e-stop: frozen by an operator"
REASON = (
    "'fly to the moon' is not understood by this model, it stands still; try: walk, bow, wave right hand; "
    "it can: stand, walk, turn left, turn right, bow, jump, … (flexmotion bundles lists all 41)"
)
"""As `PromptReader` says it."""
HEAD = """() => {
  const { scene } = window.flexmotion, box = scene.canvas.getBoundingClientRect();
  scene.scene.updateMatrixWorld();
  const head = scene.measured.bodies[scene.robot.bodies.indexOf("head_tilt_link")];
  const seen = head.getWorldPosition(scene.camera.position.clone()).project(scene.camera);
  return box.top + (0.5 - 0.5 * seen.y) * box.height;
}"""
"""Height of the robot's head on the page [pixels]."""
PICTURE_KNOWS = """() => {
  const alarm = document.getElementById("alarm");
  return window.flexmotion.scene.covered === alarm.offsetTop + alarm.offsetHeight;
}"""
"""Whether the picture makes room for the panel as it is now: the browser tells it after the next layout."""


@pytest.fixture(scope="module")
def tab() -> Iterator[StandIn]:
    with browser_page(viewport=PHONE, color_scheme="light") as page:
        shown = StandIn(page, load_robot("op3"))
        shown.open()
        yield shown


@pytest.fixture
def run(tab: StandIn) -> StandIn:
    """A run that stands, and its page, on a phone that is held upright."""
    tab.page.set_viewport_size(PHONE)
    tab.asked.clear()
    tab.pressed.clear()
    tab.picture()
    tab.status("READY")  # whatever was before is over
    tab.status("HOLD")
    tab.until(lambda: tab.page.inner_text("#state") == "standing", "the page to show the state")
    return tab


def usable(run: StandIn, button: str) -> None:
    run.until(lambda: run.page.locator(button).is_enabled(), f"{button} to be offered")


def middle(run: StandIn, element: str) -> tuple[float, float]:
    box = run.page.locator(element).bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def hold_the_stick_ahead(run: StandIn) -> None:
    """Press it with the mouse, and wait for what it sends; `run.page.mouse.up()` lets it go."""
    x, y = middle(run, "#stick")
    mouse = run.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x, y - 60)
    run.until(lambda: run.asked, "a velocity")


def layout(run: StandIn) -> list[Any]:
    return [run.page.locator(one).bounding_box() for one in (".stage", "#prompt", "#stick", "#theme")]


# ------------------------------------------------------------ the way back from a stop


def test_the_second_half_of_a_double_tap_presses_nothing_else(run: StandIn) -> None:
    """The button to disarm came where that to release a stop had been: a double tap lowered the robot."""
    before = layout(run)
    run.status("HOLD", must_stop=True)
    usable(run, "#release")
    assert layout(run) == before
    place = middle(run, "#release")
    run.page.mouse.click(*place)
    run.until(lambda: run.asked, "the release to be asked for")
    run.answer(state="accepted")
    run.status("HOLD")
    run.until(lambda: run.page.locator("#alarm").is_hidden(), "the panel to go")
    assert layout(run) == before  # a suggestion had moved under the finger
    usable(run, "#disarm")
    run.page.mouse.click(*place)
    run.page.wait_for_timeout(50)
    assert [one["type"] for one in run.asked] == ["clear"]


@pytest.mark.parametrize("size", [PHONE, DESK], ids=["phone", "desk"])
def test_a_fault_is_cleared_and_the_robot_armed_at_two_places(run: StandIn, size: Any) -> None:
    """On a desk "Arm" came where "Clear fault" had been: a double click switched the torque on."""
    run.page.set_viewport_size(size)
    run.status("FAULT", cause=CAUSE)
    usable(run, "#clear")
    assert run.page.locator("#arm").is_visible() and run.page.locator("#arm").is_disabled()
    # The second step had no number: another button stands between the two.
    number = "() => getComputedStyle(document.getElementById('arm'), '::before').content"
    assert "counter" in run.page.evaluate(number)
    place = middle(run, "#clear")
    run.page.mouse.click(*place)
    run.until(lambda: run.asked, "the fault to be cleared")
    run.answer(state="accepted")
    # In the same moment in which the page learns that the robot may be armed, nothing can be pressed yet.
    status = {"type": "status", "loop": "ticks", "state": "OFF", "must_stop": False, "counts": {}, "target": 0}
    offered = run.page.evaluate(
        """(status) => {
          window.flexmotion.link.handlers.message(status);
          return ["clear", "arm"].filter((id) => !document.getElementById(id).disabled);
        }""",
        status,
    )
    assert offered == []
    usable(run, "#arm")
    run.page.mouse.click(*place)
    run.page.wait_for_timeout(50)
    assert [one["type"] for one in run.asked] == ["clear"]
    run.page.get_by_role("button", name="Arm", exact=True).click()
    run.until(lambda: [one["type"] for one in run.asked] == ["clear", "arm"], "the robot to be armed")
    run.answer(state="accepted")


def test_a_stop_without_torque_is_released_before_the_robot_is_armed(run: StandIn) -> None:
    """It was "received: the torque is off already", and "Arm" stood the robot up at once, for targets of all."""
    page = run.page
    run.status("OFF", must_stop=True)
    usable(run, "#release")
    assert page.locator("#arm").is_visible() and page.locator("#arm").is_disabled()
    assert "Release the stop, then arm" in page.inner_text("#alarm-text")
    assert page.get_attribute("#prompt", "placeholder") == "Torque is off: release the stop, then arm it"
    run.status("OFF")
    usable(run, "#arm")
    assert page.locator("#release").is_hidden()


def test_both_steps_back_are_shown_while_the_robot_lowers_itself(run: StandIn) -> None:
    """There was nothing to press and nothing that said what comes next."""
    told = {"headline": "Emergency stop pressed", "advice": "Look at `flexmotion status`."}
    run.send({"type": "event", "time_s": 3.0, "kind": "state", "message": f"STREAMING -> HOLD: {CAUSE}", **told})
    run.status("PARK", cause=CAUSE)
    run.until(lambda: run.page.locator("#clear").is_visible(), "the steps")
    assert run.page.inner_text("#alarm-title") == "Emergency stop pressed"
    assert run.page.inner_text("#alarm code") == "flexmotion status"  # backticks were shown as such
    assert run.page.locator("#clear").is_disabled() and run.page.locator("#arm").is_disabled()


def test_it_gets_up_only_after_a_fall_and_only_when_a_person_confirms_it(run: StandIn) -> None:
    fall = "fall: torso tilted past the robot's limit"
    run.status("FAULT", cause=CAUSE, gets_up_from="front")
    usable(run, "#clear")
    assert run.page.locator("#getup").is_hidden(), "it was parked, and has sunk onto its front"
    run.status("FAULT", cause=fall)
    run.page.wait_for_timeout(50)
    assert run.page.locator("#getup").is_hidden(), "it lies on its side"
    run.status("FAULT", cause=fall, gets_up_from="back")
    usable(run, "#getup")
    questions: list[str] = []
    run.page.once("dialog", lambda dialog: (questions.append(dialog.message), dialog.dismiss()))
    run.page.click("#getup")
    assert "gets up by itself" in questions[0] and run.asked == []
    run.page.once("dialog", lambda dialog: dialog.accept())
    run.page.click("#getup")
    run.until(lambda: run.asked, "it to be asked")
    assert run.asked[0]["type"] == "clear" and run.asked[0]["get_up"] is True
    run.status("GET_UP")
    run.until(lambda: run.page.locator("#getup").is_hidden(), "the button to go")
    assert run.page.locator("#clear").is_hidden() and run.page.locator("#arm").is_hidden()
    assert run.page.locator("#stop").is_enabled() and run.page.locator("#estop").is_enabled()


# ------------------------------------------------------------ everything in reach


@pytest.mark.parametrize("size", [*ACROSS, *UPRIGHT])
def test_a_phone_steers_and_recovers_without_scrolling(run: StandIn, size: tuple[int, int]) -> None:
    """Held across, half the stick and the button that clears a fault were below the edge."""
    page = run.page
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.evaluate("() => scrollTo(0, 0)")
    following = {"source": "another", "asked": {"text": "a sentence " * 20}, "target": 3}
    for state, known, needed in (
        ("STREAMING", {"following": following}, ("#stick", ".turns", "#following")),
        ("HOLD", {"must_stop": True}, ("#release",)),
        ("FAULT", {"cause": CAUSE}, ("#clear", "#arm")),
        ("HOLD", {}, ("#stick", ".turns", "#disarm", "#theme", "#prompt" if size in ACROSS else "#stick")),
    ):
        run.status(state, **known)
        for element in (*needed, "#stop", "#estop", "#state"):
            run.until(lambda element=element: page.locator(element).is_visible(), f"{element} in {state}")
            box = page.locator(element).bounding_box()
            assert box is not None
            assert box["x"] >= 0 and box["x"] + box["width"] <= size[0], (element, box)
            assert box["y"] >= 0 and box["y"] + box["height"] <= size[1], (element, box)
            reached = page.evaluate(
                "([element, x, y]) => Boolean(document.elementFromPoint(x, y)?.closest(element))",
                [element, *middle(run, element)],
            )
            assert reached, f"{element} is covered in {state}"
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")


@pytest.mark.parametrize("size", [*ACROSS, *UPRIGHT, (1280, 800)])
def test_the_robot_is_seen_below_what_to_do_next(run: StandIn, size: tuple[int, int]) -> None:
    """On a phone the panel of an emergency stop covered the robot but for its feet; held across, the switches too."""
    page = run.page
    page.set_viewport_size({"width": size[0], "height": size[1]})
    told = {"headline": "Emergency stop pressed", "advice": advice(f"PARK -> FAULT: {CAUSE}")}
    for state, known in (("OFF", {}), ("HOLD", {"must_stop": True}), ("FAULT", {"cause": CAUSE})):
        if state == "FAULT":
            run.send({"type": "event", "time_s": 3.0, "kind": "fault", "message": f"PARK -> FAULT: {CAUSE}", **told})
        run.status(state, **known)
        run.until(lambda: page.locator("#alarm").is_visible(), f"the panel in {state}")
        run.until(lambda: page.evaluate(PICTURE_KNOWS), "the picture to know of it")
        head = page.evaluate(HEAD)
        alarm, legend = page.locator("#alarm").bounding_box(), page.locator(".legend").bounding_box()
        assert alarm is not None
        assert head > alarm["y"] + alarm["height"], (state, head, alarm)
        apart = legend is None or legend["y"] + legend["height"] <= alarm["y"]
        assert apart, f"the panel covers the switches in {state}"
    run.status("READY")
    run.until(lambda: page.evaluate("() => window.flexmotion.scene.covered === 0"), "the picture to be whole again")


def test_the_answer_is_seen_on_a_phone_that_is_held_across(run: StandIn) -> None:
    """The suggestions took four rows: what was refused, and why, was below the edge."""
    page = run.page
    page.set_viewport_size({"width": ACROSS[0][0], "height": ACROSS[0][1]})
    page.fill("#prompt", "climb the stairs")
    page.press("#prompt", "Enter")
    run.until(lambda: run.asked, "the prompt to be sent")
    run.answer(state="refused", reason=REASON)
    run.until(lambda: page.locator("#history .why").first.is_visible(), "the answer")
    box = page.locator("#history .why").first.bounding_box()
    assert box is not None and box["y"] + box["height"] <= ACROSS[0][1]
    assert page.locator("#suggestions button").last.is_visible()  # a swipe away


# ------------------------------------------------------------ what the robot does


def test_a_stick_that_is_held_is_never_replaced(run: StandIn) -> None:
    """Of ten velocities a second many are replaced by the next; the history said so while the robot walked."""
    page = run.page
    hold_the_stick_ahead(run)
    run.heard(21, "velocity [0.5, 0.0, 0.0]", "superseded", reason="a newer target came before a plan followed it")
    run.heard(22, "velocity [0.5, 0.0, 0.0]", "accepted", heard_as="velocity", at_s=30.0, reason="goes on as before")
    following = {"source": run.asked[-1]["source"], "asked": {"velocity": [0.5, 0.0, 0.0]}, "target": 22}
    run.status("STREAMING", following=following)
    run.heard(23, "velocity [0.5, 0.0, 0.0]", "superseded")
    run.until(lambda: page.inner_text("#following") == "by stick: ahead", "the label")
    assert page.inner_text("#history li:first-child").split() == ["stick", "accepted"]
    page.mouse.up()
    run.until(lambda: run.asked[-1]["velocity"] == [0, 0, 0], "the stick to be released")
    run.status("STREAMING", following={**following, "asked": {"velocity": [0.0, 0.0, 0.0]}})
    run.until(lambda: page.inner_text("#following") == "coming to a stand", "the label of a released stick")


def test_the_label_is_what_is_followed_and_not_what_was_asked(run: StandIn) -> None:
    """An older sentence was shown while the stick was held, and "faster" after a refusal, of a robot that stood."""
    page = run.page
    run.heard(31, "walk forward", "accepted", heard_as="walk", at_s=31.0)
    run.status("STREAMING", following={"source": "me", "asked": {"text": "walk forward"}, "heard_as": "walk"})
    run.until(lambda: page.inner_text("#following") == "“walk forward”", "the label")
    run.heard(32, "fly to the moon", "refused", reason=REASON, at_s=32.0)
    run.status("STREAMING", following=None)
    run.until(lambda: page.inner_text("#following") == "", "the label to go")
    run.status("STREAMING", following={"source": "me", "asked": {"stop": True}})
    run.until(lambda: page.inner_text("#following") == "coming to a stand", "the label of a stop")
    run.status("STREAMING", must_stop=True)
    run.until(lambda: page.inner_text("#state") == "stopping", "the state")  # it was "stopped" while it walked


def test_a_block_of_the_strip_ends_with_its_motion(run: StandIn) -> None:
    """A block went on through STOP, fault, torque off and a lost connection, and no stop was shown."""
    strip = "window.flexmotion.asked.strip"
    for second, kind, message in (
        (103.0, "request", "STOP"),
        (104.5, "state", "STREAMING -> HOLD"),
        (112.0, "request", "ESTOP"),
        (112.0, "state", f"STREAMING -> HOLD: {CAUSE}"),
        (113.0, "state", f"HOLD -> PARK: {CAUSE}"),
    ):
        run.send({"type": "event", "time_s": second, "kind": kind, "message": message})
    step = {"text": "walk", "heard_as": "walk", "amount": 2.0, "unit": "time", "end": "done", "end_s": 108.5}
    run.heard(41, "walk on", "accepted", at_s=101.0)
    run.heard(42, "walk 2 s", "accepted", at_s=106.0, steps=[step])
    run.heard(43, "wave", "accepted", at_s=110.0)
    run.until(lambda: "walk 2 s" in run.page.inner_text("#history"), "the answers")
    found = run.page.evaluate(
        f"() => {strip}.blocks(window.flexmotion.asked.entries, 130).filter(([one]) => one.at_s > 100)"
        ".map(([one, begin, end]) => [one.text, begin, end])"
    )
    assert found == [["walk on", 101, 103], ["walk 2 s", 106, 108.5], ["wave", 110, 112]]
    marks = run.page.evaluate(f"() => {strip}.marks.map((one) => [one.letter, one.at_s])")
    assert marks[-2:] == [["S", 103], ["E", 112]]
    assert "✓" in run.page.inner_text("#history .steps")


def test_a_note_of_the_run_covers_nothing(run: StandIn) -> None:
    """Notes in the list of messages looked like confirmations: they lay over the prompt for good."""
    page = run.page
    page.set_viewport_size(DESK)
    page.evaluate("() => { document.getElementById('events').closest('details').open = true; }")
    run.event("note", "'fly' is refused: it can do much else " * 5)
    run.event("note", "a second note")
    run.until(lambda: "a second note" in page.inner_text("#events"), "the messages")
    cards = page.locator("#events").bounding_box()
    assert cards is not None
    for one in page.locator("#events .note").all():
        box = one.bounding_box()
        assert box is not None and box["y"] >= cards["y"] and box["x"] >= cards["x"]
    x, y = middle(run, "#prompt")
    assert page.evaluate("([x, y]) => document.elementFromPoint(x, y).id", [x, y]) == "prompt"
    page.evaluate("() => { document.getElementById('events').closest('details').open = false; }")


def test_a_stick_that_a_stop_takes_away_sends_nothing_more(run: StandIn) -> None:
    """After every STOP with a held stick the history read "stop / refused": it sent the stand of a stick let go."""
    page = run.page
    hold_the_stick_ahead(run)
    run.status("STREAMING", must_stop=True)
    run.until(lambda: page.inner_text("#state") == "stopping", "the state")
    run.asked.clear()
    page.mouse.up()
    page.wait_for_timeout(300)
    assert run.asked == []


def test_a_stick_that_a_stop_took_away_can_be_held_again(run: StandIn) -> None:
    """The hand had selected what lies under the stick: the next press dragged that, and the stick let go at once."""
    hold_the_stick_ahead(run)
    run.status("STREAMING", must_stop=True)
    run.until(lambda: run.page.inner_text("#state") == "stopping", "the state")
    run.page.mouse.up()
    run.status("HOLD")
    run.until(lambda: run.page.inner_text("#state") == "standing", "the state after the stop")
    run.asked.clear()
    hold_the_stick_ahead(run)
    run.page.mouse.up()


def test_the_history_tells_how_each_ended(run: StandIn) -> None:
    """Entries stayed "accepted" for ever: also after a newer one, a stop, an emergency stop or a refusal ended them.

    A stick that was let go had an entry of its own, named "stop".
    """
    page = run.page

    def marks() -> list[list[str]]:
        texts = page.locator("#history li > b").all_inner_texts()
        return [list(pair) for pair in zip(texts, page.locator("#history li > .mark").all_inner_texts(), strict=True)]

    def happens(second: float, kind: str, message: str) -> None:
        run.send({"type": "event", "time_s": second, "kind": kind, "message": message})

    run.heard(201, "walk forward", "accepted", heard_as="walk", at_s=201.0)
    run.heard(202, "turn left", "accepted", heard_as="turn-left", at_s=203.0)
    run.heard(203, "left hand up", "accepted", heard_as="left hand", at_s=204.0)
    # Beside the turn, which it does not replace; STOP does not end it.
    run.heard(250, "soft arms", "accepted", heard_as="tension both arms", at_s=204.5)
    run.heard(204, "fly to the moon", "refused", reason=REASON, at_s=205.0)
    for number, asked in ((205, "velocity [0.5, 0.0, 0.0]"), (206, "velocity [0.4, 0.0, 0.0]"), (207, "stand still")):
        stick = {"type": "heard", "id": number, "source": "gamepad", "asked": asked, "state": "accepted"}
        run.send({**stick, "at_s": number + 5.0})
    run.heard(208, "march", "accepted", heard_as="march", at_s=214.0)
    happens(216.0, "request", "STOP")
    run.heard(209, "walk on", "accepted", heard_as="walk", at_s=220.0)
    happens(222.0, "request", "ESTOP")
    run.heard(210, "walk back", "accepted", heard_as="walk-back", at_s=230.0)
    expected = [
        ["walk back", "accepted"],
        ["walk on", "ended"],
        ["march", "stopped"],
        ["stick", "ended"],
        ["fly to the moon", "refused"],
        ["soft arms", "ended"],
        ["left hand up", "stopped"],
        ["turn left", "ended"],
        ["walk forward", "replaced"],
    ]
    run.until(lambda: marks()[: len(expected)] == expected, "how each ended")
    refused = page.locator("#history li", has_text="fly to the moon").first
    assert "It stopped turning." in refused.inner_text()  # it said "The robot stands still."
    happens(232.0, "state", "STREAMING -> HOLD")
    run.heard(211, "fly to mars", "refused", reason=REASON, at_s=235.0)
    run.until(lambda: marks()[:2] == [["fly to mars", "refused"], ["walk back", "ended"]], "the refusal")
    assert "The robot stands still." in page.locator("#history li").first.inner_text()


def test_a_robot_that_was_armed_stands_before_its_first_target(run: StandIn) -> None:
    """It was "ready", and stood only after the first target; six minutes later "it stands up" was still told."""
    run.status("READY", ready=False)
    run.until(lambda: run.page.inner_text("#state") == "standing up", "the state")
    run.status("READY", ready=True)
    run.until(lambda: run.page.inner_text("#state") == "standing", "the state")


def test_velocities_that_came_too_late_are_one_line(run: StandIn) -> None:
    """In a slow browser the messages filled with "target 233 is over after 0.5 s: coming to a stand"."""
    page = run.page
    hold_the_stick_ahead(run)
    for number in (233, 234, 235):
        run.event("note", f"target {number} is over after 0.5 s: coming to a stand")
    run.until(lambda: "3 times" in (page.text_content("#events") or ""), "the messages")
    page.mouse.up()
    told = page.text_content("#events") or ""
    assert told.count("came too late") == 1 and "is over after" not in told


# ------------------------------------------------------------ what can be asked


def test_the_answer_to_a_prompt_is_seen_on_a_phone(run: StandIn) -> None:
    """With clips to choose from it lay behind the stops, below the edge of the screen."""
    page = run.page
    page.evaluate("() => { document.getElementById('clips').hidden = false; }")
    page.fill("#prompt", "fly to the moon")
    page.press("#prompt", "Enter")
    run.until(lambda: run.asked, "the prompt to be sent")
    run.answer(state="refused", reason=REASON)
    entry = page.locator("#history li", has_text="fly to the moon").first.locator(".mark")
    run.until(lambda: entry.inner_text() == "refused", "the answer")
    # What to try instead was cut by the stops.
    tries, stops = page.locator("#history .chips").first, page.locator(".stops").bounding_box()
    boxes = [one.bounding_box() for one in (entry, tries)]
    page.evaluate("() => { document.getElementById('clips').hidden = true; scrollTo(0, 0); }")
    assert stops is not None and all(box is not None and box["y"] + box["height"] < stops["y"] for box in boxes)


def test_the_prompt_of_a_desk_stays_in_reach(run: StandIn) -> None:
    """The panel could be scrolled until the prompt was out of view."""
    run.page.set_viewport_size({"width": 1280, "height": 600})
    run.page.evaluate("() => document.querySelector('aside').scrollTo(0, 9999)")
    x, y = middle(run, "#prompt")
    top = run.page.evaluate("([x, y]) => document.elementFromPoint(x, y)?.id", [x, y])
    run.page.evaluate("() => document.querySelector('aside').scrollTo(0, 0)")
    assert top == "prompt"


def test_a_stop_is_released_by_the_operator_and_others_are_told_how(run: StandIn) -> None:
    """The button of a page that does not steer ended in: refused, it can be taken over by 'take'."""
    run.status("HOLD", must_stop=True, operator="another")
    run.until(lambda: "take over, then release it" in run.page.inner_text("#alarm-text"), "the advice")
    run.status("HOLD", must_stop=True)
    run.until(lambda: "take over" not in run.page.inner_text("#alarm-text"), "the advice to go")


def test_what_cannot_be_asked_now_cannot_be_pressed_and_says_why(run: StandIn) -> None:
    """Prompt and suggestions looked usable while the robot was stopped, in fault or without torque."""
    page = run.page
    for state, known, reason in (
        ("HOLD", {"must_stop": True}, "Stopped: release the stop first"),
        ("FAULT", {"cause": CAUSE}, "Fault: clear it first"),
        # It read "arm it then", which was refused: the fault has to be cleared before.
        ("PARK", {"cause": CAUSE}, "Fault: clear it once it has parked"),
        ("HOLD", {"cause": CAUSE, "must_stop": True}, "Fault: clear it once it has parked"),
        ("OFF", {}, "Torque is off: arm it first"),
        ("HOLD", {"operator": "another"}, "another steers: take over first"),
    ):
        run.status(state, **known)
        run.until(lambda reason=reason: page.get_attribute("#prompt", "placeholder") == reason, reason)
        assert page.is_disabled("#prompt") and page.is_disabled("#suggestions button >> nth=0")
        assert page.is_enabled("#stop") and page.is_enabled("#estop")
        x, y = middle(run, "#stick")
        page.mouse.click(x, y - 40)
        page.wait_for_timeout(50)
        assert not run.asked
    run.status("HOLD")
    run.until(lambda: page.is_enabled("#prompt"), "the prompt")
    page.click("#suggestions button >> nth=0")
    run.until(lambda: run.asked, "a suggestion to be sent")
    run.answer(state="accepted", target=50)


def test_an_emergency_stop_without_torque_is_confirmed(run: StandIn) -> None:
    """The press had no visible answer, as if nobody had taken it."""
    run.status("OFF")
    run.until(lambda: run.page.inner_text("#state") == "torque off", "the state")
    run.page.get_by_role("button", name="EMERGENCY STOP").click()
    told = "stays off until the fault is cleared"
    run.until(lambda: told in (run.page.text_content("#note") or ""), "the press to be confirmed")


def test_words_that_are_not_understood_offer_what_is(run: StandIn) -> None:
    """The help was a folded list of 23 names. (A list that was made anew ten times a second also lost the focus.)

    Since a reason names a few motions alone, the list is that of the run.
    """
    page = run.page
    run.heard(61, "fly to the moon", "refused", reason=REASON, at_s=361.0)
    entry = page.locator("#history li", has_text="fly to the moon").first
    run.until(lambda: entry.locator(".chips button").count() == 3, "motions to try")
    assert "stand, walk" not in entry.inner_text()
    assert "stand, walk, bow, wave right hand" in entry.locator("details").text_content(), "all, as the run lists them"
    entry.locator("summary").focus()
    for number in range(62, 66):
        run.heard(number, "velocity [0.5, 0.0, 0.0]", "accepted", at_s=300.0 + number)
    run.heard(66, "hello robot", "accepted", heard_as="wave-right-hand", certainty=0.51, at_s=366.0)
    run.until(lambda: "hello robot" in page.inner_text("#history"), "the answers")
    assert page.evaluate("() => document.activeElement.tagName") == "SUMMARY"
    # An answer of which the listener is not sure looked like any other.
    assert page.inner_text("#history li:first-child .mark") == "unsure"
    # The manner was told by the run's standard error alone.
    run.heard(67, "walk like grandpa", "accepted", heard_as="walk", manner="old", at_s=367.0)
    run.until(lambda: "heard as walk, old" in page.inner_text("#history"), "the manner")
    entry.get_by_role("button", name="bow").click()
    run.until(lambda: run.asked and run.asked[-1].get("text") == "bow", "the motion to be asked for")
    run.answer(state="accepted", target=68)


def test_a_page_that_is_opened_lists_nothing_that_nobody_typed(run: StandIn) -> None:
    run.send({"type": "heard", "item": 0, "asked": "stand still", "state": "accepted", "heard_as": "stand"})
    run.heard(70, "bow", "accepted", heard_as="bow", at_s=70.0)
    run.until(lambda: "bow" in run.page.inner_text("#history li:first-child"), "the answer")
    assert "stand still" not in run.page.inner_text("#history")
    assert not run.page.evaluate("() => document.querySelector('.wide-open').open")  # folded on a phone


def test_a_simulated_robot_that_is_set_up_again_did_not_walk_there(run: StandIn) -> None:
    """It jumped without a word, and its path was a straight line across the floor."""
    scene = "window.flexmotion.scene"
    run.status("OFF")
    run.until(lambda: run.page.inner_text("#state") == "torque off", "the state")
    run.picture(moved=(0.0, 0.0))
    run.picture(moved=(0.9, 0.4))
    run.until(lambda: "somebody picked the robot up" in (run.page.text_content("#note") or ""), "the page to say it")
    # It lay over the history, on a desk over the prompt.
    note, stage = run.page.locator("#note").bounding_box(), run.page.locator(".stage").bounding_box()
    drive = run.page.locator(".drive").bounding_box()
    assert note is not None and stage is not None and drive is not None
    assert note["x"] >= drive["x"] + drive["width"] and note["y"] >= stage["y"]
    assert note["y"] + note["height"] <= stage["y"] + stage["height"]
    points = run.page.evaluate(f"() => {scene}.path.map((one) => [one.x, one.y])")
    assert all(abs(x - 0.9) < 0.2 for x, _ in points)
    assert not run.problems


def test_a_page_that_is_loaded_again_is_the_same_operator(run: StandIn) -> None:
    """It was a stranger to itself: the robot walked on, and only "Take over" led back to the stick."""
    page = run.page
    name = page.evaluate("() => window.flexmotion.link.source")
    assert page.evaluate("() => sessionStorage.getItem('source')") is None  # a copy of the tab would take it along
    page.reload(wait_until="commit")
    run.until(lambda: page.evaluate("() => Boolean(window.flexmotion?.link.opened)"), "the page to connect again")
    assert page.evaluate("() => window.flexmotion.link.source") == name
