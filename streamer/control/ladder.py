"""`Ladder`: the safety state machine, the same for simulated and real robots. It decides, the control loop acts.

```
OFF ──start──► READY ──plan──► STREAMING ◄──plan── HOLD ──park──► PARK ──► OFF
                                   └──plan over, stop──► ▲
any state with torque: e-stop, lost bus ► HOLD (frozen) ► PARK ► FAULT      fall ► DAMPED ► FAULT      kill ► FAULT
READY, STREAMING, HOLD: a blocked joint ► HOLD (frozen) ► PARK ► FAULT
OFF: e-stop, kill ► FAULT      stop: no start until a clear      FAULT ──clear──► OFF
OFF, FAULT ──get up──► GET_UP ──upright──► READY          GET_UP ──failed, any stop, any fault──► DAMPED ► FAULT
```

What an e-stop, a lost bus or a blocked joint does before PARK is the robot file's choice
(`flexmotion.configs.robot_file.EmergencyStop`); the line above is that of a robot that stays up when it freezes. Servos
that do not answer may still receive goals: the robot is held and lowered without measurements. Where goals cannot be
sent any more, the ladder goes to FAULT. With a blocked leg the way to the rest pose makes the robot fall: it stays
frozen until an operator, who holds it, requests the way down, or its time is over, or another fault comes. A robot that
gets up cannot stop half-way: frozen it would topple over stiff, and it cannot park. Whatever ends it makes it give way.
Stops latch with the torque off too: a stop that was pressed in OFF, or on the way there, is in force until a clear.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from flexmotion.configs.robot_file import SafetyLimits


class State(IntEnum):
    """States of the ladder; logs store the number."""

    OFF = 0
    READY = 1
    STREAMING = 2
    HOLD = 3
    PARK = 4
    DAMPED = 5
    FAULT = 6
    GET_UP = 7


class Playback(Enum):
    """What the loop sends in a state."""

    NOTHING = "torque off, nothing is sent"
    TO_STAND = "slow move to the stand pose, then stay there"
    PLAN = "the plan, and its last row once it is over"
    FREEZE = "the last goals, unchanged"
    TO_REST = "slow move to the rest pose"
    DAMP = "joints give way softly"
    GET_UP = "the steps of the robot's file by which it gets up"


@dataclass
class Inputs:
    """Inputs of one tick.

    Attributes:
        start, stop, park, clear: requests of an operator; they hold for one tick. Of a robot that stands, `start`
            releases a stop.
        estop, kill: the same; they act in every state.
        get_up: likewise, of a robot that lies without torque, and may get up.
        plan_ready: there is a plan to play; plan_over: its stop tail has been played.
        move_done: the slow move of this state is done, or the robot has got up.
        get_up_failed: why it does not get up, or None.
        fallen: the torso is tilted further than it is to be.
        unseen: it swayed as the IMU was lost, and is tilted so by now if it has fallen on.
        fault: why servos, sensors, supply or planner require an orderly end, or None.
        blocked: why a joint cannot go where its goals lead it, or None: the plan cannot be played on.
        stands: that joint carries the robot, which must not be lowered before somebody holds it.
        bus_lost: why the bus counts as lost, or None; goals are sent on.
        cut_off: why no goal can be sent any more, or None.
    """

    start: bool = False
    stop: bool = False
    park: bool = False
    clear: bool = False
    get_up: bool = False
    estop: bool = False
    kill: bool = False
    plan_ready: bool = False
    plan_over: bool = False
    move_done: bool = False
    fallen: bool = False
    unseen: bool = False
    fault: str | None = None
    blocked: str | None = None
    stands: bool = False
    bus_lost: str | None = None
    cut_off: str | None = None
    get_up_failed: str | None = None

    def reset(self) -> None:
        """Clear all, since inputs hold for one tick."""
        self.__init__()  # type: ignore[misc]


_STOPPED = {"freeze": "frozen", "captured_stop": "brought to a stand", "crouch": "lowered"}

_KILLED = "kill: torque cut by an operator"
_FALL = "fall: torso tilted past the robot's limit"
_UNSEEN = "fall: the robot swayed as its IMU was lost, and may have fallen since"

POWERED = (State.READY, State.STREAMING, State.HOLD, State.PARK, State.DAMPED, State.GET_UP)


class Ladder:
    """State machine; `step` once a tick.

    Args:
        limits: the robot file's safety limits.
        rate_hz: ticks a second.
        freeze_s: how long a frozen robot holds its goals before it parks [s].
        damp_s: how long a damped robot gives way before its torque is switched off [s].

    Attributes:
        state: the present state.
        fault: latched cause, kept until `clear`; None while there is none.
        stopped: a stop is in force, in whatever state it was requested: no plan but one that stops, and in OFF no
            start. `clear` releases it in OFF, `start` where the robot stands; getting up begins all the same, and
            releases it.
    """

    def __init__(self, limits: SafetyLimits, rate_hz: float, *, freeze_s: float = 0.5, damp_s: float = 1.0) -> None:
        self.limits = limits
        self.state = State.OFF
        self.fault: str | None = None
        self.stopped = False
        self._freeze_ticks = int(round(freeze_s * rate_hz))
        self._lost_ticks = int(round(limits.lost_bus_hold_s * rate_hz))
        self._blocked_ticks = int(round(limits.blocked_hold_s * rate_hz))
        self._damp_ticks = int(round(damp_s * rate_hz))
        self._left = 0
        self._frozen = False
        self._stands = False  # what froze it is a joint that carries it
        self._lost = False  # what a lost bus demands has begun
        self._parking = False  # park once the robot stands: requested while streaming
        self._pressed = False  # an e-stop button that is held down counts once

    @property
    def stopping(self) -> bool:
        """Whether only a plan that stops is accepted: after a stop, after a fault, or to park."""
        return self.stopped or self._parking or self.fault is not None

    @property
    def waits(self) -> bool:
        """Whether the robot stands frozen with a blocked leg until an operator lowers it, for a bounded time."""
        return self._stands and self._frozen and self.state is State.HOLD

    def step(self, inputs: Inputs) -> Playback:
        """Advance one tick; returns what the loop sends."""
        self.stopped |= inputs.stop
        emergency = self.state in POWERED and self._emergency(inputs)
        self._pressed = inputs.estop
        if not emergency:
            getattr(self, f"_in_{self.state.name.lower()}")(inputs)
        return self._playback()

    def _playback(self) -> Playback:
        if self.state is State.HOLD and self._frozen:
            return Playback.FREEZE
        return {
            State.OFF: Playback.NOTHING,
            State.READY: Playback.TO_STAND,
            State.STREAMING: Playback.PLAN,
            State.HOLD: Playback.PLAN,
            State.PARK: Playback.TO_REST,
            State.DAMPED: Playback.DAMP,
            State.FAULT: Playback.NOTHING,
            State.GET_UP: Playback.GET_UP,
        }[self.state]

    def _latch(self, cause: str) -> None:
        # The first cause is kept; later ones are its consequences.
        self.fault = self.fault or cause

    def _emergency(self, inputs: Inputs) -> bool:
        """Latch a failure; returns whether it decides this tick, so that no other request can undo it."""
        if inputs.kill:
            self._latch(_KILLED)
            self.state = State.FAULT
        elif inputs.cut_off is not None:
            self._latch(inputs.cut_off)
            self.state = State.FAULT
        elif self.state in (State.DAMPED, State.GET_UP):
            return False
        elif inputs.fallen or inputs.unseen:
            self._latch(_FALL if inputs.fallen else _UNSEEN)
            self.state, self._left = State.DAMPED, self._damp_ticks
        elif inputs.estop and not self._pressed:
            return self._emergency_stop(max(self._freeze_ticks, self._left if self.waits else 0))
        elif inputs.blocked is not None and self.fault is None and self.state is not State.PARK:
            return self._stand(inputs.blocked, inputs.stands)
        elif inputs.bus_lost is not None and not self._lost:
            return self._lose(inputs.bus_lost)
        else:
            if inputs.fault is not None:
                self._latch(inputs.fault)
            return False
        return True

    def _lose(self, cause: str) -> bool:
        """Begin what a lost bus demands; returns whether that decides this tick."""
        self._lost = True
        self._latch(cause)
        return self.state is not State.PARK and self._stop_at_once(self._lost_ticks)

    def _stand(self, cause: str, stands: bool) -> bool:
        """Stop where a joint is blocked; returns whether that decides this tick."""
        self._latch(cause)
        self._stands = stands
        return self._stop_at_once(self._blocked_ticks if stands else self._freeze_ticks)

    def _emergency_stop(self, ticks: int) -> bool:
        """Do what an operator demands; returns whether that decides this tick."""
        self._latch(f"e-stop: {_STOPPED[self.limits.emergency_stop]} by an operator")
        return self._stop_at_once(ticks)

    def _stop_at_once(self, ticks: int) -> bool:
        """Stop as the robot file says, frozen for `ticks`; returns whether that decides this tick."""
        does = self.limits.emergency_stop
        if does == "freeze":
            self.state, self._frozen, self._left = State.HOLD, True, ticks
        elif does == "crouch":
            self.state, self._frozen = State.PARK, False
        return does != "captured_stop"  # which does as a fault does: the plan's own stop, then PARK

    def _in_off(self, inputs: Inputs) -> None:
        if inputs.kill:
            self._latch(_KILLED)
            self.state = State.FAULT
        elif inputs.estop:
            self._latch("e-stop: pressed by an operator while the torque was off")
            self.state = State.FAULT
        elif inputs.stop or inputs.park:
            return
        elif inputs.start and not self.stopped:
            self._begin(State.READY)
        elif inputs.get_up:
            self._begin(State.GET_UP)
        elif inputs.clear:
            self.stopped = False

    def _begin(self, state: State) -> None:
        """Begin anew: nothing that stopped the robot before is in force any more."""
        self.state, self.fault, self._stands = state, None, False
        self.stopped = self._frozen = self._parking = self._lost = False

    def _in_get_up(self, inputs: Inputs) -> None:
        cause = inputs.bus_lost or inputs.fault or inputs.get_up_failed
        if inputs.estop:
            cause = "e-stop: an operator stopped the robot while it got up; it gave way"
        elif inputs.stop or inputs.park:
            cause = "stop: an operator stopped the robot while it got up; it gave way"
        if cause is not None:
            self._latch(cause)
            self.state, self._left = State.DAMPED, self._damp_ticks
        elif inputs.move_done:
            self.state = State.READY

    def _in_ready(self, inputs: Inputs) -> None:
        if inputs.park or self.fault is not None:
            self.state = State.PARK
        else:
            self._release(inputs)
            if inputs.move_done and inputs.plan_ready and not self.stopping:
                self.state = State.STREAMING

    def _release(self, inputs: Inputs) -> None:
        """A stop holds until the next start request without one; a new plan does not undo it."""
        self.stopped &= inputs.stop or not inputs.start

    def _in_streaming(self, inputs: Inputs) -> None:
        self._parking |= inputs.park
        if inputs.plan_over:
            self.state = State.HOLD

    def _in_hold(self, inputs: Inputs) -> None:
        if self._frozen:
            self._left -= 1
            if self._left <= 0 or (self.waits and (inputs.park or inputs.fault is not None)):
                self.state, self._frozen = State.PARK, False
        elif not inputs.plan_ready and (inputs.park or self._parking or self.fault is not None):
            self.state = State.PARK
        else:
            # A park wins over a plan that begins in the same tick.
            self._parking |= inputs.park
            self._release(inputs)
            if inputs.plan_ready and not self.stopping:
                self.state = State.STREAMING

    def _in_park(self, inputs: Inputs) -> None:
        if inputs.move_done:
            self.state, self._parking = (State.OFF if self.fault is None else State.FAULT), False

    def _in_damped(self, inputs: Inputs) -> None:
        self._left -= 1
        if self._left <= 0:
            self.state = State.FAULT

    def _in_fault(self, inputs: Inputs) -> None:
        if inputs.estop or inputs.kill or inputs.stop:
            return
        if inputs.get_up and not inputs.park:
            self._begin(State.GET_UP)
        elif inputs.clear:
            self._begin(State.OFF)
