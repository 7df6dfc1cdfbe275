"""Human motion to this robot's motion: one `Plan` from a state and the human's next second.

Causal and streaming: a plan uses the past only through the state it resumes from, and the future only as far as the
frames reach that it is given. Every plan ends in a balanced stop on two feet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.ndimage import minimum_filter1d
from scipy.signal import butter, sosfilt, sosfilt_zi
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import StreamSettings
from flexmotion.human.contacts import ContactDetector
from flexmotion.human.motion import Motion
from flexmotion.retarget import balance, posture
from flexmotion.retarget.footsteps import FootstepPlanner, Scaling, Step, settled_from
from flexmotion.retarget.human import HumanWindow
from flexmotion.retarget.joining import Absorbed, JoinAbsorber
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.schedule import SHIFT_S, Schedule
from flexmotion.retarget.state import StateLayout, pack_steps
from flexmotion.retarget.whole_body import POSTURE, WholeBody
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

_STOP_S = 0.8
"""Length of the stop tail after the last step has landed: five time constants of a small robot's pendulum."""
_AT_REST_S = 0.4
"""After this long on both feet the weight has come to rest between them."""
_PUT_OFF_S = (0.1, 0.2)
"""How much longer notice a new step may be given where the weight could not be moved in time; each try costs a
twentieth of a plan."""
_TORQUE_STRIDE = 2
"""Torques, low-passed at the frequency below, are worked out at every second row and interpolated."""
_ACCELERATION_CUTOFF_HZ = 20.0
"""Low-pass of the acceleration: keeps the differences' noise out of the torques."""


@dataclass(frozen=True)
class _View:
    """What a plan follows: the human as far as it was given, on the loop's clock.

    Attributes:
        window: features of the frames; None where there are none.
        scaling: human to robot.
        ticks: loop tick of each row, (T,); seconds: its source time, (T,) [s], NaN without a source.
        follow: rows that follow the human; the rest is the stop tail.
        whole: whether they reach as far as was asked for, so that the human may go on after them.
    """

    window: HumanWindow | None
    scaling: Scaling
    source_tick: float
    tick: int
    follow: int
    whole: bool


@dataclass(frozen=True)
class _Walk:
    """Steps and what follows from them.

    Attributes:
        ticks: loop tick of each row, (T,).
    """

    steps: list[Step]
    ticks: Float
    schedule: Schedule
    balance: Absorbed


