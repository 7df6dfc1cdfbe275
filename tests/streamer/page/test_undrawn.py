"""The page in a browser without WebGL (virtual machines, kiosks, blocked graphics drivers)."""

from __future__ import annotations

from flexmotion.configs.robot import load_robot

from .stand_in import WITHOUT_WEBGL, StandIn, browser_page


def test_without_webgl_the_robot_is_steered_all_the_same() -> None:
    """The page said "connecting" for good: three.js threw before it had connected."""
    with browser_page(WITHOUT_WEBGL, viewport={"width": 390, "height": 780}) as page:
        assert not page.evaluate("() => document.createElement('canvas').getContext('webgl2')")
        run = StandIn(page, load_robot("op3"))
        run.open()
        run.status("HOLD")
        run.until(lambda: page.inner_text("#state") == "standing", "the state")
        assert "WebGL" in page.inner_text("p.undrawn") and page.locator("#scene").is_hidden()
        assert page.locator(".legend").is_hidden() and "tap the floor" not in page.inner_text("#nothing")

        page.fill("#prompt", "wave")
        page.press("#prompt", "Enter")
        run.until(lambda: run.asked, "the prompt to be sent")
        run.answer(state="accepted", heard_as="wave-right-hand", target=1)
        run.until(lambda: "accepted" in page.inner_text("#history"), "the answer")
        run.figures()
        page.evaluate("() => document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        run.until(lambda: page.locator("#curves .curve").count() > 0, "the curves")
        run.until(lambda: "12.0 V" in page.inner_text("#body"), "the servos")
        # The place of the robot is known without a picture of it.
        run.picture(odometry=(2.0, -1.0, 0.0))
        run.until(lambda: page.evaluate("() => window.flexmotion.scene.odometry[0] === 2"), "where the robot is")
        page.fill("#ahead", "0.5")
        page.locator("#place button").click()
        run.until(lambda: run.asked[-1]["type"] == "waypoint", "the waypoint to be sent")
        assert run.asked[-1]["position_m"] == [2.5, -1.0]
        page.click("#theme")
        page.get_by_role("button", name="STOP", exact=True).click()
        run.until(lambda: run.pressed == ["stop"], "STOP to reach the stop process")
        assert not run.problems


def test_with_webgl_no_sentence_stands_in_the_pictures_place() -> None:
    """What a browser without WebGL is told must not be shown to the others."""
    with browser_page(viewport={"width": 390, "height": 780}) as page:
        run = StandIn(page, load_robot("op3"))
        run.open()
        assert page.locator("p.undrawn").is_hidden() and page.locator("#scene").is_visible()
