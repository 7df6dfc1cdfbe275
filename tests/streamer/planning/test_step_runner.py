"""Steps of a program end by what the robot has done, as the loop's rows say, and by nothing else."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS as HUMAN_JOINTS
from flexmotion.importers.default_clip import default_clip
from flexmotion.sampling.rhythm import Rhythm
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.motion.heard import Heard, HeardStep
from flexmotion.streamer.motion.intents import Heading, Text, Velocity
from flexmotion.streamer.motion.programs import Program, Step
from flexmotion.streamer.planning.navigator import STANDING
from flexmotion.streamer.planning.robot_size import RobotSize
from flexmotion.streamer.planning.source_turns import SourceTurns
from flexmotion.streamer.planning.step_runner import StepRunner
from flexmotion.text.amounts import Amount

RATE, FPS, JOINTS = 100.0, 30.0, 4
SIZE = RobotSize(stride=0.11, slowest=0.05)


class FakeSource:
    """The programs of a source by their first frame."""

    fps = FPS

    def __init__(self, *programs: tuple[int, Program]) -> None:
        self.programs = list(programs)

    pace = None
    finished: int | None = None
    stopped_number: int | None = None
    steered: Velocity | None = None
    looks_rad = 0.0  # where its human looks, from 10 s on

    def sampled(self, first: int) -> Motion | None:
        """A human that glides ahead at .2 m/s."""
        clip, seconds = default_clip(), np.arange(first, first + 90) / FPS
        yaw = np.where(seconds < 10.0, 0.0, self.looks_rad)
        return replace(
            clip[: len(seconds)],
            fps=FPS,
            root_position=np.column_stack([0.2 * seconds, np.zeros(len(seconds)), np.full(len(seconds), 0.9)]),
            root_quaternion=Rotation.from_euler("z", yaw[:, None]).as_quat(scalar_first=True),
        )

    def steer(self, intent: Velocity) -> None:
        self.steered = intent

    def stopped(self, program: Program) -> None:
        self.stopped_number = program.number

    def is_over(self, frame: int) -> bool:
        return self.finished is not None and frame >= self.finished

    def finish(self, frame: int) -> None:
        self.finished = frame

    def program_at(self, frame: int) -> tuple[int, Program] | None:
        return next((one for one in reversed(self.programs) if one[0] <= frame), None)


def step(kind: str, value: float, unit: Any, limit_s: float = 60.0, **about: Any) -> Step:
    told = HeardStep(text=kind, heard_as=kind, amount=value, unit=unit, limit_s=limit_s)
    how: dict[str, Any] = {"intent": Text(kind), "axis": (0, 0), "turn": 0} | about
    return Step(kind=kind, amount=Amount(value, unit, kind), limit_s=limit_s, told=told, **how)


def program(*steps: Step, number: int = 1) -> Program:
    heard = Heard(id=number, asked="…", state="accepted", steps=tuple(one.told for one in steps))
    return Program(steps, heard, number)


TURN = step("turn", math.pi / 2, "angle", turn=1, intent=Velocity(0.0, 0.0, 0.5))
WALK = step("walk", 1.0, "length", axis=(1, 0))
STEPS = step("walk-back", 2.0, "steps", axis=(-1, 0))
WAIT = step("stand", 1.0, "time")
WAVE = step("wave-right-hand", 2.0, "times")
BOW = step("bow", 2.0, "times")


def way(kind: str, q: Any, tilt: Any, began: Any) -> Any:
    """The trunk's lean for a bow, else the farthest joint; 1: .35 rad."""
    return np.abs(tilt if kind == "bow" else q - began).max() / 0.35


class Robot:
    """A robot whose rows a test writes; it does what the runner wants, as the replanner would have it."""

    def __init__(self, *programs: tuple[int, Program]) -> None:
        self.heard: list[Heard] = []
        self.runner = StepRunner(FakeSource(*programs), RATE, self.heard.append, SIZE, way)  # type: ignore[arg-type]
        self.row = TickRow(blank(TickRow.dtype(joints=JOINTS)))
        self.row.state[...], self.row.odometry[...], self.row.q[...] = State.STREAMING, 0.0, 0.0
        self.row.tilt[...] = 0.0
        self.row.foot_ref[...], self.row.contact_ref[...] = 0.0, True
        self.asked: list[Any] = []
        self.doing: Any = None
        self.tick = -1
        self.foreseen = 0
        self.pace = 1.0  # of the human's motion
        self.ahead_of_it = np.zeros(3)

    def run(self, seconds: float, **speeds: float) -> None:
        """Rows for so long; `turn`, `ahead` [1/s] act while the runner asks for neither standing nor rest."""
        for _ in range(round(seconds * RATE)):
            self.tick += 1
            self.row.tick[...], self.row.source_s[...] = self.tick, self.pace * self.tick / RATE
            moving = self.doing != STANDING and not self.runner.resting
            self.row.odometry[2] += speeds.get("turn", 0.0) / RATE * moving
            self.row.odometry[0] += speeds.get("ahead", 0.0) / RATE * moving
            self.runner.update(self.row, stands_at=self.stands_at)
            if self.runner.wanted is not None:
                self.doing = self.runner.wanted
                self.asked.append(self.doing)
                self.runner.changed()

    def stands_at(self) -> np.ndarray:
        """It stops at once, where it is, unless a test says by how much further."""
        self.foreseen += 1
        return self.ahead_of_it

    @property
    def ends(self) -> list[str | None]:
        return [one.end for one in self.heard[-1].steps]


