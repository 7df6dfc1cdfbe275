"""`ServoCommand`: servo goals from a reference with its torque, and the clamp that bounds them.

A position servo makes the torque kp (goal - q) - b q'. The goal at which it makes `torque` on the reference is
therefore q_ref + (torque + b q_ref') / kp. The goal may be far ahead of the joint. Two things are bounded: the torque
that the goal implies at the joint's present position and speed, with room for a foot that strikes the ground before the
goal has arrived (`foot_strikes.py`), and the goal itself by the joint's limits. If a joint is outside its limits when
torque is switched on, its goals begin there and from then on only move inwards.

A cap lowers what the goal of a joint may imply below what its servo can give; it raises nothing.

A disturbance (a joint that answers again elsewhere than was assumed, a stall of the loop, the start of a stream) makes
the next goal differ from the one before by more than the plan moves. This difference is kept as an offset, which decays
at a bounded speed. Without a disturbance it is zero: a bound on the goal itself would destroy a walk, whose goals move
with up to 25 rad/s.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.masks import some
from flexmotion.streamer.control.soft_following import SoftFollowing

Float = NDArray[np.float64]

BRAKING_SHARE = 0.8
"""Share of the stall torque that a goal may imply while the servo brakes. The rest covers the change of the joint's
speed in the 4 ms between its measurement and the goal's arrival (with 0.9 three goals in a million were outside the
envelope); what a foot that strikes changes comes on top (`FootStrikes`). Less costs balance: of 21 walking clips three
fell with 0.75 and swings of 6.8 m/s², none with 0.8 and 7 m/s²."""
BRAKING_SPEED = 0.3
"""Joint speed from which the braking torque is allowed in full [rad/s]. Near standstill only the usable torque is: a
foot's impact may reverse the joint within a tick, and the goal must then still be inside the envelope."""
PUSHED_BRAKING_SHARE = 0.7
"""The same for a robot that answers a push beyond its plan (`push_correction.py`): its joints are made faster by up to
.8 rad/s in a tick. With `BRAKING_SHARE` the goals of two of 180 pushes implied up to 1.02 of the stall torque."""
IMPACT_BRAKING_SHARE = 0.5
"""The same for a robot that gets up, or sways and has no IMU: the ground stops joints while a goal is under way, by up
to 2.1 rad/s (back-EMF of XM430-W350: 1.8 N·m). With `BRAKING_SHARE` two goals in 20 rises from the front were outside
the envelope."""

STOPPED_SHARE = 0.9
"""Most that the goal of a robot that gets up, or is frozen, implies for a joint that is stopped under way, over the
stall torque: the joint goes on for a moment. In one of 40 rises the floor stopped a hip from 3.8 rad/s in a tick, with
1.3 times it. The same for joints of a robot that walks once a foot has struck as foreseen; strikes add up to .4 N·m
more than that."""
CAP_RISE_S = 0.2
"""Time in which a cap rises to the stall torque [s]: as long as a soft joint takes to become stiff."""

DECAY_SHARE = 0.25
"""Speed at which an offset decays, over the servo's no-load speed: the rest is left for the motion of the plan."""

_BLIND_SHARE, _DOUBT, _TRUST = 0.5, 0.1, 0.02
"""Least share of the envelope that is used while a joint's position is assumed and therefore uncertain; it shrinks by
`_DOUBT` with every missing reading and grows by `_TRUST` with every good one. The planned torque is always allowed."""

SUPPLY_MARGIN = 0.2
"""Margin around the servo's rated supply within which a reading is valid, as a share: sag under load, overvoltage."""
_SUPPLY_SLEW = 1.0
"""Greatest change of the supply that goals are computed for, in nominal supplies per second: a single wrong reading
changes them by less than a servo tick."""


