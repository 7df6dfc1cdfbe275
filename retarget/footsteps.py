"""Which steps the robot makes, when, and where to: the human's, at human time, as far as its legs allow.

A step is a human foot's swing that moves, turns or lifts it enough to matter. It starts when the human's does, or as
soon as the robot's other foot has landed and taken the weight; it lands with the human's or when the robot's foot
can be there. Where a human turns on planted feet, or slides on them, the robot cannot: steps are inserted until its
feet agree again, one foot after the other. A foothold counts from where the human's other foot stood when the robot's
took its place, so what a foot slides on while it stands is made up for by the next step.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot_file import Gait
from flexmotion.retarget.human import HumanWindow, Swing
from flexmotion.retarget.swing import PEAK_ACCELERATION

Float = NDArray[np.float64]

_WORTH_DISTANCE = 0.06
"""A human foot that moves less [m], turns less and lifts less than these only shuffles."""
_WORTH_YAW = 0.2
_WORTH_LIFT = 0.04
_TOO_LATE_S = 0.30
"""A step whose human foot landed longer ago is dropped: catching up would trip the next one."""
_REDRAWN_S = 0.15
"""A swing that began before its foot's last one was to land is that one redrawn, unless it lands this much later."""
_INSERT_YAW = 0.26
_INSERT_DISTANCE = 0.045
"""Feet further from where they belong (robot scale) are set right by an inserted step."""
_INSERT_SWING_S = 0.40
_UNKNOWN_SWING_S = 0.42
_OWED = 0.3
"""Of what the human goes aside and one foot cannot, the other is told at most this much [m of the human's]."""
_TURN_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)
"""How much of its turn a foot makes: the first that leaves it within a stride and within reach, else the last."""
_STRIDE_TOLERANCE = 1e-3
"""What a foot may be further ahead than the longest stride [m]."""
_LATER_S = 0.06
"""How much later than the human's foot the robot's may land."""
NOTICE_S = 0.25
"""A step is settled this long before its foot lifts, and none is begun on shorter notice: the weight must be moved."""
UNHURRIED_S = 0.45
"""The same from a stand, where the weight rests between the feet and does not move yet, and for inserted steps: nobody
waits for those, and whether one is needed may look otherwise at every look at the human, so it must be settled before
the weight is on its way."""
_ASIDE, _ASKEW = 0.015, 0.09
"""Feet nearer than this to standing side by side [m, rad] are left as they are at the end."""
_AGAIN_S = 0.3
"""A foot that has landed stays down this long, though the other may lift sooner: who swings one leg to and fro while
the other carries him soon scuffs the ground and falls."""


@dataclass(frozen=True, eq=False)
class Step:
    """One footstep of the robot, in loop ticks.

    Attributes:
        side: foot that moves, 0 left, 1 right.
        lift, land: ticks of lift-off and touch-down.
        start, target: x, y, z, yaw of the sole centre, (4,) [m, m, m, rad].
        consumed_s: source time up to which human swings of this foot are done with.
        dropped: human steps left out before this one.
        inserted: set right by the robot, not made by the human.
        notice_s: how long before its lift it is settled, so that no later plan puts it off [s].
        human: where the human's foot stood that the target stands for, (2,) [m]; NaN where there is none.
    """

    side: int
    lift: int
    land: int
    start: Float
    target: Float
    consumed_s: float
    dropped: int = 0
    inserted: bool = False
    notice_s: float = NOTICE_S
    human: Float = field(default_factory=lambda: np.full(2, np.nan))

    @property
    def stance(self) -> int:
        """The foot that carries the robot meanwhile."""
        return 1 - self.side


def settled_from(steps: list[Step], rate_hz: float) -> Float:
    """Ticks from which steps, in order of time, are settled: each with the one after it at the latest, (steps,)."""
    own = np.array([step.lift - step.notice_s * rate_hz for step in steps])
    return np.minimum.accumulate(own[::-1])[::-1]