def test_a_turn_ends_by_the_measured_turn_and_not_by_time() -> None:
    slow, quick = Robot((0, program(TURN))), Robot((0, program(TURN)))
    slow.run(8.0, turn=0.15)
    assert not slow.heard and not slow.runner.resting
    quick.run(8.0, turn=0.6)
    assert quick.ends == ["done"] and quick.heard[-1].steps[0].measured == pytest.approx(math.pi / 2, abs=0.1)
    # Its human stood until the robot was measured.
    assert quick.runner.resting and quick.asked == [TURN.intent]


def test_a_way_is_measured_in_the_torsos_own_direction() -> None:
    robot = Robot((0, program(WALK)))
    robot.row.odometry[2] = math.pi  # it looks back: x falls while it walks ahead
    robot.run(7.0, ahead=-0.2)
    assert robot.ends == ["done"] and robot.heard[-1].steps[0].measured == pytest.approx(1.0, abs=0.1)


def test_a_step_under_way_when_a_program_begins_is_part_of_its_way() -> None:
    """Walks of half a metre ended after .50 to .67 m: the first step was settled before the program began.

    A robot that was walking makes that step for the program before.
    """
    for steps_before, way in ((0, 0.2), (2, 0.5)):  # it stops where half of a step is missing
        robot = Robot((60, program(step("walk", 0.5, "length", axis=(1, 0)))))
        robot.row.base_ref[3:], robot.row.com_ref[...] = [1.0, 0.0, 0.0, 0.0], 0.0
        robot.ahead_of_it[0] = 0.2
        robot.run(1.0)
        for _ in range(steps_before):
            robot.row.contact_ref[0] = False
            robot.run(0.3)
            robot.row.contact_ref[...] = True
            robot.run(0.1)
        robot.run(0.99 - 0.4 * steps_before)
        robot.row.contact_ref[0] = False
        robot.run(10.0 * (way - 0.02), ahead=0.1)
        assert not robot.runner.resting
        robot.run(0.4, ahead=0.1)
        assert robot.runner.resting


def test_a_robot_that_does_not_move_ends_a_step_by_its_limit_and_says_so() -> None:
    robot = Robot((0, program(step("walk", 1.0, "length", limit_s=3.0, axis=(1, 0)), WAIT)))
    robot.run(3.5)
    assert robot.ends == ["time limit", None] and robot.heard[-1].failure is not None
    robot.run(1.5)
    assert robot.ends == ["time limit", "done"]


def test_steps_follow_each_other() -> None:
    robot = Robot((0, program(WAIT, TURN, WAIT)))
    robot.run(10.0, turn=0.6)
    assert robot.ends == ["done"] * 3
    assert robot.asked == [TURN.intent] and robot.runner.resting


def test_footsteps_count_where_they_carry_a_foot_in_the_walks_direction() -> None:
    """Every lift counted, also those that correct the feet: "two steps back" was one."""
    robot = Robot((0, program(STEPS)))
    for side, carried in ((0, 0.0), (1, -0.05), (0, 0.05), (0, -0.08)):
        assert not robot.runner.resting
        robot.row.contact_ref[side] = False
        robot.run(0.02)
        robot.row.foot_ref[side, 0] += carried
        robot.run(0.02)
        robot.row.contact_ref[side] = True
        robot.run(0.02)
    assert robot.runner.resting
    robot.run(2.0)
    assert robot.ends == ["done"] and robot.heard[-1].steps[0].measured == 2.0


