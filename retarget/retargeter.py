"""Human motion to this robot's motion: one `Plan` from a state and the next second of the human.

Causal and streaming: a plan depends on the past only through the state from which it resumes, and on the future only as
far as the frames reach that it is given. Every plan ends in a balanced stop on two feet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from flexmotion.biomechanics.tension import LIMBS
from flexmotion.configs.envelope import Envelope
from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import StreamSettings
from flexmotion.human.motion import Motion
from flexmotion.retarget import posture
from flexmotion.retarget.arm_cost import ArmTargets
from flexmotion.retarget.arm_guard import ArmGuard
from flexmotion.retarget.bend import TrunkBend
from flexmotion.retarget.capture import CaptureSteps
from flexmotion.retarget.drafting import CAPPED_DRAFTS, DRAFTS, best_draft
from flexmotion.retarget.easing import WHOLE, Ease, Eased
from flexmotion.retarget.effort import Effort, Judged, changeable, effort
from flexmotion.retarget.foot_places import FootPlaces
from flexmotion.retarget.footsteps import FootstepPlanner, short_sight
from flexmotion.retarget.head_places import HeadPlaces
from flexmotion.retarget.joining import JoinAbsorber
from flexmotion.retarget.part_paths import NO_PARTS, PartGoals, PartPaths
from flexmotion.retarget.part_solver import PartSolver
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.restrictions import NO_RESTRICTIONS, Restrictions
from flexmotion.retarget.resume import BodyMotion, resume_states
from flexmotion.retarget.schedule import Schedule
from flexmotion.retarget.servo_lag import allowed_lag, servo_lag
from flexmotion.retarget.state import SETTLED_STEPS, RetargetState, StateLayout
from flexmotion.retarget.steps import Step, pack_steps
from flexmotion.retarget.stiffness import LimbStiffness
from flexmotion.retarget.swing import Swings
from flexmotion.retarget.swing_check import Sway, SwingCheck
from flexmotion.retarget.swing_effort import SwingEffort
from flexmotion.retarget.torques import JointTorques
from flexmotion.retarget.view import HumanView, forget_human, view_human
from flexmotion.retarget.walk import WalkPlanner
from flexmotion.retarget.whole_body import POSTURE, WholeBody
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

_CALM_S = 0.2
"""This long after the last touch-down, and after the human, a plan's motion is a smooth way to its rest [s]."""
_MISSING_LEG = 1e-4
"""A row whose legs are too short by more than this counts as a repair of its positions [m]."""