@dataclass(frozen=True)
class Scaling:
    """How human lengths and headings become the robot's.

    Attributes:
        ratio: robot leg length over human leg length.
        heading: robot yaw minus human yaw [rad].
        human_width: distance between the human's feet in quiet stance [m].
    """

    ratio: float
    heading: float
    human_width: float


@dataclass(frozen=True, eq=False)
class Foothold:
    """Where a foot belongs.

    Attributes:
        pose: x, y, z, yaw of the sole centre, (4,) [m, m, m, rad].
        human: the place on the human's ground that it stands for, (2,) [m]: where the human's foot is, but for what is
            out of the robot's reach aside.
    """

    pose: Float
    human: Float


class FootstepPlanner:
    """Chooses steps over a window of human motion.

    Args:
        gait: the robot's gait limits.
        stand_width: distance between the robot's sole centres at its stand pose [m].
        sole_half_length: from a sole's centre to its toe edge [m].
        rate_hz: loop ticks a second.
    """

    def __init__(self, gait: Gait, stand_width: float, sole_half_length: float, rate_hz: float) -> None:
        self.gait = gait
        self.stand_width, self.sole_half_length = stand_width, sole_half_length
        self.rate = rate_hz
        # Ticks that the other foot, and that the same foot, stays down after one has landed.
        self._rests = tuple(round(seconds * rate_hz) for seconds in (gait.double_support_min_s, _AGAIN_S))

    @property
    def sight_s(self) -> float:
        """How far ahead the human must be seen for a step to be inserted [s]."""
        return UNHURRIED_S + _INSERT_SWING_S + self.gait.double_support_min_s

    def worth(self, window: HumanWindow, swing: Swing) -> bool:
        """Whether a human swing is a step, rather than a shuffle or a lifted heel."""
        start, end = window.foot(swing.side, swing.lift_s), window.foot(swing.side, swing.land_s)
        return bool(
            np.hypot(*(end - start)[:2]) > _WORTH_DISTANCE
            or abs(end[2] - start[2]) > _WORTH_YAW
            or window.foot_height(swing.side, swing.lift_s, swing.land_s) > _WORTH_LIFT
        )

    def target(
        self,
        window: HumanWindow,
        scaling: Scaling,
        side: int,
        lift_s: float,
        land_s: float,
        stance: Float,
        human_stance: Float,
        turn: tuple[float, float] = (0.0, 1.0),
    ) -> Foothold:
        """Where foot `side` belongs after a swing, given where the robot's other foot stands.

        Args:
            lift_s, land_s: source time of the human's swing [s]; its mean pelvis yaw is the heading, since the
                pelvis turns to and fro once a stride.
            stance: pose of the other foot, (4,) [m, m, m, rad].
            human_stance: where the human's other foot stood when the robot's came to stand for it, (2,) [m]: a foot
                that slides on while it stands takes the human along, and so it must the robot. NaN: where it is now.
            turn: the foot's heading before the swing [rad], which only counts where the second, how much of what the
                foot turns is to be turned now, is not 1.

        Returns:
            The nearest within the robot's limits.
        """
        gait = self.gait
        human = window.foot(side, land_s)
        if np.isnan(human_stance).any():
            human_stance = window.foot(1 - side, land_s)
        human_yaw = window.mean_heading(lift_s, land_s)
        inward = -1.0 if side == 0 else 1.0
        askew = np.clip(human_yaw + scaling.heading - stance[3], -gait.max_foot_yaw, gait.max_foot_yaw)
        # Toes that turn in meet the other foot sooner than toes that turn out.
        askew = max(askew, -gait.max_toe_in) if inward < 0 else min(askew, gait.max_toe_in)
        start_yaw, share = turn
        askew = share * askew + (1.0 - share) * (start_yaw - stance[3])
        yaw = stance[3] + askew
        cos, sin = np.cos(human_yaw), np.sin(human_yaw)
        dx, dy = human[:2] - human_stance[:2]
        forward, sideways = cos * dx + sin * dy, cos * dy - sin * dx
        forward = np.clip(gait.stride_factor * scaling.ratio * forward, -gait.max_stride, gait.max_stride)
        wanted = self.stand_width + scaling.ratio * (-inward * sideways - scaling.human_width)
        # A turned foot needs room for its corners.
        room = gait.lateral[0] + self.sole_half_length * abs(np.sin(askew))
        widest = max(room, gait.lateral[1])
        apart = np.clip(wanted, room, widest)
        # Far ahead and far aside at once is out of the leg's reach: an ellipse bounds both.
        aside = (apart - room) / max(widest - room, 1e-6)
        stretch = max(float(np.hypot(forward / gait.max_stride, aside)), 1.0)
        forward, apart = forward / stretch, room + (apart - room) / stretch
        # Who goes aside soon stands in his own way: what one foot could not go, the other is to make room for.
        owed = np.clip(-inward * (apart - wanted) / scaling.ratio, -_OWED, _OWED)
        human = human[:2] + owed * np.array([-sin, cos])
        frame = stance[3] + 0.5 * askew
        cos, sin = np.cos(frame), np.sin(frame)
        sideways = -inward * apart
        x, y = stance[0] + cos * forward - sin * sideways, stance[1] + sin * forward + cos * sideways
        return Foothold(np.array([x, y, 0.0, yaw]), human)

    def foothold(
        self,
        window: HumanWindow,
        scaling: Scaling,
        side: int,
        human_s: tuple[float, float],
        feet: Float,
        human_feet: Float,
        seconds: float,
    ) -> Foothold:
        """Where a step of foot `side` goes: where it belongs, as far as it can get to in time within the gait's limits.

        A foot that turns reaches less far, and where it stays behind its place in the frame that has turned, it may be
        more than a stride from the other foot, each step more. Then it turns less.

        Args:
            human_s: source time at which the human's foot lifts and lands [s].
            feet, human_feet: before it, (2, 4) and (2, 2), see `plan`.
            seconds: duration of the swing [s].
        """
        start, stance, longest = feet[side], feet[1 - side], self.gait.max_stride + _STRIDE_TOLERANCE
        for share in _TURN_SHARES:
            turn = (float(start[3]), share)
            own = self.target(window, scaling, side, *human_s, stance, human_feet[1 - side], turn)
            found = Foothold(self.within_reach(start, own.pose, stance, seconds), own.human)
            in_time = self.shortest_swing_s(start, found.pose) <= seconds + 1e-6
            if in_time and _ahead(stance, found.pose) <= longest:
                break
        return found

    def within_reach(self, start: Float, target: Float, stance: Float, seconds: float) -> Float:
        """A target that the foot can get to in time: brought back along the stride, as far as that goes, not across it.

        Args:
            start, target: poses of the swing foot, (4,); stance: pose of the other foot, (4,).
            seconds: duration of the swing [s].
        """
        gait = self.gait
        farthest = min(
            gait.swing_max_foot_speed * seconds, gait.swing_max_foot_acceleration * seconds**2 / PEAK_ACCELERATION
        )
        reach = farthest / self._turn_cost(start, target)
        travel = target[:2] - start[:2]
        if np.hypot(*travel) <= reach:
            return target
        yaw = 0.5 * (stance[3] + target[3])
        along = np.array([np.cos(yaw), np.sin(yaw)])
        across = travel - (travel @ along) * along
        left = np.sqrt(max(reach**2 - across @ across, 0.0))
        bounded = target.copy()
        bounded[:2] = start[:2] + across + np.clip(travel @ along, -left, left) * along
        return bounded

    def shortest_swing_s(self, start: Float, target: Float) -> float:
        """The shortest swing from which a target is within reach [s]; poses of the foot, (4,)."""
        gait, away = self.gait, float(np.hypot(*(target - start)[:2])) * self._turn_cost(start, target)
        by_acceleration = np.sqrt(away * PEAK_ACCELERATION / gait.swing_max_foot_acceleration)
        return float(max(away / gait.swing_max_foot_speed, by_acceleration))

    def _turn_cost(self, start: Float, target: Float) -> float:
        """The factor by which a swing reaches less far for what its foot turns."""
        return 1.0 + self.gait.swing_turn_cost * float(abs(target[3] - start[3]))

    def plan(
        self,
        window: HumanWindow,
        scaling: Scaling,
        feet: Float,
        frozen: list[Step],
        human_feet: Float,
        consumed: Float,
        free: Float,
        at_rest: bool,
        now: int,
        source_tick: int,
        put_off: int = 0,
    ) -> list[Step]:
        """The steps from `now` to the end of the window.

        Args:
            feet: pose of both feet on the ground (a foot in the air: where it will land), (2, 4).
            frozen: steps that are under way or settled; they are kept.
            human_feet: where the human's feet stood that these stand for, (2, 2) [m]; NaN where there are none.
            consumed: source time up to which each foot's human swings are done with, (2,) [s].
            free: ticks from which each foot may lift, (2,).
            at_rest: whether the robot has been standing still.
            now: first tick of the plan.
            source_tick: loop tick of source time 0.
            put_off: ticks by which a step that is not settled yet must keep more than the shortest notice.

        Returns:
            Steps in order of time, the frozen ones first.
        """
        gait = self.gait
        steps: list[Step] = []
        feet, human_feet, consumed = feet.copy(), human_feet.copy(), consumed.copy()
        pause, again = self._rests
        notice = UNHURRIED_S if at_rest and not frozen else NOTICE_S
        free = np.maximum(free, now + int(round(notice * self.rate)) + put_off)
        unhurried = now + int(round(UNHURRIED_S * self.rate)) + put_off
        for step in frozen:
            steps.append(step)
            feet[step.side], human_feet[step.side] = step.target, step.human
            consumed[step.side] = max(consumed[step.side], step.consumed_s)
            free = np.maximum(free, self.free(step.side, step.land))

        def tick(second: float) -> int:
            return source_tick + int(round(second * self.rate))

        end = tick(window.end_s)
        dropped = 0
        for swing in window.swings:
            if swing.land_s <= consumed[swing.side] + (_REDRAWN_S if swing.lift_s < consumed[swing.side] else 1e-6):
                continue
            if not self.worth(window, swing):
                continue
            lift = max(tick(swing.lift_s), int(free[swing.side]))
            if lift >= end:
                break
            if swing.landed and lift > tick(swing.land_s) + _TOO_LATE_S * self.rate:
                dropped += 1
                consumed[swing.side] = swing.land_s
                human_feet[swing.side] = window.foot(swing.side, swing.land_s)[:2]
                continue
            until = np.full(2, lift - pause)
            until[swing.side] = lift - again
            insertable = np.maximum(free, unhurried)
            self._insert(window, scaling, steps, feet, human_feet, consumed, insertable, until, source_tick)
            if steps:
                free = np.maximum(free, self.free(steps[-1].side, steps[-1].land))
                lift = max(lift, int(free[swing.side]))
            land_s = swing.land_s
            land = tick(land_s) if swing.landed else max(end, tick(swing.lift_s + _UNKNOWN_SWING_S))
            # A longer swing is a farther one: take of the human's double support what the robot's does not need.
            latest = min((tick(s.lift_s) for s in window.swings if s.lift_s > land_s), default=land) - pause
            land = max(land, min(latest, land + int(round(_LATER_S * self.rate))))
            land = max(land, lift + int(np.ceil(gait.swing_min_s * self.rate)))
            human_s, seconds = (swing.lift_s, land_s), (land - lift) / self.rate
            hold = self.foothold(window, scaling, swing.side, human_s, feet, human_feet, seconds)
            # A swing whose end is not seen yet is done with when the robot's foot has landed.
            consumed_s = land_s if swing.landed else max(land_s, (land - source_tick) / self.rate)
            start = feet[swing.side].copy()
            step = Step(swing.side, lift, land, start, hold.pose, consumed_s, dropped, human=hold.human)
            dropped = 0
            steps.append(step)
            feet[swing.side], human_feet[swing.side] = hold.pose, hold.human
            consumed[swing.side] = consumed_s
            free = np.maximum(free, self.free(step.side, step.land))
        until = np.full(2, end - pause)
        insertable = np.maximum(free, unhurried)
        self._insert(window, scaling, steps, feet, human_feet, consumed, insertable, until, source_tick)
        if steps and not frozen:
            steps[0] = replace(steps[0], notice_s=max(notice, steps[0].notice_s))
        return steps

    def free(self, side: int, landed: float) -> Float:
        """Ticks from which each foot may lift after foot `side` landed, (2,)."""
        pause, again = self._rests
        ticks = np.full(2, landed + pause)
        ticks[side] = landed + again
        return ticks

    def gather(self, steps: list[Step], feet: Float, after: int) -> list[Step]:
        """The steps, and one more that sets the feet side by side where they would not be.

        Args:
            feet: pose of both feet before the steps, (2, 4).
            after: first tick from which the robot has nothing else to do.
        """
        feet = feet.copy()
        for step in steps:
            feet[step.side] = step.target
            after = max(after, step.land)
        left, right = feet
        cos, sin = np.cos(right[3]), np.sin(right[3])
        beside = right + np.array([-sin * self.stand_width, cos * self.stand_width, 0.0, 0.0])
        if np.hypot(*(left - beside)[:2]) < _ASIDE and abs(left[3] - right[3]) < _ASKEW:
            return steps
        lift = after + int(round(UNHURRIED_S * self.rate))
        # The robot's last step must end beside the other foot: far or turned, it takes its time.
        land = lift + int(np.ceil(max(_INSERT_SWING_S, self.shortest_swing_s(left, beside)) * self.rate))
        # Nothing of the human's is done with by it.
        last = Step(0, lift, land, left.copy(), beside, -np.inf, inserted=True, notice_s=UNHURRIED_S)
        return [*steps, last]

    def _insert(
        self,
        window: HumanWindow,
        scaling: Scaling,
        steps: list[Step],
        feet: Float,
        human_feet: Float,
        consumed: Float,
        free: Float,
        until: Float,
        source_tick: int,
    ) -> None:
        """Append steps that set feet right, if there is time for them.

        Args:
            free, until: ticks from which each foot may lift, and to which it must have landed, (2,).
        """
        pause, _ = self._rests
        ticks = int(round(_INSERT_SWING_S * self.rate))
        lift = int(np.ceil(free.min()))
        while lift + ticks <= until.max():
            second = (lift - source_tick) / self.rate
            frame = int(window.frame_before(np.array([second]))[0])
            if not window.contacts[frame].all():
                lift += max(1, int(self.rate / window.motion.fps))
                continue
            belongs = [
                self.target(window, scaling, side, second, second, feet[1 - side], human_feet[1 - side]).pose
                for side in (0, 1)
            ]
            gaps = np.array(belongs) - feet
            apart = np.linalg.norm(gaps[:, :2], axis=1)
            errors = np.maximum(np.abs(gaps[:, 3]) / _INSERT_YAW, apart / _INSERT_DISTANCE)
            wrong = (errors > 1.0) & (lift + ticks <= until)
            if not wrong.any():
                lift += ticks // 2
                continue
            if not (wrong & (free <= lift)).any():
                lift = int(np.ceil(free[wrong].min()))
                continue
            side = int(np.argmax(np.where(wrong & (free <= lift), errors, 0.0)))
            start, land, done = feet[side].copy(), lift + ticks, consumed[side]
            # Another clip's human may stand in a stride the other way: the next step, of either foot, does the rest.
            hold = self.foothold(window, scaling, side, (second, second), feet, human_feet, ticks / self.rate)
            own = Step(side, lift, land, start, hold.pose, done, inserted=True, notice_s=UNHURRIED_S, human=hold.human)
            steps.append(own)
            feet[side], human_feet[side] = hold.pose, hold.human
            free = np.maximum(free, self.free(side, land))
            lift = land + pause


def _ahead(stance: Float, pose: Float) -> float:
    """How far a foot is before or behind the other, in the frame between both [m]."""
    yaw = 0.5 * (stance[3] + pose[3])
    return float(abs(np.cos(yaw) * (pose[0] - stance[0]) + np.sin(yaw) * (pose[1] - stance[1])))