@pytest.mark.parametrize(
    ("closes_m", "told"), [(0.08, "2 steps of 2 steps, then feet together"), (0.16, "3 steps, 2 asked for")]
)
def test_the_step_that_brings_the_feet_together_is_none_of_those_that_were_asked_for(
    closes_m: float, told: str
) -> None:
    """The answer to "two steps back" was "3 steps, 2 asked for": the last one only closed the stance.

    One that was settled already and passes the other foot counts.
    """
    robot = Robot((0, program(STEPS)))
    for side, carried in ((0, 0.04), (1, 0.08), (0, closes_m - 0.04)):
        robot.row.contact_ref[side] = False
        robot.run(0.02)
        robot.row.foot_ref[side, 0] -= carried
        robot.run(0.02)
        robot.row.contact_ref[side] = True
        robot.run(0.02)
    robot.run(2.0)
    assert robot.ends == ["done"] and robot.heard[-1].steps[0].done == told


def test_a_gesture_counts_if_the_joints_moved_and_is_repeated_until_it_has() -> None:
    robot = Robot((0, program(WAVE)))
    robot.run(0.1)
    for seen in (True, False, True):
        while not robot.heard and robot.doing != STANDING:
            robot.row.q[2] = 1.0 if seen else 0.0
            robot.run(0.1)
        robot.row.q[2] = 0.0
        while not robot.heard and robot.doing == STANDING:
            robot.run(0.1)
    assert robot.ends == ["done"] and robot.heard[-1].steps[0].measured == 2.0
    assert robot.asked == [STANDING, WAVE.intent, STANDING, WAVE.intent, STANDING]


def test_a_bow_that_came_up_is_not_asked_on() -> None:
    """A bow took 3.5 s by the clock: the model bowed once more in that time, and "bow twice" showed three bows."""
    robot = Robot((0, program(BOW)))
    for pause in (0.5, 1.0):
        robot.run(0.2)
        robot.row.tilt[1] = 0.7
        robot.run(pause)
        assert robot.doing != STANDING and not robot.runner.resting
        robot.row.tilt[1] = 0.1
        robot.run(0.1)
        assert robot.runner.resting, "its own stop straightens it"
        robot.row.tilt[1] = 0.0
        while robot.runner.resting and not robot.heard:
            robot.run(0.1)
    assert robot.ends == ["done"] and robot.heard[-1].steps[0].measured == 2.0
    assert robot.asked == [BOW.intent]


def test_strokes_are_counted_by_the_rhythm_of_the_human_and_not_as_ways_from_the_stand() -> None:
    """Hands that clap stay before the body: "clap three times" had no end but its limit."""
    rhythm = Rhythm.of("clap", Body(), np.zeros(len(HUMAN_JOINTS)))
    robot = Robot((0, program(replace(step("clap", 3.0, "times"), rhythm=rhythm))))
    robot.row.q[2], robot.runner.home = 1.0, np.zeros(JOINTS)
    robot.run(rhythm.seconds(3) - 0.1)
    assert not robot.heard
    robot.run(0.2)
    assert robot.ends == ["done"] and robot.heard[-1].steps[0].measured == 3.0
    assert robot.asked == [STANDING], "raised hands come down after it"


def test_strokes_of_a_plan_that_is_eased_are_counted_as_they_are_played() -> None:
    """They were counted by the clock: of claps at two fifths of their pace "5 of 5" were told, and two were made."""
    rhythm = Rhythm.of("clap", Body(), np.zeros(len(HUMAN_JOINTS)))
    robot = Robot((0, program(replace(step("clap", 4.0, "times"), rhythm=rhythm))))
    robot.pace = 0.5
    robot.run(rhythm.seconds(4) + 0.2)
    assert not robot.heard
    robot.run(rhythm.seconds(4))
    assert robot.ends == ["done"] and robot.heard[-1].steps[0].measured == 4.0


def test_strokes_that_are_cut_off_say_how_many_were_made() -> None:
    rhythm = Rhythm.of("nod", Body(), np.zeros(len(HUMAN_JOINTS)))
    robot = Robot((0, program(replace(step("nod", 5.0, "times"), rhythm=rhythm))))
    robot.run(rhythm.seconds(2) + 0.1)
    robot.row.must_stop[...] = True
    robot.run(0.1)
    assert robot.ends == ["stopped"] and robot.heard[-1].steps[0].measured == 2.0


def test_a_hand_that_dips_while_it_waves_goes_on_waving() -> None:
    robot = Robot((0, program(WAVE)))
    for angle in (0.0, 2.5, 1.3, 2.5, 1.3, 2.5):
        robot.row.q[2] = angle
        robot.run(0.4)
    assert not robot.asked
    robot.row.q[2] = 0.0
    robot.run(0.1)
    assert robot.asked == [STANDING], "it came down by itself"


def test_a_gesture_that_does_not_come_back_is_not_done() -> None:
    """A raised hand counted as a wave after 3 s of standing, down or not."""
    robot = Robot((0, program(step("wave-right-hand", 1.0, "times", limit_s=12.0))))
    robot.row.q[2] = 0.0
    robot.run(0.1)
    robot.row.q[2] = 2.5
    robot.run(12.5)
    assert robot.ends == ["time limit"] and robot.heard[-1].steps[0].measured == 0.0


