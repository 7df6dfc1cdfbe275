"""The report in a terminal."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.motion.heard import Heard, HeardStep
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures
from flexmotion.streamer.report.report import Report, RunInfo, build_report
from flexmotion.streamer.report.summary import (
    asked_rows,
    failures,
    joint_rows,
    motion_rows,
    render,
    steps_words,
    verdict,
)

INFO = RunInfo(robot="op3", driver="sim", source="walk.bvh", elapsed_s=1.0)


def text_of(record: RunTrace, figures: RobotFigures, human: HumanTrack | None, width: int = 100) -> str:
    return rendered(build_report(record, INFO, figures, human=human), width)


def rendered(report: Report, width: int) -> str:
    text = io.StringIO()
    Console(file=text, width=width).print(render(report))
    return text.getvalue()


def test_verdict_comes_first(record: RunTrace, figures: RobotFigures, human: HumanTrack) -> None:
    text = text_of(record, figures, human)
    assert text.startswith("PASS op3 on sim, walk.bvh, 8.0 s: upright, no fault, no limit passed")
    for word in ("leg tracking error", "mm/s", "l_knee", "retarget", "8.0 times real time", "ended HOLD", "3 speed"):
        assert word in text


def test_every_reason_for_failing_is_named(record: RunTrace, figures: RobotFigures) -> None:
    record.true_base[500:, 2] = 0.0
    record.rows["violations"], record.rows["missed_deadlines"] = 2, 3
    record.events += [Event(1, "fault", "l_knee: lost"), *2 * [Event(2, "fault", "e-stop: frozen by an operator")]]
    report = build_report(record, INFO, figures)
    assert failures(report) == [
        "fell after 4.00 s",
        "fault: l_knee: lost",
        "fault: e-stop: frozen by an operator (2 times)",
        "2 goals outside a servo's envelope left the loop",
        "3 of 1000 deadlines missed, 0 allowed",
    ]
    assert text_of(record, figures, None).startswith("FAIL")
    assert "fell after 4.00 s; fault: l_knee" in verdict(report)


def test_a_run_that_was_cut_short_is_named_beside_other_failures(record: RunTrace, figures: RobotFigures) -> None:
    """Regression: a second Ctrl-C was not named beside two missed deadlines."""
    record.rows["missed_deadlines"] = 2
    record.rows["state"][-1] = State.STREAMING
    assert failures(build_report(record, INFO, figures))[0] == "cut short in STREAMING, torque off"


def test_a_run_without_a_plan_has_no_figures(record: RunTrace, figures: RobotFigures) -> None:
    """Regression: Ctrl-C before the start printed a page of dashes."""
    record.rows["plan"], record.rows["state"], record.rows["source_s"] = 0, State.OFF, np.nan
    text = text_of(record, figures, None)
    assert text.startswith("FAIL") and "no plan was ever played" in text
    assert len(text.splitlines()) == 1


@pytest.mark.parametrize("width", [40, 80, 200])
def test_fits_any_terminal(width: int, record: RunTrace, figures: RobotFigures, human: HumanTrack) -> None:
    assert max(map(len, text_of(record, figures, human, width).splitlines())) <= width


def test_unknown_figures_are_left_out(record: RunTrace, figures: RobotFigures) -> None:
    assert "net path" not in text_of(record, figures, None)


def test_joints_are_ordered_by_their_share_of_stall_torque(record: RunTrace, figures: RobotFigures) -> None:
    """Regression: on hardware, where servos measure torque, joints were unordered and without a figure."""
    record.true_torque[:] = np.nan
    record.effort[:] = [0.1, 0.3, 0.2, 0.5, 0.4, 0.35]
    weak_neck = replace(figures, stall_torque=np.array([4, 4, 4, 4, 4, 0.5]))
    report = build_report(record, INFO, weak_neck)
    assert [row[0] for row in joint_rows(report)] == [
        "head_pan",
        "r_knee",
        "l_el",
        "l_knee",
        "r_hip_pitch",
        "l_hip_pitch",
    ]
    assert "torque as the servos measure it, by their current; goals outside" in text_of(record, figures, None, 200)


def test_a_peak_above_the_usable_torque_is_explained(record: RunTrace, figures: RobotFigures) -> None:
    """The words "no limit passed" stood beside a peak of 3.21 N·m of 2.50 usable; only docs/report.md said why."""
    told = "peak above usable: braking, where a servo may give up to its stall torque"
    assert told not in text_of(record, figures, None, 200)
    record.true_torque[5, 3] = 1.2 * figures.torque_limit[3]
    assert told in text_of(record, figures, None, 200)


def test_refusals_are_counted_behind_what_concerns_safety_and_listed(record: RunTrace, figures: RobotFigures) -> None:
    """The verdict joined all refusals, each with the list of 23 motions; a fault was lost among them."""
    reason = "'fly {}' is not understood by this model, it stands still; try: walk forward; it can: stand, walk, bow"
    refused = [Heard(asked=f"fly {n}", state="refused", reason=reason.format(n)) for n in range(12)]
    done = [Heard(asked=f"wave {n}", state="accepted", heard_as="wave-right-hand") for n in range(20)]
    dropped = Heard(asked="wave and sing", state="partly", heard_as="wave-right-hand", dropped=("sing",))
    record.events.append(Event(1, "fault", "l_knee: lost"))
    report = build_report(record, replace(INFO, targets=(*done, dropped, *refused)), figures)
    assert failures(report) == [
        "fault: l_knee: lost",
        "of 33 requests 12 refused and 1 not done whole, listed below",
    ]
    text = rendered(report, 160)
    assert "it can:" not in text and "'fly 3' is not understood" in text and "sing" in text

    alone = build_report(record, replace(INFO, targets=(*done, refused[0])), figures)
    told = failures(alone)[-1]
    assert told == "refused: 'fly 0' is not understood by this model, it stands still; try: walk forward"


def prompt(item: int, at_s: float, *steps: HeardStep) -> Heard:
    return Heard(item=item, at_s=at_s, asked="walk and wave", state="accepted", heard_as="walk, wave", steps=steps)


WALK = HeardStep(text="walk", heard_as="walk", amount=2.0, unit="length", end="stopped", measured=0.6)
WAVE = HeardStep(text="wave", heard_as="wave-right-hand", amount=1.0, unit="times", end="stopped")


def test_a_prompt_that_the_end_of_the_run_cut_off_does_not_pass(record: RunTrace, figures: RobotFigures) -> None:
    """`--seconds 3 --prompt "walk two metres"` passed after .60 m of 2 m."""
    info = replace(INFO, targets=(prompt(0, 0.0, WALK, WAVE),), ends_itself=True)
    report = build_report(record, info, figures)
    assert report.cut_by == "seconds"
    told = "'walk and wave': not done whole when the run ended (walk: 0.6 m of 2 m, wave: not begun)"
    assert not report.ok and failures(report) == [told, "--seconds ended the run first"]
    # An operator's target is stopped on purpose.
    target = Heard(id=1, asked="walk", state="accepted", heard_as="walk", steps=(WALK,))
    assert build_report(record, replace(INFO, targets=(target,)), figures).ok


def test_items_of_a_script_that_the_run_did_not_reach_say_so(record: RunTrace, figures: RobotFigures) -> None:
    """Items whose time never came were listed as accepted. The human of this run is followed for 7 s.

    An item that its script itself ends, by the next item or by a stop, is as it was asked.
    """
    never = WAVE.model_copy(update={"end": None})
    items = (prompt(0, 0.0, WALK), prompt(1, 7.0), prompt(2, 9.0, never))
    report = build_report(record, replace(INFO, targets=items), figures)
    assert [row[1] for row in asked_rows(report)] == ["accepted", "accepted", "not reached"]
    assert report.ok and report.cut_by is None
    assert not build_report(record, replace(INFO, targets=(items[0], items[2])), figures).ok


def test_the_stop_of_a_script_is_reached_by_a_robot_that_stands(record: RunTrace, figures: RobotFigures) -> None:
    """The likeness said "left out: 1 of 2 items (not reached)" of a script of "stand still" and a stop.

    A robot that stands is followed no longer: here the human for 7 s, and then the robot waits for a second.
    """
    stop = Heard(item=1, at_s=7.5, asked="stand still", state="accepted", heard_as="stand")
    items = (prompt(0, 0.0), stop)
    waits = np.isnan(record.source_s)
    assert set(record.state[waits]) == {State.HOLD}
    assert all(heard.reached for heard in build_report(record, replace(INFO, targets=items), figures).targets)
    record.rows["state"][waits] = State.DAMPED  # it fell before
    fell = build_report(record, replace(INFO, targets=items), figures)
    assert [heard.reached for heard in fell.targets] == [True, False]


@pytest.mark.parametrize(
    ("counts", "told"),
    [
        ((22, 2, 16, 0), "the human made 16, 4 added in the robot's own cadence, 2 inserted"),
        ((17, 0, 20, 3), "the human made 20, 3 dropped"),
        ((18, 1, 20, 5), "the human made 20, 5 dropped, 2 added in the robot's own cadence, 1 inserted"),
        ((3, 1, None, 0), "planned, 1 inserted"),
    ],
)
def test_the_parts_of_the_steps_give_their_sum(counts: tuple[int, int, int | None, int], told: str) -> None:
    """A report said "22 planned; the human made 16, 0 dropped, 2 inserted"."""
    assert told in steps_words(*counts)


def test_each_figure_of_a_long_run_says_of_which_part_it_is(record: RunTrace, figures: RobotFigures) -> None:
    """The "steps 364" of a whole run stood under "went 1.04 m ahead" of its last part."""
    report = build_report(record, INFO, figures)
    assert "Motion\n" in rendered(report, 100).replace(" ", "") and "of the whole run" not in rendered(report, 100)
    kept = report.motion.model_copy(update={"period_begin_s": 150.0, "period_end_s": 327.0})
    text = rendered(report.model_copy(update={"motion": kept}), 100)
    assert "Motion from 150 to 327 s" in text and "of the whole run, planned" in text


def test_answers_that_are_not_shown_are_promised_in_no_file(record: RunTrace, figures: RobotFigures) -> None:
    """The words "and 18 more, in report.json" stood in a report without `--report`: there was no such file."""
    asked = tuple(Heard(id=number, asked=f"wave {number}", state="accepted") for number in range(1, 31))
    text = rendered(build_report(record, replace(INFO, targets=asked), figures), 100)
    assert "and 18 more: all of them with --report FOLDER or --json" in text and "report.json" not in text


def test_the_two_ratios_of_paths_say_of_which_time_they_are(
    record: RunTrace, figures: RobotFigures, human: HumanTrack
) -> None:
    """The figure "path 79 %" stood above "net path 0.98", both "scaled by leg length"."""
    meaning = {name: told for name, _, told in motion_rows(build_report(record, INFO, figures, human=human))}
    assert meaning["net path"].endswith("from start to end, once the robot stands again")


def test_a_run_that_was_interrupted_does_not_pass(record: RunTrace, figures: RobotFigures) -> None:
    """After Ctrl-C a dry run of a script printed PASS. A live run has no other end."""
    record.events.append(Event(400, "request", "END"))
    items = (prompt(0, 0.0, WALK), prompt(1, 9.0))
    report = build_report(record, replace(INFO, targets=items, ends_itself=True), figures)
    assert not report.ok and failures(report)[0] == "interrupted" and "--seconds" not in verdict(report)
    assert [row[1] for row in asked_rows(report)] == ["accepted", "not reached"]
    assert build_report(record, replace(INFO, targets=items[1:]), figures).ok
    record.state[300:] = State.PARK  # all was done before
    record.state[-1] = State.OFF
    assert build_report(record, replace(INFO, ends_itself=True), figures).ok