class Retargeter:
    """Turns windows of human motion into plans for one robot.

    Args:
        robot: the robot file; its legs must be of the closed-form kind (see `legs.Leg`).
        settings: how far a plan follows the human before its stop tail, and how joins are absorbed.

    Raises:
        RetargetError: the robot's legs cannot be solved, or plans do not reach far enough for its steps.
    """

    def __init__(self, robot: Robot, settings: StreamSettings) -> None:
        self.robot, self.gait, self.rate = robot, robot.gait, robot.rate_hz
        self.dt = 1.0 / robot.rate_hz
        self.settings = settings
        self.horizon = int(round(settings.horizon_s * self.rate))
        self.body = WholeBody(robot)
        self.layout = StateLayout(robot.n, len(self.body.upper.joints))
        self.follower = posture.follower(robot, self.body)
        self.footsteps = FootstepPlanner(
            self.gait, self.body.stand_width, float(robot.sole_half_size[:, 0].max()), self.rate
        )
        if settings.horizon_s < self.footsteps.sight_s:
            raise RetargetError(
                f"stream settings: horizon_s is {settings.horizon_s:g}, expected at least {self.footsteps.sight_s:g}: "
                f"{robot.name} cannot set its feet right after a human whom it sees no further ahead"
            )
        walking = self._upright(self.gait.walk_hip_height)
        base, q, _, _ = self.body.solve(self.body.home_feet[None], np.zeros((1, 2)), walking[None], np.zeros(2), 4)
        self.com_height = float(self.body.dynamics.centre_of_mass(base, q)[0, 2])
        self._smoother = butter(2, _ACCELERATION_CUTOFF_HZ, fs=self.rate, output="sos")
        self._settled = sosfilt_zi(self._smoother)[:, :, None]
        self.omega = float(np.sqrt(GRAVITY / self.com_height))
        self.absorber = JoinAbsorber(robot.sole_half_size.min(axis=0), self.omega, self.dt, settings.dcm_absorb_s)
        self._put_off = [int(round(seconds * self.rate)) for seconds in _PUT_OFF_S]

    def _upright(self, height: float) -> Float:
        return np.concatenate([[height, 0.0, 0.0, 0.0], self.robot.stand_pose[self.body.upper.joints]])

    def standing(self) -> Float:
        """State of the robot at rest, hips at standing height, feet around the origin, facing +x, (S,)."""
        layout, body = self.layout, self.body
        state = np.zeros(layout.size)
        channels = self._upright(self.gait.stand_hip_height)
        base, q, offset, _ = body.solve(body.home_feet[None], np.zeros((1, 2)), channels[None], np.zeros(2), 6)
        layout.set(state, "feet", body.home_feet)
        layout.set(state, "com_offset", offset[0])
        layout.set(state, "position", channels)
        layout.set(state, "q", np.stack([q[0], q[0]]))
        layout.set(state, "base", np.stack([base[0], base[0]]))
        layout.set(state, "steps", pack_steps([]))
        layout.set(state, "consumed", np.full(2, -np.inf))
        layout.set(state, "landed", -1e9)
        for name in ("source_tick", "heading"):
            layout.set(state, name, np.nan)
        layout.set(state, "yaws", np.full(3, np.nan))
        layout.set(state, "human_feet", np.full((2, 2), np.nan))
        layout.set(state, "detector", ContactDetector().initial())
        return state

    def next_frame(self, state: Float, tick: int, fps: float) -> int:
        """Index of the first source frame that a plan resumed from `state` at `tick` must be given.

        It is the frame at or before that tick: between it and the next the human is interpolated.
        """
        source_tick = self.layout.scalar(state, "source_tick")
        if np.isnan(source_tick):
            return 0
        return max(int(np.floor((tick - source_tick) / self.rate * fps + 1e-6)), 0)

    def plan(
        self,
        state: Float,
        motion: Motion | None,
        first_frame: int,
        tick: int,
        *,
        horizon: int | None = None,
        checkpoint: Callable[[], None] = lambda: None,
    ) -> Plan:
        """The plan that starts at `tick`.

        Args:
            state: where to resume, (S,): `standing()` or a row of an earlier plan's `states`.
            motion: the human's frames from source frame `first_frame` on; None or empty: stop.
            first_frame: index of the motion's first frame on the source's own clock (frame 0 at its time 0).
            tick: loop tick of the first row.
            horizon: rows that may follow the human; the settings' where not given.
            checkpoint: called every few milliseconds; what it raises ends the work.

        Returns:
            A plan of up to the horizon, as far as the motion reaches, and its stop tail.
        """
        layout = self.layout
        state = state.copy()
        view = self._view(state, motion, first_frame, tick, self.horizon if horizon is None else horizon)
        checkpoint()
        walk = self._walk(state, view)
        checkpoint()
        steps, ticks, schedule, zmp, dcm = walk.steps, walk.ticks, walk.schedule, walk.balance.zmp, walk.balance.dcm
        com, com_velocity = balance.centre_of_mass(dcm, layout.get(state, "com"), self.omega, self.dt)
        seconds = (ticks - view.source_tick) / self.rate
        known = seconds[: view.follow]
        targets, hands = self._targets(state, view, schedule, known, checkpoint)
        targets[:, 0] = np.minimum(targets[:, 0], self._reachable_height(state, schedule, com))
        position, velocity, slow, soft = self.follower.follow(
            targets, layout.get(state, "position"), layout.get(state, "velocity")
        )
        base, q, offset, short = self.body.solve(schedule.feet, com, position, layout.get(state, "com_offset"))
        checkpoint()
        outside = (q < self.robot.lower) | (q > self.robot.upper)
        q = np.clip(q, self.robot.lower, self.robot.upper)
        qd, qdd, torque = self._torque(state, schedule, base, q)
        checkpoint()
        upper = slice(len(POSTURE), None)
        fresh = [step for step in steps if step.lift >= tick]
        rows = len(ticks)
        plan = Plan(
            start_tick=tick,
            stop_row=view.follow,
            source_s=np.where(np.arange(rows) < view.follow, seconds, np.nan),
            q=q,
            qd=qd,
            qdd=qdd,
            torque=torque,
            contacts=schedule.contacts,
            feet=schedule.feet,
            base=base,
            com=np.column_stack([com, np.full(rows, self.com_height)]),
            com_velocity=np.column_stack([com_velocity, np.zeros(rows)]),
            zmp=zmp,
            dcm=dcm,
            load_share=schedule.share,
            states=np.broadcast_to(state, (rows, layout.size)).copy(),
            hand_error=self._hand_error(view, q, hands),
            repairs={
                "position": outside.sum(axis=1) + (short > 1e-4),
                "speed": slow[:, upper].sum(axis=1),
                "acceleration": soft[:, upper].sum(axis=1),
                "torque": np.zeros(rows, np.int64),
            },
            steps=fresh,
            human=motion,
            human_first_frame=first_frame,
        )
        self._remember(plan, state, view, steps, ticks, position, velocity, offset)
        return plan

    def _view(self, state: Float, motion: Motion | None, first_frame: int, tick: int, horizon: int) -> _View:
        """Read the frames; a state that has never seen a human starts its clock, heading and feet here."""
        layout = self.layout
        source_tick = layout.scalar(state, "source_tick")
        if motion is None or len(motion) < 2:
            return _View(None, Scaling(1.0, 0.0, 0.0), source_tick, tick, 0, False)
        yaws = layout.get(state, "yaws")
        start = np.isnan(source_tick)
        window = HumanWindow(
            motion, first_frame / motion.fps, layout.get(state, "detector"), None if start else yaws.copy()
        )
        if start:
            lead = self.settings.lead_in_s - first_frame / motion.fps
            source_tick = float(tick + round(lead * self.rate))
            robot_yaw = layout.get(state, "feet")[:, 3].mean()
            layout.set(state, "source_tick", source_tick)
            layout.set(state, "heading", robot_yaw - window.yaws[0, 2])
            layout.set(state, "yaws", window.yaws[0])
            layout.set(state, "consumed", np.full(2, window.times[0]))
        # Feet that stand for nobody's, at the start and after a stop, stand for this human's from here on.
        human_feet = layout.get(state, "human_feet")
        layout.set(state, "human_feet", np.where(np.isnan(human_feet), window.feet[0, :, :2], human_feet))
        scaling = Scaling(
            ratio=self.body.leg_length / motion.body.leg,
            heading=layout.scalar(state, "heading"),
            human_width=motion.body.segments.hip_width,
        )
        follow = int(np.floor(source_tick + window.end_s * self.rate + 1e-6)) + 1 - tick
        follow = min(max(follow, 0), horizon)
        return _View(window if follow else None, scaling, source_tick, tick, follow, follow == horizon)

    def _walk(self, state: Float, view: _View) -> _Walk:
        """Steps and balance; a step that would have to come too suddenly for the soles is put off."""
        found = self._try_walk(state, view, 0)
        if view.window is not None:
            for put_off in self._put_off:
                if found.balance.excess <= 1.0:
                    break
                later = self._try_walk(state, view, put_off)
                if later.balance.excess < found.balance.excess:
                    found = later
        return found

    def _try_walk(self, state: Float, view: _View, put_off: int) -> _Walk:
        steps = self._steps(state, view, put_off)
        last = max([view.tick + view.follow, *[step.land for step in steps]])
        ticks = view.tick + np.arange(last - view.tick + int(round(_STOP_S * self.rate)), dtype=float)
        known = (ticks[: view.follow] - view.source_tick) / self.rate
        schedule = self._schedule(state, view, steps, ticks, known)
        return _Walk(steps, ticks, schedule, self._balance(state, schedule))

    def _steps(self, state: Float, view: _View, put_off: int) -> list[Step]:
        layout = self.layout
        frozen = layout.steps(state)
        feet = layout.get(state, "feet").copy()
        feet[:, 2] = 0.0
        if view.window is None:
            # Whatever human comes next may be somewhere else.
            layout.set(state, "human_feet", np.full((2, 2), np.nan))
            frozen = [replace(step, human=np.full(2, np.nan)) for step in frozen]
            return self.footsteps.gather(frozen, feet, view.tick)
        landed = layout.scalar(state, "landed")
        steps = self.footsteps.plan(
            view.window,
            view.scaling,
            feet,
            frozen,
            layout.get(state, "human_feet"),
            layout.get(state, "consumed"),
            self.footsteps.free(1 - int(layout.scalar(state, "stance")), landed),
            view.tick > landed + _AT_REST_S * self.rate,
            view.tick,
            int(view.source_tick),
            put_off,
        )
        # Where the human ends inside the horizon this plan is the last: it is played to its end.
        return steps if view.whole else self.footsteps.gather(steps, feet, view.tick + view.follow)

    def _schedule(self, state: Float, view: _View, steps: list[Step], ticks: Float, known: Float) -> Schedule:
        layout = self.layout
        quiet = np.full(len(ticks), 0.5)
        if view.window is not None:
            quiet = posture.quiet_share(view.window, known, len(ticks), SHIFT_S * self.rate)
        schedule = Schedule.of(
            layout.get(state, "feet"),
            layout.scalar(state, "landed"),
            layout.scalar(state, "stance"),
            steps,
            ticks,
            quiet,
            self.rate,
            self.gait.clearance,
        )
        # Whoever walked stays low to the end: a plan ends at rest, not on its way up.
        tail = schedule.walking[view.follow :]
        np.logical_or.accumulate(tail, out=tail)
        return schedule

    def _balance(self, state: Float, schedule: Schedule) -> Absorbed:
        share = schedule.share[:, None]
        zmp = (1.0 - share) * schedule.feet[:, 0, :2] + share * schedule.feet[:, 1, :2]
        dcm = balance.divergent_component(zmp, self.omega, self.dt)
        return self.absorber.absorb(zmp, dcm, self.layout.get(state, "dcm"), float(schedule.feet[0, :, 3].mean()))

    def _targets(
        self, state: Float, view: _View, schedule: Schedule, known: Float, checkpoint: Callable[[], None]
    ) -> tuple[Float, Float | None]:
        """Targets of trunk and upper body, (T, C), and of the hands, (F, 2, 3) by source frame."""
        start = self.layout.get(state, "position")
        trunk = posture.trunk_targets(self.gait, schedule)
        upper = np.broadcast_to(start[len(POSTURE) :], (len(trunk), len(start) - len(POSTURE)))
        if view.window is None:
            return np.hstack([trunk, upper]), None
        window = view.window
        held = np.concatenate([known, np.full(len(trunk) - len(known), known[-1])])
        trunk[: view.follow] = posture.human_trunk(
            self.gait, schedule, window, view.scaling, held, self.follower.omega
        )[: view.follow]
        q = self.robot.stand_pose.copy()
        q[self.body.upper.joints] = start[len(POSTURE) :]
        first = round(float(window.times[0]) * window.motion.fps)
        angles, arms = self.body.upper.solve(window.kinematics, q, first, checkpoint)
        ahead = np.minimum(held + 2.0 / self.follower.omega[-1], known[-1])
        return np.hstack([trunk, window.at(angles, ahead)]), np.where(arms.reachable[..., None], arms.hand, np.nan)

    def _reachable_height(self, state: Float, schedule: Schedule, com: Float) -> Float:
        """Hips low enough for both legs, as early as the follower needs to get there, (T,) [m]."""
        height = self.body.reachable_height(schedule.feet, com, self.layout.get(state, "com_offset"))
        ahead = int(round(3.0 / self.follower.omega[0] * self.rate))
        return minimum_filter1d(height, ahead + 1, origin=-(ahead // 2), mode="nearest")

    def _hand_error(self, view: _View, q: Float, hands: Float | None) -> Float:
        """Distance of the hands from where the human's map to, (T, 2) [m].

        One row a source frame, and only as far as a plan plays before its successor joins: the rest is never read.
        """
        errors = np.full((len(q), 2), np.nan)
        if view.window is None or hands is None:
            return errors
        rows = np.rint(view.source_tick + view.window.times * self.rate).astype(int) - view.tick
        played = min(view.follow, int(2 * self.settings.replan_s * self.rate))
        for frame in np.flatnonzero((rows >= 0) & (rows < played)):
            reached = self.body.upper.hand_positions(q[rows[frame]])
            errors[rows[frame]] = np.linalg.norm(reached - hands[frame], axis=1)
        return errors

    def _torque(self, state: Float, schedule: Schedule, base: Float, q: Float) -> tuple[Float, Float, Float]:
        """Joint speed and acceleration, by differences that reach into the rows before, and the torque they ask for."""
        layout = self.layout
        joints = np.concatenate([layout.get(state, "q")[::-1], q])
        torso = np.concatenate([layout.get(state, "base")[::-1], base])
        moves = np.hstack([np.diff(joints, axis=0), np.diff(torso[:, :3], axis=0), _turns(torso[:, 3:])])
        speed, acceleration = self._rates(moves / self.dt)
        n = joints.shape[1]
        qd, qdd = speed[:, :n], acceleration[:, :n]
        rows = np.unique(np.append(np.arange(0, len(q), _TORQUE_STRIDE), len(q) - 1))
        torque, _ = self.body.dynamics.inverse(
            base[rows],
            speed[rows, n:],
            acceleration[rows, n:],
            q[rows],
            qd[rows],
            qdd[rows],
            schedule.feet[rows],
            schedule.share[rows],
        )
        return qd, qdd, make_interp_spline(rows, torque, k=1)(np.arange(len(q)))

    def _rates(self, between: Float) -> tuple[Float, Float]:
        """Speed and low-passed acceleration at rows, (T, C), from the mean speeds between them, (T + 1, C).

        Central differences; the last row goes on as it came.
        """
        after = np.concatenate([between[2:], between[-1:]])
        change = np.diff(between, axis=0) / self.dt
        acceleration = np.concatenate([change[1:], np.zeros((1, between.shape[1]))])
        smooth, _ = sosfilt(self._smoother, acceleration, axis=0, zi=self._settled * change[0])
        return 0.5 * (between[1:] + after), smooth

    def _remember(
        self,
        plan: Plan,
        state: Float,
        view: _View,
        steps: list[Step],
        ticks: Float,
        position: Float,
        velocity: Float,
        offset: Float,
    ) -> None:
        """Fill `plan.states`: row k holds what a plan that joins at row k resumes from."""
        layout, states = self.layout, plan.states
        rows = len(ticks)
        layout.set(states, "feet", plan.feet)
        layout.set(states, "com", plan.com[:, :2])
        layout.set(states, "dcm", plan.dcm)
        for name, values in (("com_offset", offset), ("position", position), ("velocity", velocity)):
            layout.set(states, name, np.concatenate([layout.get(state, name)[None], values[:-1]]))
        for name, values in (("q", plan.q), ("base", plan.base)):
            line = np.concatenate([layout.get(state, name)[::-1], values])
            layout.set(states, name, np.stack([line[1 : rows + 1], line[:rows]], axis=1))
        consumed, human_feet = layout.get(state, "consumed").copy(), layout.get(state, "human_feet").copy()
        settled = settled_from(steps, self.rate)
        for step, tick in zip(steps, settled, strict=True):
            landed = ticks >= step.land
            layout.set(states, "landed", float(step.land), landed)
            layout.set(states, "stance", float(step.stance), landed)
            consumed[step.side] = max(consumed[step.side], step.consumed_s)
            layout.set(states, "consumed", consumed, ticks >= tick)
            human_feet[step.side] = step.human
            layout.set(states, "human_feet", human_feet, landed)
        for edge in sorted({view.tick, *np.ceil(settled), *(step.land for step in steps)}):
            alive = [step for step, tick in zip(steps, settled, strict=True) if tick <= edge < step.land]
            layout.set(states, "steps", pack_steps(alive), ticks >= edge)
        if view.window is not None:
            self._remember_human(states, view.window, (ticks - view.source_tick) / self.rate)

    def _remember_human(self, states: Float, window: HumanWindow, seconds: Float) -> None:
        """What was seen before the frame at or before each row: `next_frame` gives that frame again."""
        frames = window.frame_before(seconds)
        known = frames >= 1
        for name, values in (("detector", window.detector_states), ("yaws", window.yaws)):
            kept = self.layout.get(states, name).copy()
            kept[known] = values[frames[known] - 1]
            self.layout.set(states, name, kept)


def _turns(quaternions: Float) -> Float:
    """Rotation vectors from row to row in the body's frame, (T + 1, 3), from (T + 2, 4) quaternions w x y z."""
    rotation = Rotation.from_quat(quaternions, scalar_first=True)
    return (rotation[:-1].inv() * rotation[1:]).as_rotvec()