def test_a_gesture_that_was_counted_is_done_though_its_limit_comes_before_the_robot_rests() -> None:
    """One "bow" ended by its time limit with 1 time of 1 time: the limit came while the robot settled after it."""
    robot = Robot((0, program(step("bow", 1.0, "times", limit_s=3.0))))
    robot.run(1.9)
    robot.row.tilt[1] = 0.7
    robot.run(0.5)
    robot.row.tilt[1] = 0.0
    robot.run(0.1)
    assert robot.runner.resting and not robot.heard
    robot.run(0.6)
    assert robot.ends == ["done"] and robot.heard[-1].steps[0].measured == 1.0


def test_another_target_and_a_stop_end_a_program_and_say_so() -> None:
    robot = Robot((0, program(TURN, WAIT)), (60, program(WAIT, number=2)))
    robot.run(1.0, turn=0.1)
    assert not robot.heard
    robot.run(1.2, turn=0.1)
    assert robot.heard[0].id == 1 and [one.end for one in robot.heard[0].steps] == ["superseded"] * 2
    robot.row.must_stop[...] = True
    robot.run(0.1)
    assert robot.heard[-1].id == 2 and robot.ends == ["stopped"] and not robot.runner.resting
    # The page drew a motion until the next one, since nothing said when it had ended.
    ended = [heard.steps[0].end_s for heard in robot.heard]
    assert ended == pytest.approx([2.0, 2.2], abs=0.05)


def test_a_step_that_is_stopped_says_how_much_of_it_was_done() -> None:
    """A walk of 2 m that the end of the run stopped after .6 m, and the wave that never began, were "not measured"."""
    robot = Robot((0, program(WALK, WAVE)))
    robot.run(3.0, ahead=0.2)
    robot.row.must_stop[...] = True
    robot.run(0.1)
    walk, wave = robot.heard[-1].steps
    assert robot.ends == ["stopped"] * 2 and walk.measured == pytest.approx(0.6, abs=0.05)
    assert wave.measured is None and wave.fate == "not begun (stopped)"


def test_a_step_that_is_stopped_while_the_robot_comes_to_rest_after_it_is_done() -> None:
    robot = Robot((0, program(TURN)))
    robot.run(2.9, turn=0.6)
    assert robot.runner.resting and not robot.heard
    robot.row.must_stop[...] = True
    robot.run(0.1)
    assert robot.ends == ["done"]


def test_a_turn_that_ends_in_a_fall_is_not_done() -> None:
    """A robot that tipped over as it came to rest after a turn by half a circle was told as "done, 186° of 180°"."""
    robot = Robot((0, program(TURN)))
    robot.run(2.9, turn=0.6)
    assert robot.runner.resting and not robot.heard
    robot.row.state[...], robot.row.must_stop[...], robot.row.faulted[...] = State.DAMPED, True, True
    robot.run(0.1)
    assert robot.ends == ["stopped"] and robot.heard[-1].steps[0].measured == pytest.approx(math.pi / 2, abs=0.1)


@pytest.mark.parametrize("step", [TURN, WAIT])
def test_a_step_that_is_stopped_at_its_begin_is_not_done(step: Step) -> None:
    """What was too little for another attempt counted as done: of a turn by 10° that was stopped at 0°, all of it."""
    assert step.amount is not None
    small = replace(step.amount, value=min(step.amount.value, math.radians(10.0)))
    robot = Robot((0, program(replace(step, amount=small))))
    robot.run(0.05)
    robot.row.must_stop[...] = True
    robot.run(0.05)
    assert robot.ends == ["stopped"]


def test_a_target_that_is_over_ends_its_program() -> None:
    """A program went on by itself after the target that had asked for it was too old."""
    robot = Robot((0, program(TURN, WAIT)))
    robot.run(2.9, turn=0.6)
    assert robot.runner.resting
    robot.runner.update(robot.row, halted="stopped")
    assert robot.ends == ["done", "stopped"] and not robot.runner.resting and robot.runner.wanted is None


@pytest.mark.parametrize("coming", [False, True])
def test_a_walk_whose_time_to_live_was_over_was_told_as_stopped(coming: bool) -> None:
    """The end of all that has an amount was "stopped", as by a STOP, and never "expired"."""
    robot = Robot((0, program(WALK, WAVE)))
    robot.run(1.0, ahead=0.2)
    if coming:
        robot.runner.turned(program(WALK, WAVE, number=2), robot.row)
    robot.runner.update(robot.row, halted="expired")
    assert robot.ends == ["expired"] * 2 and robot.heard[-1].id == (2 if coming else 1)
    assert robot.runner.source.stopped_number == robot.heard[-1].id and not robot.runner.travels
    if not coming:
        assert robot.heard[-1].steps[0].measured == pytest.approx(0.2, abs=0.02)


