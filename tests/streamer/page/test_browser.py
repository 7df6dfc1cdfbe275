"""The page in a real browser, in states that a test chooses: read, reached, and honest about what it knows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from flexmotion.configs.robot import load_robot

from .stand_in import StandIn, browser_page

PHONE, DESK = {"width": 390, "height": 780}, {"width": 1280, "height": 800}
STATES = {
    "OFF": "torque off",
    "STREAMING": "moving",
    "PARK": "parking",
    "FAULT": "fault, torque off",
    "HOLD": "stopped",
}
ACCESS = Path(__file__).with_name("page_access.js")
"""What WCAG 2.2 AA asks of a page: contrast of its texts (1.4.3), names of its controls (4.1.2), their size in pixels
(2.5.8), contrast of the edges of its fields (1.4.11), and that the keyboard reaches them (2.1.1)."""


@pytest.fixture(scope="module", params=[PHONE, DESK], ids=["phone", "desk"])
def tab(request: pytest.FixtureRequest) -> Iterator[StandIn]:
    with browser_page(viewport=request.param, color_scheme="light") as page:
        shown = StandIn(page, load_robot("op3"))
        shown.clips = ("bow.bvh", "walk.bvh")
        shown.open()
        yield shown


@pytest.fixture
def run(tab: StandIn) -> StandIn:
    """A run that stands, and its page."""
    tab.stops_answer = True
    tab.asked.clear()
    tab.pressed.clear()
    tab.picture()
    tab.figures()
    tab.status("READY")  # whatever was before is over
    tab.status("HOLD")
    tab.until(lambda: tab.page.inner_text("#state") == "standing", "the page to show the state")
    return tab


def test_every_text_can_be_read_and_every_control_reached(run: StandIn) -> None:
    """A placeholder had too little contrast in the dark, and what scrolls could not be reached by keys."""
    page = run.page
    page.fill("#prompt", "juggle five balls")
    page.press("#prompt", "Enter")
    run.until(lambda: run.asked, "the prompt to be sent")
    run.answer(state="refused", reason="'juggle five balls' is not understood; " + "it knows: walk, wave, bow, " * 9)
    run.event("fault", "l_knee: hardware error 0x20", "Let it cool, then `flexmotion servo reboot`.")
    run.until(lambda: "hardware error" in page.inner_text("#alarm"), "the alarm")
    page.evaluate("() => document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    for _ in ("light", "dark"):
        for state, shown in STATES.items():
            run.status(state, operator="another", must_stop=state == "HOLD")
            run.until(partial(lambda words: page.inner_text("#state") == words, shown), "the state")
            found = page.evaluate(ACCESS.read_text(encoding="utf-8").partition("\n")[2])
            assert found == {"contrast": [], "names": [], "small": [], "edges": [], "unreachable": []}, state
        page.click("#theme")
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    assert not run.problems


def test_the_stops_stay_in_their_place(run: StandIn) -> None:
    """Buttons that came and went moved STOP away from under a thumb."""
    page, places = run.page, set()
    for state, must_stop in (("OFF", False), ("HOLD", False), ("HOLD", True), ("STREAMING", False), ("FAULT", True)):
        run.status(state, must_stop=must_stop)
        page.evaluate("() => scrollTo(0, document.body.scrollHeight)")
        for button in ("#stop", "#estop"):
            box = page.locator(button).bounding_box()
            assert box is not None and box["height"] >= 44.0
            assert box["y"] >= 0.0 and box["y"] + box["height"] <= page.viewport_size["height"]  # type: ignore[index]
        places.add(tuple(page.locator("#stop").bounding_box().values()))  # type: ignore[union-attr]
        page.evaluate("() => scrollTo(0, 0)")
    assert len(places) == 1


def test_a_stop_that_nobody_takes_is_told(run: StandIn) -> None:
    """A STOP that reached neither the stop process nor the gateway looked like any other."""
    page = run.page
    page.keyboard.press("Escape")
    run.until(lambda: run.pressed == ["stop"], "STOP to reach the stop process")
    assert page.locator("#alarm").is_hidden()
    run.stops_answer = False
    page.get_by_role("button", name="EMERGENCY STOP").click()
    run.until(lambda: page.locator("#alarm").is_visible(), "the page to say that nobody took it")
    assert run.asked[-1]["type"] == "estop"  # the gateway was asked too
    assert "no answer" in page.inner_text("#alarm") and "supply" in page.inner_text("#alarm")
    run.stops_answer = True

    def taken() -> bool:
        page.get_by_role("button", name="EMERGENCY STOP").click()
        page.wait_for_timeout(200)
        return page.locator("#alarm").is_hidden()

    run.until(taken, "the alarm to go, now that it was taken")  # a slow machine may need more than one press
    assert page.inner_text("#note") == "EMERGENCY STOP received"


def test_a_click_on_the_floor_asks_first_and_goes_to_that_place(run: StandIn) -> None:
    """The page had no way to send a waypoint. The odometry is not the world that is drawn."""
    page = run.page
    run.status("HOLD")
    run.picture(odometry=(2.0, -1.0, math.pi / 2))
    run.until(lambda: page.evaluate("() => window.flexmotion.scene.odometry[0] === 2"), "the picture")
    box = page.locator("#scene").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 0.8 * box["width"], box["y"] + 0.6 * box["height"])
    chosen = page.evaluate("() => window.flexmotion.floor.chosen")
    page.wait_for_timeout(50)
    assert not run.asked  # a stray tap moves nothing
    page.get_by_role("button", name="Walk here").click()
    run.until(lambda: run.asked, "the waypoint to be sent")
    # In this odometry the robot looks along y.
    x, y = run.asked[-1]["position_m"]
    assert run.asked[-1]["type"] == "waypoint"
    assert (y + 1.0, 2.0 - x) == pytest.approx((chosen["ahead"], chosen["left"]), abs=2e-3)
    assert math.hypot(chosen["ahead"], chosen["left"]) > 0.05
    run.answer(state="accepted", target=7)
    run.until(lambda: "accepted" in page.inner_text("#history"), "the answer")
    assert page.evaluate("() => window.flexmotion.scene.marked.visible")
    run.status("HOLD", target=7, following={"target": 7, "end": "done"})
    run.until(lambda: not page.evaluate("() => window.flexmotion.scene.marked.visible"), "the mark to go on arrival")


def test_no_place_is_offered_to_a_robot_that_cannot_walk(run: StandIn) -> None:
    """The button to walk stood beside the one that clears the fault."""
    box = run.page.locator("#scene").bounding_box()
    assert box is not None
    run.page.mouse.click(box["x"] + 0.8 * box["width"], box["y"] + 0.6 * box["height"])
    run.until(lambda: run.page.locator("#go").is_visible(), "the place to be offered")
    run.status("FAULT")
    run.until(lambda: run.page.locator("#go").is_hidden(), "the offer to go")
    assert "off" in (run.page.get_attribute("#stick", "class") or "")


def test_a_drag_turns_the_view_and_chooses_no_place(run: StandIn) -> None:
    box = run.page.locator("#scene").bounding_box()
    assert box is not None
    run.page.mouse.move(box["x"] + 0.8 * box["width"], box["y"] + 0.6 * box["height"])
    run.page.mouse.down()
    run.page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.6 * box["height"], steps=5)
    run.page.mouse.up()
    assert run.page.locator("#go").is_hidden()


def test_a_place_in_metres_and_a_clip_are_sent_by_keys_alone(run: StandIn) -> None:
    page = run.page
    page.evaluate("() => { document.querySelector('.ask details:not(#history *)').open = true; }")
    page.fill("#ahead", "0.4")
    page.fill("#left", "-0.2")
    page.press("#left", "Enter")
    run.until(lambda: run.asked, "the waypoint to be sent")
    assert run.asked[-1]["position_m"] == pytest.approx([0.4, -0.2], abs=1e-3)
    page.select_option("#clip", "walk.bvh")
    page.get_by_role("button", name="Play").press("Enter")
    run.until(lambda: len(run.asked) == 2, "the clip to be sent")
    assert run.asked[-1]["type"] == "clip" and run.asked[-1]["clip"] == "walk.bvh"


def test_a_page_that_lost_its_run_says_so(run: StandIn) -> None:
    """The last picture looked as if it were the robot now. (Last of this file: nothing connects again.)"""
    page = run.page
    run.lose()
    run.until(lambda: "No connection" in page.inner_text("#alarm"), "the page to say it")
    assert "old" in page.inner_text("#alarm") and page.locator("#arm").is_hidden()
    page.get_by_role("button", name="STOP", exact=True).click()
    run.until(lambda: run.pressed == ["stop"], "STOP to reach the stop process all the same")
    assert not run.problems