class ServoCommand:
    """Computes and clamps goals; allocates nothing that grows.

    Args:
        delay_s: from a measurement to the arrival of the goals computed from it [s].
        turns: ticks within which the driver reads every joint once.

    Attributes:
        goal: servo goals, (n,) [rad].
        offset: what disturbances have left in the goals, (n,) [rad].
        cap: greatest torque that the goal of a joint may imply, (n,) [N·m]; infinite: what its servo can give.
        softness: with which share of their stiffness the joints follow.
        position_clamps, torque_clamps: how many joints were clamped in the last tick.
    """

    def __init__(self, robot: Robot, delay_s: float, turns: int = 1) -> None:
        self.robot, self.delay = robot, delay_s
        self.goal = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
        self.offset = np.zeros(robot.n)
        self.cap = np.full(robot.n, np.inf)
        self.softness = SoftFollowing(robot.n, robot.rate_hz, turns)
        self.position_clamps = self.torque_clamps = 0
        self._velocity = np.zeros(robot.n)
        nominal = robot.nominal_voltage
        self._least_supply = np.array([servo.min_voltage for servo in robot.servos]) / nominal * (1 - SUPPLY_MARGIN)
        self._most_supply = np.array([servo.max_voltage for servo in robot.servos]) / nominal * (1 + SUPPLY_MARGIN)
        self._supply, self._trust = np.full(robot.n, np.nan), np.ones(robot.n)
        self._doubts = False  # trust is below 1 somewhere
        self._impacts, self._braking = False, BRAKING_SHARE
        self._now_and_later = np.zeros((2, 2, robot.n))
        self._strikes: tuple[Float, Float] | None = None  # torque that strikes add to what goals imply, each way
        self._decay = DECAY_SHARE * robot.no_load_speed / robot.rate_hz
        self._rejoins = np.zeros(robot.n, np.bool_)
        self._acceleration = robot.usable_torque * robot.model.dof_invweight0[robot.dof_address]
        self._cap_step = robot.stall_torque / (CAP_RISE_S * robot.rate_hz)
        self._silent_s, self._read_s = np.zeros(robot.n), 1.0 / (robot.rate_hz * turns)

    def reset(self, position: Float) -> None:
        """Begin at the joints' positions, (n,) [rad], which are the goals until the first update."""
        np.copyto(self.goal, position)
        self._velocity[:] = self.offset[:] = 0.0
        self.softness.reset()
        self.cap.fill(np.inf)
        self._trust[:] = 1.0
        self._doubts = False
        self._supply[:] = np.nan
        self._rejoins[:] = False
        self._silent_s[:] = 0.0

    def take_cap(self, cap: Float) -> None:
        """Take the caps of this tick, (n,) [N·m]: lower ones at once, higher ones in `CAP_RISE_S` at most.

        Whatever holds a capped joint back is not hit by all of the torque when the cap is let go.
        """
        np.minimum(cap, self.cap + self._cap_step, out=self.cap)
        np.copyto(self.cap, cap, where=self.cap >= self.robot.stall_torque)

    def rejoin(self) -> None:
        """The next goals begin at those in effect, which the reference may have left: a stream begins, or was late."""
        self._rejoins[:] = True

    def take_pins(self, pins: Float) -> None:
        """Servos were pinned to `pins`, (n,) [rad], NaN for the others: their next goals begin there."""
        pinned = np.isfinite(pins)
        if not some(pinned):
            return
        np.copyto(self.goal, pins, where=pinned)
        np.copyto(self.softness.way, 0.0, where=pinned)
        self._rejoins |= pinned

    def update(
        self,
        q: Float,
        qd: Float,
        torque: Float,
        measured: RobotState,
        expected: Float | None = None,
        *,
        stiffness: Float | None = None,
        struck: Float | None = None,
        slow: bool = False,
        pushed: bool = False,
        impacts: bool = False,
    ) -> Float:
        """Goals for a reference.

        Args:
            q, qd, torque: the reference, (n,) each [rad, rad/s, N·m].
            measured: the joints' state.
            expected: where joints were assumed to be whose position is known again, (n,) [rad]; NaN for the others.
            stiffness: share of the robot file's that is asked for, (n,) in (0, 1]; None: all of it.
            struck: least and greatest change of the joints' speeds by feet that may strike the ground before the goals
                have arrived, (2, n) [rad/s]; None: no foot comes down.
            slow: the reference is a slow move, which silent joints follow for as long as it takes (a robot whose bus is
                lost is lowered).
            pushed: the robot answers a push, and goals imply less torque while the servo brakes.
            impacts: the ground may stop any joint at any time: goals imply less torque while the servo brakes.

        Returns:
            `goal`, (n,) [rad].
        """
        robot = self.robot
        self._impacts = impacts
        self._braking = IMPACT_BRAKING_SHARE if impacts else PUSHED_BRAKING_SHARE if pushed else BRAKING_SHARE
        supply = self._supply_of(measured)
        kp = robot.kp * supply
        goal = q + (torque + robot.back_emf * qd) / kp
        self._strikes = None if struck is None else self._torque_of_strikes(struck, kp)
        usable, back = robot.usable_torque, None if expected is None else np.isfinite(expected)
        silent = some(measured.stale)
        if silent or self._doubts:
            self._trust += np.where(measured.stale > 0, -_DOUBT, _TRUST)
            np.minimum(np.maximum(self._trust, _BLIND_SHARE, out=self._trust), 1.0, out=self._trust)
            self._doubts = bool((self._trust < 1.0).any())
            if self._doubts:
                usable = np.maximum(self._trust * usable, np.minimum(np.abs(torque), usable))
        self._skip_assumed(measured, expected)
        lowest, highest = self._bounds(measured.position, measured.velocity, kp, supply, usable)
        bounded = np.maximum(np.minimum(goal, highest), lowest)
        self.torque_clamps = int(np.count_nonzero(bounded != goal))
        self._soften(bounded, (lowest, highest), torque, measured, kp, stiffness)
        if back is not None:
            back &= ~self._rejoins  # those begin at their goals anyway
        self._settle(bounded)
        if expected is not None and back is not None and some(back):
            lowest, highest = self._bounds(expected, qd, kp, supply, usable)
            assumed = np.maximum(np.minimum(goal, highest), lowest)
            self.offset[back] += (assumed - bounded)[back]
        np.copyto(self._velocity, measured.velocity)
        # One reference that is no number must not stay in the offset, which would hold the joint for good.
        if some(self.offset):
            np.copyto(self.offset, 0.0, where=~np.isfinite(self.offset))
        if some(self.offset) and self.offset.any():
            lowest, highest = self._envelope(measured.position, measured.velocity, kp, supply, None)
            np.subtract(np.minimum(np.maximum(bounded + self.offset, lowest), highest), bounded, out=self.offset)
            bounded += self.offset
        if silent and not slow:
            self._bound_unsure(bounded, torque, measured, kp, supply)
        elif some(self._silent_s):
            self._silent_s[:] = 0.0
        # Outside its limits a goal may only move inwards.
        lower, upper = np.minimum(robot.lower, self.goal), np.maximum(robot.upper, self.goal)
        limited = np.minimum(np.maximum(bounded, lower), upper)
        self.position_clamps = int(np.count_nonzero(limited != bounded))
        # A goal that is not finite is not sent: the servo keeps the goal that it has.
        np.copyto(self.goal, limited, where=np.isfinite(limited))
        return self.goal

    def held(self, measured: RobotState, expected: Float | None = None) -> Float:
        """Goals of a robot that is frozen: the last ones, as far as they are inside the envelope.

        What moves a joint away from its goal makes the goal imply more: the robot may fall as it is. A silent joint
        keeps its goal.

        Args:
            measured: the joints' state.
            expected: as in `update`.

        Returns:
            (n,) [rad]. `goal` stays what it is, and what the joints go back to.
        """
        robot, supply = self.robot, self._supply_of(measured)
        kp = robot.kp * supply
        self._skip_assumed(measured, expected)
        drag, most = robot.back_emf / kp, np.minimum(STOPPED_SHARE * robot.stall_torque * supply, self.cap) / kp
        later = measured.velocity + (measured.velocity - self._velocity)
        moved = measured.position + self.delay * (measured.velocity + later)
        np.copyto(self._velocity, measured.velocity)
        goal = self.goal.copy()
        for middle in (moved + drag * later, measured.position + drag * measured.velocity):
            goal = np.minimum(np.maximum(goal, middle - most), middle + most)
        # Outside its limits a goal may only move inwards.
        goal = np.minimum(np.maximum(goal, np.minimum(robot.lower, self.goal)), np.maximum(robot.upper, self.goal))
        return np.where((measured.stale > 0) | ~np.isfinite(goal), self.goal, goal)

    def _skip_assumed(self, measured: RobotState, expected: Float | None) -> None:
        """The speed of a joint whose reading was assumed has not changed by the difference to it."""
        if some(measured.stale):
            np.copyto(self._velocity, measured.velocity, where=measured.stale > 0)
        if expected is not None:
            np.copyto(self._velocity, measured.velocity, where=np.isfinite(expected))

    def _settle(self, bounded: Float) -> None:
        """Let the offsets decay; after `rejoin` they are the way from the goals in effect, where that is a jump.

        An offset that is on its way goes on: a loop that is late again and again would keep it for good.
        """
        under_way = self.offset != 0.0
        if some(under_way):
            np.subtract(self.offset, np.clip(self.offset, -self._decay, self._decay), out=self.offset)
        if some(self._rejoins):
            away = self.goal - bounded
            begins = self._rejoins & np.isfinite(away)
            jumps, step = np.abs(away) > self._decay, np.clip(away, -self._decay, self._decay)
            np.copyto(self.offset, np.where(jumps, away - np.where(under_way, step, 0.0), 0.0), where=begins)
            self._rejoins[:] = False

    def _bound_unsure(self, goal: Float, torque: Float, measured: RobotState, kp: Float, supply: Float) -> None:
        """Bound the goals of silent joints to those inside the envelope wherever the joint may be, in place.

        A silent joint is assumed to move as planned. By the time t of the next goal it may be faster or slower than
        that by a t, and elsewhere by a t² / 2, where a is the acceleration that its servo's torque gives it. Where the
        planned torque has no room in what this leaves of the envelope, no new goal leaves: the servo keeps the one that
        it has, which was inside when it was sent, and the next ones begin there. Between turns a joint is not silent.

        Args:
            goal: new goals, (n,) [rad].
            torque: of the reference, (n,) [N·m].
        """
        missing = measured.stale > 0
        self._silent_s[:] = np.where(missing, self._silent_s + self._read_s, 0.0)
        until = self._silent_s + self._read_s  # of the next goal
        robot, faster = self.robot, self._acceleration * until
        away = 0.5 * faster * until
        most = robot.stall_torque * supply - kp * away - robot.back_emf * faster
        middle, room = measured.position + robot.back_emf * measured.velocity / kp, np.maximum(most, 0.0) / kp
        np.copyto(goal, np.clip(goal, middle - room, middle + room), where=missing)
        held = missing & (most < np.minimum(np.abs(torque), robot.usable_torque * supply))
        np.copyto(goal, self.goal, where=held)
        self._rejoins |= held

    def _supply_of(self, measured: RobotState) -> Float:
        """Supply that goals are computed for, over the nominal one; nominal where it is not known, (n,)."""
        supply = measured.voltage / self.robot.nominal_voltage
        believed = (supply >= self._least_supply) & (supply <= self._most_supply)
        supply = np.where(believed, supply, 1.0)
        step = _SUPPLY_SLEW / self.robot.rate_hz
        known = np.isfinite(self._supply)
        np.copyto(self._supply, np.where(known, np.clip(supply, self._supply - step, self._supply + step), supply))
        return self._supply

    def _soften(
        self,
        bounded: Float,
        bounds: tuple[Float, Float],
        torque: Float,
        measured: RobotState,
        kp: Float,
        stiffness: Float | None,
    ) -> None:
        """Soften goals in place; they stay between their bounds, and those of silent joints become stiff at once."""
        softness, silent = self.softness, measured.stale > 0
        self._rejoins |= silent & (softness.share < 1.0)
        speed = measured.velocity
        arrives = measured.position + 2.0 * self.delay * speed
        relaxed = arrives + (torque + self.robot.back_emf * speed) / kp
        softness.soften(bounded, np.maximum(np.minimum(relaxed, bounds[1]), bounds[0]), stiffness, silent)

    def _bounds(self, position: Float, velocity: Float, kp: Float, supply: Float, usable: Float) -> tuple[Float, Float]:
        """Lowest and highest goal whose torque a servo may make at this state, (n,) each [rad].

        The measurement is old and the goal takes time to arrive: it must be inside the envelope for the joint as it was
        measured, and as it will be if its speed changes on at the same rate. Where impacts are expected it must be for
        a joint that the floor stops, too: a goal that counts on the back EMF of its speed implies more without it.
        """
        later = velocity + (velocity - self._velocity)
        positions, velocities = self._now_and_later
        positions[0], positions[1] = position, position + self.delay * (velocity + later)
        velocities[0], velocities[1] = velocity, later
        lows, highs = self._envelope(positions, velocities, kp, supply, usable)
        lowest, highest = np.maximum(*lows), np.minimum(*highs)
        if self._impacts:
            room = STOPPED_SHARE * self.robot.stall_torque * supply / kp
            lowest, highest = (np.clip(bound, position - room, position + room) for bound in (lowest, highest))
        apart = lowest > highest
        if some(apart):  # a fast joint with a low cap: no goal is within it at both, this one is as it was measured
            apart &= np.isfinite(self.cap)
            nearest = np.clip(lowest, lows[0], highs[0])
            np.copyto(lowest, nearest, where=apart)
            np.copyto(highest, nearest, where=apart)
        return lowest, highest

    def _torque_of_strikes(self, struck: Float, kp: Float) -> tuple[Float, Float]:
        """By how much strikes lower and raise the torque that a goal implies, at most, (n,) each [N·m]."""
        per_speed = self.robot.back_emf + kp * self.delay
        return per_speed * struck[1], -per_speed * struck[0]

    def _envelope(
        self, position: Float, velocity: Float, kp: Float, supply: Float, usable: Float | None
    ) -> tuple[Float, Float]:
        """Lowest and highest goal whose torque a servo may make at these positions and velocities, (..., n) each [rad].

        What a foot that strikes adds is left free: at most all that the servo gives, so that there is always a goal
        between the two at one state.

        Args:
            usable: torque while it drives, at nominal supply [N·m]; None: as much as while it brakes.
        """
        robot = self.robot
        braking = np.minimum(self._braking * robot.stall_torque * supply, self.cap)
        drag = robot.back_emf * velocity
        if usable is None:
            most = np.minimum(np.maximum(braking, robot.usable_torque * supply), self.cap)
            lower, upper = self._struck(-most, most, robot.stall_torque * supply)
            return position + (lower + drag) / kp, position + (upper + drag) / kp
        usable = np.minimum(usable * supply, self.cap)
        more = np.minimum(braking - usable, 0.0) if self._impacts else np.maximum(braking - usable, 0.0)
        along = np.minimum(np.maximum(velocity / BRAKING_SPEED, -1.0), 1.0)
        upper = usable + more * np.maximum(-along, 0.0)
        lower = -usable - more * np.maximum(along, 0.0)
        lower, upper = self._struck(lower, upper, robot.stall_torque * supply)
        return position + (lower + drag) / kp, position + (upper + drag) / kp

    def _struck(self, lower: Float, upper: Float, stall: Float) -> tuple[Float, Float]:
        """Bounds of the torque that leave room for what strikes add, (..., n) each [N·m]; `stall` at this supply."""
        if self._strikes is None:
            return lower, upper
        most = np.minimum(STOPPED_SHARE * stall, self.cap)
        lowers, raises = self._strikes
        return np.maximum(lower, np.minimum(lowers - most, 0.0)), np.minimum(upper, np.maximum(most - raises, 0.0))