def test_a_turn_whose_time_is_over_while_the_robot_comes_to_rest_after_it_is_done() -> None:
    robot = Robot((0, program(TURN)))
    robot.run(2.9, turn=0.6)
    robot.runner.update(robot.row, halted="expired")
    assert robot.ends == ["done"]


def test_a_script_goes_on_while_the_robot_rests() -> None:
    """While a plan's stop plays no frame of the source does, and the next item of a script never came."""
    robot = Robot((0, program(TURN)), (120, program(WAVE, number=2)))
    robot.run(2.9, turn=0.6)
    assert robot.runner.resting
    for _ in range(300):
        robot.row.odometry[2] += 0.002  # it sways and is not still
        robot.tick += 1
        robot.row.tick[...], robot.row.source_s[...] = robot.tick, np.nan
        robot.runner.update(robot.row)
        if robot.runner.wanted is not None:
            break
    assert robot.runner.wanted == WAVE.intent


class Joins:
    """Where a plan joins, for `SourceTurns`: the human goes on from a frame, and looks ahead."""

    def __init__(self, frame: int) -> None:
        self.frame = frame

    def first_frame(self, join: int, current: None) -> int:
        return self.frame

    def human_yaw(self, join: int, current: None) -> float:
        return 0.0


@pytest.mark.parametrize(("frame", "bows"), [(118, False), (119, True), (125, True)])
def test_an_item_that_begins_with_a_change_is_not_lost(frame: int, bows: bool) -> None:
    """A robot that lowered its arms for "stand still" as "take a bow" began never bowed: the change came after it."""
    robot = Robot((0, program(TURN, WAVE)), (120, program(BOW, number=2)))
    robot.run(3.9, turn=0.4)
    runner, changes = robot.runner, []
    runner.wanted, runner.facing = STANDING, 0.15
    runner.source.change = lambda *change: changes.append(change)  # type: ignore[method-assign]
    turns: Any = SourceTurns(Joins(frame), runner, None, print)  # type: ignore[arg-type]
    turns.to_step(runner, None, 0)
    # What the change was for looks aside, the bow does not.
    assert changes == [(BOW.intent if bows else STANDING, frame, None, 0.0 if bows else 0.15)]
    assert runner.wanted is None


def test_an_open_program_is_left_alone() -> None:
    open_step = Step(Text("walk"), "walk", None, (1, 0), 0, None, HeardStep(text="walk", heard_as="walk"))
    robot = Robot((0, program(open_step)))
    robot.run(5.0, ahead=0.2)
    assert not robot.heard and not robot.asked and not robot.runner.resting


OPEN = Step(Velocity(0.4, 0.0, 0.0), "velocity", None, (0, 0), 0, None, HeardStep(text="v", heard_as="velocity"))


def test_an_operators_velocity_is_kept_by_what_the_robot_does() -> None:
    """The human of one that was asked to turn by .3 rad/s turned by .41, and the robot with it."""
    robot = Robot((0, program(OPEN)))
    robot.run(20.0, ahead=0.2)
    steered = robot.runner.source.steered
    assert steered is not None and steered.forward > 0.5 and not steered.paced
    assert not robot.asked  # no motion is cut for it


def test_the_same_velocity_once_more_goes_on_with_what_was_learnt() -> None:
    robot = Robot((0, program(OPEN)))
    robot.run(20.0, ahead=0.2)
    learnt = robot.runner.source.steered
    again, other = program(OPEN, number=2), program(replace(OPEN, intent=Velocity(0.2, 0.0, 0.0)), number=3)
    assert robot.runner.turned(again, robot.row) == learnt
    assert robot.runner.turned(other, robot.row) is None


@pytest.mark.parametrize("before", [OPEN, replace(OPEN, intent=Text("walk"))])
def test_a_walk_that_is_told_to_go_faster_is_kept_at_its_new_speed(before: Step) -> None:
    """Regression: "walk slowly", then "faster" was accepted, and the robot was kept at the speed before."""
    robot = Robot((0, program(before)))
    robot.run(4.0, ahead=0.4)
    faster = program(replace(OPEN, intent=Velocity(0.6, 0.0, 0.0)))  # the same program, at another speed
    kept = robot.runner.source.steered is not None
    assert robot.runner.turned(faster, robot.row) == (faster.steps[0].intent if kept else None)
    robot.runner.source.programs = [(0, faster)]
    robot.run(4.0, ahead=0.6)
    steered = robot.runner.source.steered
    assert steered is not None and steered.forward > 0.55


