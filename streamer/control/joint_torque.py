"""`JointTorque`: single joints go limp and stiff again while the robot stands, servos restart while it has no torque.

| request | done in | of which joints |
|---|---|---|
| LIMP | READY once the robot stands, HOLD; no fault is latched | arms and head |
| STIFF | the same | those that are limp; the others have torque |
| REBOOT | OFF, FAULT | any |

Everything else is refused with the reason. The joints of the legs, and those that the robot file assigns to no arm or
head, carry the robot: they lose their torque by `disarm` alone. While a joint is limp the robot stands: no plan is
taken but one that stops. Its goals follow the joint wherever hands move it; when it is stiff again its reference begins
there, and comes back to the plan at the robot file's `soft_start_speed`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import Driver, RobotState
from flexmotion.drivers.masks import some
from flexmotion.streamer.control.ladder import Ladder, State
from flexmotion.streamer.control.reference import Reference

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

LIMP, STIFF, REBOOT = "LIMP", "STIFF", "REBOOT"
MAY_GO_LIMP = ("left_arm", "right_arm", "head")
"""Chains of the robot file whose joints carry nothing but themselves."""

_MOST_ASKED = 32
"""Requests that wait for a tick; a loop that ticks takes all of them in each."""
_SETTLED_S = 1.0
"""Time after a restart within which a servo must report no error [s]."""


class JointTorque:
    """Takes requests, decides on them once a tick, and acts on the driver; allocates nothing that grows.

    Args:
        emit: takes kind and message of an event. `refused` answers a request that is not done, `done` a restart that
            is; both begin with the request and its joints.

    Attributes:
        limp: joints without torque on request, (n,) bool.
        carries: joints that carry the robot, (n,) bool.
    """

    def __init__(self, robot: Robot, driver: Driver, ladder: Ladder, emit: Callable[[str, str], None]) -> None:
        self.robot, self.driver, self.ladder, self._emit = robot, driver, ladder, emit
        self.limp = np.zeros(robot.n, np.bool_)
        self.carries = np.ones(robot.n, np.bool_)
        for name, chain in robot.config.mapping.chains().items():
            if name in MAY_GO_LIMP:
                self.carries[[robot.joint_names.index(joint) for _, joint in chain]] = False
        self._asked: deque[tuple[str, tuple[str, ...]]] = deque(maxlen=_MOST_ASKED)
        self._restarting: dict[int, str] = {}  # joint -> its request
        self._awaited: dict[int, int] = {}  # joint -> tick until which it must be well
        self._pins = np.full(robot.n, np.nan)
        self._step = robot.safety.soft_start_speed / robot.rate_hz
        self._returns = np.zeros(robot.n, np.bool_)  # stiff again since this tick
        self._away = np.zeros(robot.n)  # way of the reference back to the plan [rad]

    @property
    def reason(self) -> str | None:
        """Why the robot is not to move; None while every joint has torque."""
        if not some(self.limp):
            return None
        return f"without torque on request: {self._names(self.limp)}; make them stiff first"

    @property
    def restarting(self) -> str | None:
        """Why torque must not go on yet; None while no servo restarts."""
        joints = sorted({*self._restarting, *self._awaited})
        return f"restarting: {', '.join(self.robot.joint_names[joint] for joint in joints)}" if joints else None

    def ask(self, what: str, joints: tuple[str, ...]) -> None:
        """Request LIMP, STIFF or REBOOT of joints by name; it is decided in the next tick."""
        self._asked.append((what, joints))

    def forget(self) -> None:
        """The torque of all joints was switched: none is limp by itself any more."""
        self.limp.fill(False)
        self._returns.fill(False)
        self._away.fill(0.0)

    def step(self, tick: int, measured: RobotState, *, stands: bool) -> Float | None:
        """Decide on the requests that have arrived.

        Args:
            measured: the joints' state.
            stands: the robot stands and waits for a plan, or holds the end of one.

        Returns:
            Positions to which joints were pinned that are stiff again, (n,) [rad], NaN for the others; None: no joint.
        """
        pinned = False
        while self._asked:
            what, joints = self._asked.popleft()
            refusal = self._refusal(what, joints, measured, stands)
            if refusal is not None:
                self._emit("refused", f"{_request(what, joints)}: {refusal}")
                continue
            which = np.isin(self.robot.joint_names, joints)
            if what == LIMP:
                self.driver.switch(which, False)
                self.limp |= which
            elif what == STIFF:
                pinned = self._stiffen(which & self.limp, measured, again=pinned)
            else:
                self._restarting |= dict.fromkeys(map(int, np.flatnonzero(which)), _request(what, joints))
                self.driver.reboot(which)
        if self._restarting:
            self._follow_restarts(tick, measured)
        return self._pins if pinned else None

    def _stiffen(self, which: Bool, measured: RobotState, *, again: bool) -> bool:
        """Switch joints on; returns whether joints were pinned in this tick (`again`: they had been before)."""
        if not which.any():
            return again
        if not again:
            self._pins.fill(np.nan)
        self.driver.switch(which, True)
        np.copyto(self._pins, measured.position, where=which)
        self.driver.take_pins(self._pins)
        self.limp &= ~which
        self._returns |= which
        return True

    def lead(self, reference: Reference, load: Float, measured: RobotState) -> None:
        """Change the reference of this tick, and its torque `load`, (n,) [N·m], for limp joints and those on their way.

        A limp joint is to be where it is, without torque: nothing jumps when it is stiff again.
        """
        if some(self.limp):
            np.copyto(reference.q, measured.position, where=self.limp)
            for values in (reference.qd, load, self._away):
                np.copyto(values, 0.0, where=self.limp)
        if some(self._returns):
            np.copyto(self._away, self._pins - reference.q, where=self._returns)
            self._returns.fill(False)
        if some(self._away):
            back = np.clip(self._away, -self._step, self._step)
            self._away -= back
            reference.q += self._away
            reference.qd -= back * self.robot.rate_hz

    def _refusal(self, what: str, joints: tuple[str, ...], measured: RobotState, stands: bool) -> str | None:
        """Why a request is not done; None where it is."""
        robot, state, offers = self.robot, self.ladder.state, self.driver.capabilities
        for name in joints:
            if name not in robot.joint_names:
                close = get_close_matches(name, robot.joint_names, n=3)
                known = f"did you mean: {', '.join(close)}" if close else f"there are: {', '.join(robot.joint_names)}"
                return f"no joint {name!r}, {known}"
        indices = [robot.joint_names.index(name) for name in joints]
        if what == REBOOT:
            if not offers.reboot:
                return f"driver {self.driver.name!r} does not restart servos: switch their power off and on"
            if state not in (State.OFF, State.FAULT):
                return f"in {state.name} the robot has torque: a servo restarts in OFF and FAULT alone; disarm it first"
            again = [robot.joint_names[joint] for joint in indices if joint in self._restarting]
            return f"restarting: {', '.join(again)}" if again else None
        if not offers.joint_torque:
            return f"driver {self.driver.name!r} does not switch the torque of single joints"
        carrying = [robot.joint_names[joint] for joint in indices if self.carries[joint]] if what == LIMP else []
        if carrying:  # in every state: no other advice would help
            return f"{', '.join(carrying)}: carries the robot, and never goes limp by itself; disarm it"
        if state in (State.OFF, State.FAULT):
            return f"in {state.name} no joint has torque; arm the robot"
        if self.ladder.fault is not None:
            return f"a fault is latched: {self.ladder.fault}"
        if not stands:
            return f"in {state.name} the robot moves: let it come to a stand first (hold)"
        if what == LIMP:
            return None
        return next((why for joint in indices if (why := self._unfit(joint, measured)) is not None), None)

    def _unfit(self, joint: int, measured: RobotState) -> str | None:
        """Why a limp joint cannot be stiff; None where it can."""
        robot, position = self.robot, float(measured.position[joint])
        margin, name = robot.safety.standing_margin, robot.joint_names[joint]
        if not self.limp[joint]:
            return None
        if measured.stale[joint] > 0 or not np.isfinite(position):
            return f"{name}: its position is not known now"
        if not robot.lower[joint] - margin <= position <= robot.upper[joint] + margin:
            limits = f"[{robot.lower[joint]:.2f}, {robot.upper[joint]:.2f}]"
            return f"{name} stands at {position:.2f} rad, more than {margin:g} rad outside {limits}: move it by hand"
        return None

    def _follow_restarts(self, tick: int, measured: RobotState) -> None:
        """Tell the end of restarts: a servo is ready when it answers again and reports no error."""
        for joint, failure in self.driver.take_restarted():
            if failure is not None:
                self._end(joint, failure)
            elif joint in self._restarting:
                self._awaited[joint] = tick + round(_SETTLED_S * self.robot.rate_hz)
        for joint in list(self._awaited):
            error = int(measured.hardware_error[joint])
            if measured.stale[joint] == 0 and not error:
                self._end(joint, None)
            elif tick >= self._awaited[joint]:
                what = f"reports hardware error 0x{error:02x}: its cause is not gone" if error else "does not answer"
                self._end(joint, f"servo of {self.robot.joint_names[joint]} {what} after its restart")

    def _end(self, joint: int, failure: str | None) -> None:
        """The restart of a joint's servo has ended; a request ends with its last joint, or with the first failure."""
        request = self._restarting.pop(joint, None)
        self._awaited.pop(joint, None)
        if request is None:
            return
        if failure is not None:
            self._emit("refused", f"{request}: {failure}")
            others = [other for other, asked in self._restarting.items() if asked == request]
            rest = _request(REBOOT, tuple(self.robot.joint_names[other] for other in others))
            self._restarting |= dict.fromkeys(others, rest)
        elif request not in self._restarting.values():
            self._emit("done", request)

    def _names(self, which: Bool) -> str:
        return ", ".join(self.robot.joint_names[joint] for joint in np.flatnonzero(which))


def _request(what: str, joints: tuple[str, ...]) -> str:
    """A request with its joints, as events name it."""
    return f"{what} {','.join(joints)}"
