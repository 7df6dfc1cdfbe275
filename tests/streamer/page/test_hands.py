"""Hands that are dragged on the page, in a real browser: what is sent, how often, and what stays as it is."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.retarget.arm_chain import ArmChain

from .stand_in import StandIn, browser_page

DESK = {"width": 1280, "height": 800}
HANDLE = """(side) => {
  const { scene } = window.flexmotion, box = scene.canvas.getBoundingClientRect();
  scene.scene.updateMatrixWorld();
  const seen = scene.handles[side].getWorldPosition(scene.camera.position.clone()).project(scene.camera);
  return [box.left + (0.5 + 0.5 * seen.x) * box.width, box.top + (0.5 - 0.5 * seen.y) * box.height];
}"""


@pytest.fixture
def run() -> Iterator[StandIn]:
    with browser_page(viewport=DESK) as page:
        shown = StandIn(page, load_robot("op3"))
        shown.open()
        shown.status("HOLD")
        shown.until(lambda: page.evaluate("() => window.flexmotion.hands.allowed"), "the hands to be allowed")
        yield shown


def camera(run: StandIn) -> list[float]:
    return [float(one) for one in run.page.evaluate("() => window.flexmotion.scene.camera.position.toArray()")]


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_hand_that_is_dragged_is_sent_where_the_pointer_is(run: StandIn, side: str) -> None:
    chain, index, seen = ArmChain(run.robot), ("left", "right").index(side), camera(run)
    hand = chain.poses(run.robot.stand_pose[chain.joints]).hand[index]
    x, y = run.page.evaluate(HANDLE, index)
    run.page.mouse.move(x, y)
    run.page.mouse.down()
    run.page.mouse.move(x, y - 40)
    run.until(lambda: run.asked, "the place to be sent")
    message = run.asked[0]
    assert (message["type"], message["side"]) == ("hand", side) and message["ttl_s"] > message["in_s"]
    moved = np.array(message["position_m"]) - hand
    # Up on the screen is up at the robot; its camera looks a little down.
    assert moved[2] > 0.03 and np.linalg.norm(moved) < 0.3
    run.page.mouse.up()
    assert camera(run) == pytest.approx(seen, abs=1e-6)  # the view has not turned
    assert run.page.evaluate("() => window.flexmotion.floor.chosen") is None
    assert not run.problems


def test_a_drag_sends_the_newest_place_once_the_last_one_is_answered(run: StandIn) -> None:
    x, y = run.page.evaluate(HANDLE, 1)
    run.page.mouse.move(x, y)
    run.page.mouse.down()
    for step in range(1, 30):
        run.page.mouse.move(x + step, y - 2 * step)
    run.until(lambda: run.asked, "the first place")
    run.page.wait_for_timeout(300)  # several intervals: nothing more is sent before the answer
    assert len(run.asked) == 1
    run.answer(state="moved", moved="[0.1, -0.2, 0.1] m, 9.0 cm from there", target=4)
    run.until(lambda: len(run.asked) == 2, "the newest place")
    run.page.mouse.up()
    run.answer(state="accepted", target=5)
    run.heard(5, "right hand to [0.1, -0.2, 0.1] m in 0.25 s", "accepted")
    first, newest = (np.array(message["position_m"]) for message in run.asked)
    assert math.dist(first, newest) > 0.02
    run.until(lambda: "dragged" in run.page.inner_text("#history"), "the history to tell of it")
    run.until(lambda: run.page.inner_text("#history .mark") == "accepted", "the answer")
    assert run.page.locator("#history li").count() == 1
    assert not run.problems


def test_beside_the_hands_and_while_nothing_can_be_asked_a_drag_turns_the_view(run: StandIn) -> None:
    box = run.page.locator("#scene").bounding_box()
    assert box is not None
    x, y = run.page.evaluate(HANDLE, 0)
    for begin, must_stop in (((box["x"] + 60, box["y"] + 60), False), ((x, y), True)):
        run.status("HOLD", must_stop=must_stop)
        run.until(lambda: run.page.evaluate("() => window.flexmotion.hands.allowed") is not must_stop, "the state")  # noqa: B023
        seen = camera(run)
        run.page.mouse.move(*begin)
        run.page.mouse.down()
        run.page.mouse.move(begin[0] + 80, begin[1])
        run.page.mouse.up()
        run.until(lambda: math.dist(camera(run), seen) > 0.01, "the view to turn")  # noqa: B023
    assert not run.asked and not run.problems