LED = step("walk-turn-left", math.pi / 2, "angle", turn=1, intent=Velocity(0.0, 0.0, 0.5))


def heading_to(angle: float) -> Step:
    told = HeardStep(text="heading", heard_as="heading")
    return Step(Text("stand still"), "heading", None, (0, 0), 0, None, told, Heading(angle))


def test_a_goal_ends_what_was_kept() -> None:
    """Regression: a velocity, then a waypoint: the keeper steered on, and the robot walked off for good."""
    robot = Robot((0, program(OPEN)))
    robot.run(4.0, ahead=0.4)
    goal = program(heading_to(math.pi / 2), number=2)
    robot.runner.turned(goal, robot.row)
    robot.runner.source.programs = [(0, goal)]
    robot.runner.source.steered = None
    robot.run(3.0)
    assert robot.runner.source.steered is None


def test_a_stop_ends_what_is_under_way_for_the_source_too() -> None:
    """Regression: "faster" after a STOP made a standing robot walk, although it was refused."""
    robot = Robot((0, program(OPEN)))
    robot.run(4.0, ahead=0.4)
    robot.runner.update(robot.row, halted="stopped")
    assert robot.runner.source.stopped_number == 1


def test_a_stop_before_its_first_frame_ends_a_program_too() -> None:
    """Went wrong: a walk that was stopped within .1 s was under way: "slower" after the stop began it."""
    robot = Robot((0, program(OPEN)))
    robot.run(4.0, ahead=0.4)
    robot.runner.turned(program(WALK, WAVE, number=2), robot.row)
    robot.runner.update(robot.row, halted="stopped")
    assert robot.runner.source.stopped_number == 2 and not robot.runner.travels
    assert robot.heard[-1].id == 2 and robot.ends == ["stopped", "stopped"]


def test_a_target_that_comes_before_the_robot_stands_is_not_stopped_by_it() -> None:
    robot = Robot((0, program(OPEN)))
    robot.row.state[...] = State.READY
    robot.runner.turned(program(WALK, number=2), robot.row)
    robot.runner.update(robot.row)
    assert robot.runner.source.stopped_number is None and robot.runner.travels and not robot.heard


def test_a_change_of_speed_leaves_a_robot_that_comes_to_rest_at_rest() -> None:
    """Regression: "slower", as half a metre was done and the robot came to rest, led on to 1.07 m, "done"."""
    robot = Robot((0, program(WALK)))
    while not robot.runner.resting:
        robot.run(0.1, ahead=0.4)
    slower = program(replace(WALK, intent=Velocity(0.3, 0.0, 0.0)))
    assert robot.runner.turned(slower, robot.row) is None and robot.runner.resting
    robot.runner.source.programs = [(0, slower)]
    robot.run(4.0, ahead=0.4)
    assert robot.ends == ["done"] and robot.heard[-1].steps[0].measured == pytest.approx(1.0, abs=0.1)


def test_a_turn_that_is_told_to_go_slower_ends_where_it_was_to() -> None:
    """Regression: it was begun anew, with all of its angle: 110° of 90."""
    robot = Robot((0, program(LED)))
    robot.run(1.5, turn=0.5)
    slower = program(replace(LED, intent=Velocity(0.0, 0.0, 0.3)))
    assert robot.runner.turned(slower, robot.row) == Velocity(0.0, 0.0, 0.3)
    robot.runner.source.programs = [(0, slower)]
    robot.run(8.0, turn=0.3)
    assert robot.ends == ["done"] and robot.heard[-1].steps[0].measured == pytest.approx(math.pi / 2, abs=0.1)


def test_a_curve_between_two_straight_ways_changes_the_heading_that_is_kept() -> None:
    robot = Robot((0, program(OPEN)))
    robot.run(4.0, ahead=0.4)
    robot.runner.source.programs = [(0, program(replace(OPEN, intent=Velocity(0.4, 0.0, 0.3)), number=2))]
    robot.run(3.0, ahead=0.4, turn=0.3)
    robot.runner.source.programs = [(0, program(OPEN, number=3))]
    before = robot.runner.aside
    robot.run(6.0, ahead=0.4)
    # The robot looks where the curve has led: nothing of it is taken back.
    assert robot.runner.aside == pytest.approx(before, abs=0.02)


