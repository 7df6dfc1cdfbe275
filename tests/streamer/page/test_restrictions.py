"""Restrictions on the page, in a real browser: what is sent, and how it is told."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.retarget.joint_names import joints_named

from .stand_in import StandIn, browser_page

DESK, PHONE = {"width": 1280, "height": 800}, {"width": 360, "height": 740}


@pytest.fixture
def viewport() -> dict[str, int]:
    return DESK


@pytest.fixture
def run(viewport: dict[str, int]) -> Iterator[StandIn]:
    with browser_page(viewport=viewport) as page:
        shown = StandIn(page, load_robot("op3"))
        shown.open()
        shown.status("HOLD")
        shown.until(lambda: page.is_enabled("#prompt"), "the prompt")
        page.click("summary:has-text('Keep feet down')")
        yield shown


def sent(run: StandIn, number: int) -> dict[str, Any]:
    """The message that was sent; it is answered as the target of this number."""
    run.until(lambda: run.asked, "a message")
    (message,) = run.asked
    run.answer(state="accepted", target=number)
    run.asked.clear()
    return {key: value for key, value in message.items() if key not in ("id", "source", "sequence")}


@pytest.mark.parametrize("viewport", [DESK, PHONE], ids=["desk", "phone"])
def test_feet_are_kept_torques_capped_arms_softened_and_all_is_let_go(run: StandIn, viewport: dict[str, int]) -> None:
    """They could be asked for by programs and in words alone."""
    page = run.page
    page.select_option("#foot", "left")
    page.click("#keep button")
    assert sent(run, 50) == {"type": "contact", "foot": "left"}
    page.select_option("#capped", label="both knees")
    page.fill("#limit", "1.5")
    page.click("#cap button")
    assert sent(run, 51) == {"type": "torque", "joint": "knee", "limit_nm": 1.5}
    page.select_option("#limb", "right arm")
    page.click("#tense button")
    assert sent(run, 52) == {"type": "tension", "limb": "right arm", "tension": 0}
    page.click("#relax button")
    assert sent(run, 53) == {"type": "relax", "part": "all"}
    told = page.eval_on_selector_all("#history b", "found => found.map((one) => one.textContent)")
    assert told == [
        "let everything go",
        "let the right arm be soft",
        "no more than 1.5 N·m at both knees",
        "keep the left foot on the ground",
    ]
    assert page.evaluate("() => document.documentElement.scrollWidth") <= viewport["width"] and not run.problems


def test_what_holds_is_listed_and_each_is_let_go_by_itself(run: StandIn) -> None:
    """A walk was refused for a foot that was kept down long ago, and the page did not show it."""
    page = run.page
    assert page.is_hidden("#holding")
    usual = {"source": "a", "slowed": None, "moved": None, "there": None, "missed": None, "restricts": True}
    hand = usual | {"target": 3, "asked": "left hand to [0.1, 0.1, 0] m", "parts": ["left hand"], "restricts": False}
    cap = usual | {"target": 4, "asked": "no more than 2 N·m at knee", "parts": ["torque l_knee", "torque r_knee"]}
    run.status("HOLD", holding=[hand, cap])
    run.until(lambda: page.is_visible("#holding"), "what holds")
    lines = page.locator("#holding span").all_text_contents()
    assert lines == ["left hand to [0.1, 0.1, 0] m · on its way", "no more than 2 N·m at knee"]
    run.status("HOLD", holding=[hand | {"there": "0.3 cm from there"}, cap])
    run.until(lambda: "there" in page.locator("#holding span").first.text_content(), "the hand")
    page.click("#holding li:has-text('left hand') button")
    assert sent(run, 60) == {"type": "relax", "part": "left hand"}
    page.click("#holding li:has-text('knee') button")
    run.until(lambda: len(run.asked) == 2, "both caps")
    assert [message["part"] for message in run.asked] == ["torque l_knee", "torque r_knee"]
    run.status("HOLD", holding=[])
    run.until(lambda: page.is_hidden("#holding"), "nothing holds")
    assert not run.problems


@pytest.mark.parametrize("width", [360, 390, 412])
def test_the_button_of_a_restriction_is_beside_its_fields(run: StandIn, width: int) -> None:
    """The button "Cap" stood alone on a second line of a phone, and looked like the button of what follows."""
    page = run.page
    page.set_viewport_size({"width": width, "height": 780})
    for form in ("#keep", "#cap", "#tense"):
        boxes = [one.bounding_box() for one in page.locator(f"{form} > select, {form} > input, {form} > button").all()]
        assert len(boxes) >= 2 and len({round(box["y"]) for box in boxes if box}) == 1, (form, boxes)
        assert all(box is not None and box["x"] + box["width"] <= width and box["height"] >= 44.0 for box in boxes)


def test_every_joint_that_is_offered_is_one_that_a_run_understands(run: StandIn) -> None:
    names = run.page.eval_on_selector_all("#capped option", "found => found.map((one) => one.value)")
    assert len(names) == len(set(names)) == 15
    for name in names:
        assert joints_named(run.robot, name)


def test_a_cap_without_a_number_is_not_sent(run: StandIn) -> None:
    run.page.fill("#limit", "")
    run.page.click("#cap button")
    run.page.wait_for_timeout(100)
    assert not run.asked