class Retargeter:
    """Turns windows of human motion into plans for one robot.

    Args:
        robot: the robot file; its legs must be of the closed-form kind (see `legs.Leg`).
        settings: how far a plan follows the human before its stop tail, and how joins are absorbed.

    Raises:
        RetargetError: the robot's legs cannot be solved, or plans do not reach far enough for its steps.
    """

    def __init__(self, robot: Robot, settings: StreamSettings) -> None:
        if (short := short_sight(robot, settings)) is not None:
            raise RetargetError(short)
        self.robot, self.gait, self.rate = robot, robot.gait, robot.rate_hz
        self.dt = 1.0 / robot.rate_hz
        self.settings = settings
        self.horizon = int(round(settings.horizon_s * self.rate))
        self.body = WholeBody(robot)
        self.layout = StateLayout(robot.n, len(POSTURE) + len(self.body.upper.joints))
        self.bend = TrunkBend(robot, self.body)
        self.follower = posture.follower(robot, self.body)
        first = len(POSTURE)
        self.guard = ArmGuard(robot, self.body.upper.chain, first, float(self.follower.omega[first]))
        self.parts = PartPaths(self.follower, self._upright(self.gait.stand_hip_height))
        self.head_places = HeadPlaces(robot, self.body, self.bend)
        self.solver = PartSolver(robot, self.body.upper, self.guard.distance)
        walking = self._upright(self.gait.walk_hip_height)
        base, q, _, _ = self.body.solve(self.body.home_feet[None], np.zeros((1, 2)), walking[None], np.zeros(2), 4)
        self.com_height = float(self.body.dynamics.centre_of_mass(base, q)[0, 2])
        self.omega = float(np.sqrt(GRAVITY / self.com_height))
        self.swings = Swings.of(robot, self.body.legs, self.omega)
        self.footsteps = FootstepPlanner(
            self.gait, self.swings, self.body.stand_width, float(robot.sole_half_size[:, 0].max()), self.rate
        )
        self.foot_places = FootPlaces(self.footsteps.footholds)
        absorber = JoinAbsorber(robot.sole_half_size.min(axis=0), self.omega, self.dt, settings.dcm_absorb_s)
        check = SwingCheck(
            self.swings,
            SwingEffort(robot, self.body.legs, self.omega),
            float(self.follower.omega[0]),
            self.footsteps.timing.pause,
            self.rate,
            settings.replan_s,
        )
        sole = float(robot.sole_half_size[:, 0].min())
        self.walks = WalkPlanner(self.footsteps, absorber, check, self.body, sole, settings.lead_in_s, self.rate)
        self.capture = CaptureSteps(self.gait, self.swings, robot.sole_half_size.min(axis=0), self.omega, self.rate)
        self.torques = JointTorques(self.body.dynamics, self.rate)
        self.stiffness = LimbStiffness(robot)
        self.envelope, self.allowed_lag = Envelope.of(robot), allowed_lag(robot)
        self.legs = np.concatenate([leg.indices for leg in self.body.legs])

    def _upright(self, height: float) -> Float:
        return np.concatenate([[height, 0.0, 0.0, 0.0], self.robot.stand_pose[self.body.upper.joints]])

    def standing(self) -> Float:
        """State of the robot at rest, hips at standing height, feet around the origin, facing +x, (S,)."""
        body, channels = self.body, self._upright(self.gait.stand_hip_height)
        base, q, offset, _ = body.solve(body.home_feet[None], np.zeros((1, 2)), channels[None], np.zeros(2), 6)
        vector = self.layout.initial()
        state = self.layout.view(vector)
        state.feet, state.position = body.home_feet, channels
        state.com_offset, state.q, state.base = offset[0], q, base
        return vector

    def holding_torque(self, upper: Float) -> Float:
        """Torque that each joint needs to stand upright at the stand pose, (n,) [N·m].

        Args:
            upper: angles of arms and head meanwhile, by `UpperBody.joints`, (C,) [rad].
        """
        now = self.layout.view(self.standing())
        q = now.q[:1].copy()
        q[0, self.body.upper.joints] = upper
        still, rest = np.zeros((1, 6)), np.zeros_like(q)
        share = np.full(1, 0.5)
        torque, _ = self.body.dynamics.inverse(now.base[:1], still, still, q, rest, rest, now.feet[None], share)
        return np.asarray(torque[0])

    def next_frame(self, state: Float, tick: int, fps: float) -> int:
        """Index of the first source frame that a plan resumed from `state` at `tick` must be given.

        It is the frame at or before that tick: the human is interpolated between it and the next.
        """
        source_tick = float(self.layout.view(state).source_tick)
        if np.isnan(source_tick):
            return 0
        return max(int(np.floor((tick - source_tick) / self.rate * fps + 1e-6)), 0)

    def steps_of(self, plan: Plan) -> list[Step]:
        """The steps of a plan: those that are settled where it begins, and those that lift within it."""
        return [*self.layout.view(plan.states[0].copy()).steps.steps(), *plan.steps]

    def stands_at(self, state: Float, tick: int) -> Float:
        """Where the robot comes to stand by a stop: middle of its feet, heading, in the plan's world, (3,) [m, m, rad].

        Args:
            state: where the stop resumes, at `tick`, (S,).
        """
        return self.walks.stands_at(self.layout.view(state.copy()), tick)

    def answer(self, state: RetargetState, tick: int, error: Float) -> None:
        """Move the next foothold of a state to where it captures a robot that has been pushed; see `CaptureSteps`.

        Args:
            state: where a plan resumes at `tick`; it is changed in place.
            error: divergent component of the robot minus that of the plan, (2,) [m].
        """
        steps, moved = self.capture.answer(state.steps.steps(), state.feet, tick, error)
        state.steps, state.dcm = pack_steps(steps, SETTLED_STEPS), state.dcm + moved

    def plan(
        self,
        state: Float,
        motion: Motion | None,
        first_frame: int,
        tick: int,
        *,
        horizon: int | None = None,
        exact: bool = False,
        parts: PartGoals = NO_PARTS,
        restrictions: Restrictions = NO_RESTRICTIONS,
        checkpoint: Callable[[], None] = lambda: None,
    ) -> Plan:
        """The plan that starts at `tick`.

        Args:
            state: where to resume, (S,): `standing()` or a row of an earlier plan's `states`.
            motion: the human's frames from source frame `first_frame` on; None or empty: stop.
            first_frame: index of the motion's first frame on the source's own clock (frame 0 at its time 0).
            tick: loop tick of the first row.
            horizon: most rows that may follow the human; the settings' where not given.
            exact: the feet turn to where a standing human looks by small steps too.
            parts: where joints of arms and head are to be, whatever the human does.
            restrictions: what the plan may not do, whatever the human does. Those of legs bind what follows the human;
                a stop is what it is.
            checkpoint: called every few milliseconds; what it raises ends the work.

        Returns:
            A plan of up to the horizon, as far as the motion reaches, and its stop tail. Where the settings have an
            `effort_limit`, the motion is eased until the plan needs no more than that of the servos' envelope; where
            torques are capped, until it needs no more than these. It comes to a stop where no easing is enough.
        """
        allowed = self.settings.effort_limit
        whole = partial(
            self._draft,
            state,
            tick=tick,
            horizon=horizon,
            exact=exact,
            parts=parts,
            restrictions=restrictions,
            checkpoint=checkpoint,
        )
        if motion is None or (allowed is None and not restrictions.caps):
            return whole(motion, first_frame, WHOLE)
        now = self.layout.view(state.copy())
        begins = changeable(now.steps.steps(), tick, self.rate)
        judged = Judged(None if allowed is None else self.envelope, 1.0 if allowed is None else allowed, self.legs)

        def make(ease: Ease) -> tuple[Plan, Effort]:
            plan = whole(motion, first_frame, ease)
            cap = self._cap(plan, restrictions)
            found = effort(judged, plan.torque, plan.qd, begins, plan.stop_row, cap)
            stands = found.cap is not None and found.joint not in self.legs and bool(plan.contacts.all())
            return plan, replace(found, may_wait=stands)

        # A short plan for a new target must come soon; the whole one right after it is eased.
        short = horizon is not None and horizon < self.horizon
        most = CAPPED_DRAFTS if restrictions.caps else DRAFTS
        best = best_draft(make, Ease(*now.ease), judged.allowed, 1 if short else most)
        plan, lag, refused = best.plan, 0.0, False
        if best.effort.load > judged.allowed and not short:
            # The loop holds arms and head to their caps: what these lack of a plan's torque they fall behind by.
            cap = self._cap(plan, restrictions)
            cap[self.legs] = np.inf
            counts = np.isfinite(cap) | (allowed is not None)
            torque, speed = plan.torque[: plan.stop_row], plan.qd[: plan.stop_row]
            behind = np.abs(servo_lag(self.robot, self.envelope.capped(cap), torque, speed))
            lag = float(behind[:, counts].max(initial=0.0))
            refused = lag > self.allowed_lag or (best.effort.cap is not None and best.effort.joint in self.legs)
        if refused:
            plan = whole(None, first_frame, best.ease)
        self.layout.view(plan.states).ease = np.array(astuple(best.ease.relaxed(best.effort, judged.allowed)))
        return replace(plan, eased=Eased(best.ease, best.drafts, best.effort, best.first, refused, lag))

    def _draft(
        self,
        state: Float,
        motion: Motion | None,
        first_frame: int,
        ease: Ease,
        *,
        tick: int,
        horizon: int | None,
        exact: bool,
        parts: PartGoals,
        checkpoint: Callable[[], None],
        restrictions: Restrictions = NO_RESTRICTIONS,
    ) -> Plan:
        """The plan at one ease; arguments of `plan`."""
        vector = state.copy()
        now = self.layout.view(vector)
        self.parts.update(now, parts, tick)
        now.upright[...] = self.parts.upright(now, tick)
        now.planted[...] = [side in restrictions.planted for side in (0, 1)]
        now.placed[...] = -1.0 if restrictions.placed is None else astuple(restrictions.placed)
        now.astride[...] = restrictions.astride
        now.asked_tension[...] = [restrictions.tension.get(limb, np.nan) for limb in range(len(LIMBS))]
        view = view_human(
            now,
            motion,
            first_frame,
            tick,
            horizon=self.horizon if horizon is None else horizon,
            lead_in_s=self.settings.lead_in_s,
            leg_length=self.body.leg_length,
            rate_hz=self.rate,
            exact=exact,
            ease=ease,
        )
        checkpoint()
        if view is None:
            forget_human(now)
            walk = self.walks.stop(now, tick)
        else:
            walk = self.walks.follow(now, view)
        checkpoint()
        schedule, zmp, dcm = walk.schedule, walk.balance.zmp, walk.balance.dcm
        com, com_velocity = walk.sway.com, walk.sway.com_velocity
        targets, arms = self._targets(now, view, walk.schedule, checkpoint)
        targets[:, 0] = np.minimum(targets[:, 0], self._reachable_height(walk.sway))
        targets = self.parts.lead(now, targets, tick, stands=view is None)
        # A path to a goal is laid out within the whole bounds, and answered with its time.
        led = self.parts.led(now, tick)
        follow = partial(self.follower.slowed(ease.pace, led).follow, position=now.position, velocity=now.velocity)
        followed = follow(targets)
        base, q, offset, short = self.body.solve(schedule.feet, com, followed[0], now.com_offset)
        checkpoint()
        clear = self.guard.keep_clear(targets, (now.position, now.velocity), followed, q, follow)
        if clear is not None:
            followed = clear
            base, q, offset, short = self.body.solve(schedule.feet, com, followed[0], now.com_offset)
            checkpoint()
        position, velocity, slow, soft = followed
        outside = (q < self.robot.lower) | (q > self.robot.upper)
        q = np.clip(q, self.robot.lower, self.robot.upper)
        rows, follows = len(walk.ticks), 0 if view is None else view.follow
        # From here on the robot only comes to rest, unless arms or head are on a way of their own.
        quiet = max([follows, *(step.land - tick for step in walk.steps)]) + int(_CALM_S * self.rate)
        qd, qdd, torque = self.torques.of(now, schedule, base, q, rows if led.any() else quiet)
        checkpoint()
        upper = slice(len(POSTURE), None)
        hand_error = self._hand_error(view, q, arms)
        arms_led = led[upper][: self.body.upper.arms.size].reshape(2, -1).any(axis=1)
        hand_error[:, arms_led] = np.nan  # such a hand does not follow the human's
        source_s = np.full(rows, np.nan)
        if view is not None:
            source_s[:follows] = view.seconds(walk.ticks[:follows])
        led_joints = np.zeros(self.robot.n, np.bool_)
        led_joints[self.body.upper.joints] = led[upper]
        tension = self.stiffness.tension(now.tension, view, rows, led_joints, restrictions.tension)
        body = BodyMotion(com, position, velocity, base, q, offset, tension)
        return Plan(
            start_tick=tick,
            stop_row=follows,
            source_s=source_s,
            q=q,
            qd=qd,
            qdd=qdd,
            torque=torque,
            stiffness=self.stiffness.shares(tension),
            contacts=schedule.contacts,
            feet=schedule.feet,
            base=base,
            com=np.column_stack([com, np.full(rows, self.com_height)]),
            com_velocity=np.column_stack([com_velocity, np.zeros(rows)]),
            zmp=zmp,
            dcm=dcm,
            load_share=schedule.share,
            states=resume_states(self.layout, vector, walk, body, view, self.rate),
            hand_error=hand_error,
            repairs={
                "position": outside.sum(axis=1) + (short > _MISSING_LEG),
                "speed": slow[:, upper].sum(axis=1),
                "acceleration": soft[:, upper].sum(axis=1),
                "torque": np.full(rows, 0 if ease.whole else 1, np.int64),
            },
            steps=[step for step in walk.steps if step.lift >= tick],
            torque_cap=self._clamp(restrictions),
            asked_cap=restrictions.cap(self.robot.n),
            withheld=walk.withheld,
            human=motion,
            human_first_frame=first_frame,
        )

    def _cap(self, plan: Plan, restrictions: Restrictions) -> Float:
        """Greatest torque of each joint for which a plan is eased, (n,) [N·m].

        Joints that a target leads have a time of their own, which no ease changes: their paths are laid out for it.
        """
        cap = restrictions.cap(self.robot.n)
        led = self.parts.led(self.layout.view(plan.states[0].copy()), plan.start_tick)
        cap[self.body.upper.joints[led[len(POSTURE) :]]] = np.inf
        return cap

    def _clamp(self, restrictions: Restrictions) -> Float:
        """Greatest torque that goals of joints may imply which carry nothing but themselves, (n,) [N·m]."""
        cap, clamp, upper = restrictions.cap(self.robot.n), np.full(self.robot.n, np.inf), self.body.upper.joints
        clamp[upper] = cap[upper]
        return clamp

    def _targets(
        self, state: RetargetState, view: HumanView | None, schedule: Schedule, checkpoint: Callable[[], None]
    ) -> tuple[Float, ArmTargets | None]:
        """Targets of trunk and upper body, (T, C), and of the arms by source frame."""
        start = state.position[len(POSTURE) :]
        trunk = posture.trunk_targets(self.gait, schedule)
        if view is None:
            return np.hstack([trunk, np.broadcast_to(start, (len(trunk), len(start)))]), None
        window, upper = view.window, self.body.upper
        known = view.seconds(view.tick + np.arange(view.follow, dtype=float))
        held = np.concatenate([known, np.full(len(trunk) - len(known), known[-1])])
        trunk[: view.follow] = posture.human_trunk(
            self.gait,
            self.bend,
            schedule,
            window,
            view.body_scaling,
            known,
            self.follower,
            (float(state.position[2]) / view.ease.size, float(state.velocity[2]) / view.ease.size),
        )
        trunk[: view.follow, 1:3] *= view.ease.size
        # The arms of an eased plan are the whole ones made smaller about the stand pose; they go on from whole ones.
        rest, size = self.robot.stand_pose[upper.joints], view.ease.size
        whole, speed = rest + (start - rest) / size, state.velocity[len(POSTURE) :] / (size * view.ease.pace)
        before = posture.frames_before(whole, speed, view.second_at(view.tick - 1), window.times[0], window.motion.fps)
        angles, arms = upper.solve(window.kinematics, whole, window.motion.fps, before, checkpoint)
        angles = angles if size == 1.0 else rest + size * (angles - rest)
        joints = posture.upper_targets(window, angles, upper.arms.size, held, known[-1])
        return np.hstack([trunk, np.clip(joints, self.robot.lower[upper.joints], self.robot.upper[upper.joints])]), arms

    def _reachable_height(self, sway: Sway) -> Float:
        """Hip height within reach of both legs, lowered as early as the follower needs to get there, (T,) [m]."""
        ahead = int(round(3.0 / self.follower.omega[0] * self.rate))
        return minimum_filter1d(sway.reach, ahead + 1, origin=-(ahead // 2), mode="nearest")

    def _hand_error(self, view: HumanView | None, q: Float, arms: ArmTargets | None) -> Float:
        """Distance of the hands from their targets, (T, 2) [m].

        One row a source frame, up to where the next plan joins: the rest is never read.
        """
        errors = np.full((len(q), 2), np.nan)
        if view is None or arms is None:
            return errors
        rows = np.rint(view.ticks_at(view.window.times)).astype(int) - view.tick
        played = min(view.follow, int(2 * self.settings.replan_s * self.rate))
        frames = np.flatnonzero((rows >= 0) & (rows < played))
        errors[rows[frames]] = self.body.upper.hand_errors(q[rows[frames]], arms.frames(frames))
        return errors