def test_another_speed_keeps_the_heading() -> None:
    """A torso twists by 9° with each step: at each "faster" the robot went on where it looked at that moment."""
    robot = Robot((0, program(OPEN)))
    robot.runner.source.looks_rad = 0.1
    robot.run(14.0, ahead=0.4)
    assert robot.runner.aside == pytest.approx(0.1, abs=0.01)
    robot.row.odometry[2] = 0.15
    robot.runner.source.programs = [(0, program(replace(OPEN, intent=Velocity(0.6, 0.0, 0.0))))]
    robot.run(0.1, ahead=0.6)
    assert robot.runner.aside == pytest.approx(0.1, abs=0.01)
    robot.run(3.0, ahead=0.6)
    assert robot.runner.aside > 0.1  # the robot is led back to where it looked before


def test_a_change_of_speed_is_that_of_the_step_under_way() -> None:
    """Of "turn left, then walk on" the second step is under way."""
    first, second = program(TURN, OPEN), program(TURN, replace(OPEN, intent=Velocity(0.6, 0.0, 0.0)))
    robot = Robot((0, first))
    robot.run(8.0, turn=0.6)
    assert robot.asked[-1] == OPEN.intent
    robot.run(2.0, ahead=0.4)
    assert robot.runner.turned(second, robot.row) == second.steps[1].intent


def test_what_the_human_looks_aside_is_taken_off_a_straight_way_alone() -> None:
    """A human that stepped aside wandered by 6°, and the robot with it."""
    robot = Robot((0, program(OPEN)))
    robot.runner.source.looks_rad = 0.1
    robot.run(8.0, ahead=0.2)
    assert robot.runner.aside == pytest.approx(0.0, abs=1e-6)
    robot.run(6.0, ahead=0.2)
    assert robot.runner.aside == pytest.approx(0.1, abs=0.01)
    curve = Robot((0, program(replace(OPEN, intent=Velocity(0.4, 0.0, 0.2)))))
    curve.runner.source.looks_rad = 0.1
    curve.run(15.0, ahead=0.2)
    assert curve.runner.aside == 0.0


def test_a_stop_forgets_the_velocity() -> None:
    robot = Robot((0, program(OPEN)))
    robot.run(20.0, ahead=0.2)
    robot.runner.update(robot.row, halted="stopped")
    assert robot.runner.turned(program(OPEN, number=2), robot.row) is None


def test_a_scripts_velocity_is_not_changed() -> None:
    script = program(OPEN)
    robot = Robot((0, replace(script, heard=script.heard.model_copy(update={"id": 0, "item": 0}))))
    robot.run(20.0, ahead=0.2)
    assert robot.runner.source.steered is None


def test_after_its_last_step_the_robot_rests_and_the_human_is_not_told_to_stand() -> None:
    """A human that was told to stand went on for five seconds; the robot stepped with it and turned by 20 degrees."""
    robot = Robot((0, program(WALK)))
    robot.run(9.0, ahead=0.2)
    assert robot.ends == ["done"] and robot.runner.resting and robot.asked == []
    assert robot.runner.source.finished is not None  # type: ignore[attr-defined]


STAND = Step(Text("stand"), "stand", None, (0, 0), 0, None, HeardStep(text="stand", heard_as="stand"))


def stand_after(walks: bool) -> Robot:
    """A robot with home pose 0 that is told to stand after two seconds."""
    open_walk = Step(Text("walk"), "walk", None, (1, 0), 0, None, HeardStep(text="walk", heard_as="walk"))
    open_wave = Step(Text("wave"), "wave", None, (0, 0), 0, None, HeardStep(text="wave", heard_as="wave"))
    robot = Robot((0, program(open_walk if walks else open_wave)), (60, program(STAND, number=2)))
    robot.runner.home = np.zeros(JOINTS)
    return robot


def test_a_robot_that_walks_and_is_told_to_stand_rests_at_once() -> None:
    robot = stand_after(walks=True)
    robot.run(1.0, ahead=0.2)
    robot.row.contact_ref[0] = False
    robot.run(1.1, ahead=0.2)
    assert robot.runner.resting and robot.asked == []
    robot.row.contact_ref[0] = True
    robot.run(5.0, ahead=0.2)
    assert robot.runner.resting and robot.asked == []


def test_raised_arms_come_down_before_the_robot_rests() -> None:
    robot = stand_after(walks=False)
    robot.row.q[1] = 1.0
    robot.run(2.1)
    assert not robot.runner.resting, "its stop would hold the arm up"
    robot.row.q[1] = 0.0
    robot.run(2.0)
    assert robot.runner.resting and robot.asked == []


def test_arms_that_were_raised_while_it_walked_come_down_after_the_stop() -> None:
    robot = stand_after(walks=True)
    robot.row.contact_ref[0] = False
    robot.row.q[1] = 1.0
    robot.run(2.1)
    robot.row.contact_ref[0] = True
    assert robot.runner.resting
    robot.run(1.5)
    assert robot.asked == [STAND.intent] and not robot.runner.resting
    robot.row.q[1] = 0.0
    robot.run(2.0)
    assert robot.runner.resting and robot.asked == [STAND.intent]


WAVING = Velocity(0.3, 0.0, 0.0, beside=Text("wave"))
WALK_WAVING = step("walk", 1.0, "length", axis=(1, 0), intent=WAVING)
TURN_WAVING = step("turn", math.pi / 2, "angle", turn=1, intent=replace(TURN.intent, beside=Text("wave")))
TIME_WAVING = step("walk", 2.0, "time", axis=(1, 0), intent=WAVING)


def with_a_raised_arm(*steps: Step) -> Robot:
    robot = Robot((0, program(*steps)))
    robot.runner.home = np.zeros(JOINTS)
    robot.row.q[1] = 2.0
    return robot


@pytest.mark.parametrize(
    ("last", "speeds"), [(WALK_WAVING, {"ahead": 0.5}), (TURN_WAVING, {"turn": 0.5}), (TIME_WAVING, {"ahead": 0.5})]
)
def test_an_arm_that_waved_on_the_way_stayed_up_after_it(last: Step, speeds: dict[str, float]) -> None:
    """It stayed in mid-gesture without end after "turn left 90 degrees while waving", which was done."""
    robot = with_a_raised_arm(last)
    robot.run(7.0, **speeds)
    assert robot.ends == ["done"] and robot.asked[-1] == STANDING and not robot.runner.travels
    robot.row.q[1] = 0.0
    robot.run(4.0)
    assert robot.runner.resting and robot.asked.count(STANDING) == 1


def test_an_arm_that_waved_on_the_way_comes_down_on_feet_that_rest() -> None:
    """A human that is told to stand takes seconds, in which the robot steps on: it comes to its own stop before."""
    robot = with_a_raised_arm(TIME_WAVING)
    robot.row.contact_ref[0] = False
    robot.run(2.02)
    assert robot.ends == ["done"] and robot.runner.resting and STANDING not in robot.asked
    robot.row.contact_ref[0] = True
    robot.run(1.5)
    assert robot.asked[-1] == STANDING


def test_arms_of_a_walk_without_a_gesture_and_of_what_follows_one_are_left_alone() -> None:
    plain = with_a_raised_arm(WALK)
    plain.run(10.0, ahead=0.5)
    assert plain.ends == ["done"] and plain.runner.resting and STANDING not in plain.asked
    followed = with_a_raised_arm(WALK_WAVING, BOW)
    followed.run(4.5, ahead=0.5)
    assert followed.asked[-1] == BOW.intent and STANDING not in followed.asked


@pytest.mark.parametrize("seconds", [0.5, 1.5])
def test_an_arm_stayed_up_where_a_short_stand_ended_as_it_came_down(seconds: float) -> None:
    stand = step("stand", seconds, "time", intent=STANDING)
    robot = with_a_raised_arm(WALK_WAVING, stand)
    robot.run(10.0, ahead=0.5)
    assert robot.ends == ["done", "done"] and robot.asked[-1] == STANDING and robot.doing == STANDING
    assert robot.runner.resting, "and after the longest time the robot rests"


def test_a_heading_ends_where_the_robot_looks_there_by_its_own_measure() -> None:
    told = HeardStep(text="heading 90°", heard_as="heading")
    goal = Step(Text("stand still"), "heading", None, (0, 0), 0, None, told, Heading(math.pi / 2))
    robot = Robot((0, program(goal)))
    robot.row.odometry[2] = 0.4
    robot.run(0.1, turn=0.5)
    assert robot.asked == [Velocity(0.0, 0.0, 0.5)]
    robot.run(8.0, turn=0.5)
    assert robot.ends == ["done"] and robot.runner.resting
    assert robot.heard[-1].steps[0].place == pytest.approx((0.0, 0.0, math.pi / 2), abs=0.14)


def test_where_a_robot_would_stop_is_foreseen_only_where_something_is_measured_by_it() -> None:
    """Was foreseen in every tick of a walk without an end: a quarter of the planner's work beside its plans."""
    told = HeardStep(text="walk", heard_as="walk")
    walks, turns = (
        Robot((0, program(Step(Text("walk"), "walk", None, (1, 0), 0, None, told)))),
        Robot((0, program(TURN))),
    )
    for robot in (walks, turns):
        robot.row.base_ref[...], robot.row.com_ref[...] = (0, 0, 0, 1, 0, 0, 0), 0.0
        robot.run(1.0, turn=0.1)
    assert (walks.foreseen, turns.foreseen) == (1, round(RATE))
