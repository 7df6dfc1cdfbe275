"""The safety ladder: which of a few plain things the robot is doing, and how it gets from one to the next.

One piece of code for simulated and real robots. It decides; the control loop acts.

```
OFF ──start──► READY ──plan──► STREAMING ◄──plan── HOLD ──park──► PARK ──► OFF
                                   └──plan over, stop──► ▲
any state with torque: e-stop ► HOLD (frozen) ► PARK ► FAULT      fall ► DAMPED ► FAULT      kill, lost bus ► FAULT
```
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from flexmotion.configs.robot_file import SafetyLimits


class State(IntEnum):
    """States of the design's ladder; the number is what logs store."""

    OFF = 0
    READY = 1
    STREAMING = 2
    HOLD = 3
    PARK = 4
    DAMPED = 5
    FAULT = 6


class Playback(Enum):
    """What the loop sends in a state."""

    NOTHING = "torque off, nothing is sent"
    TO_STAND = "slow move to the stand pose, then stay there"
    PLAN = "the plan, and its last row once it is over"
    FREEZE = "the last goals, unchanged"
    TO_REST = "slow move to the rest pose"
    DAMP = "joints give way softly"


@dataclass
class Inputs:
    """What the ladder looks at in one tick.

    Attributes:
        start, stop, park, clear: requests of an operator; they hold for one tick.
        estop, kill: the same, and heard in every state.
        plan_ready: a plan is there to be played; plan_over: its stop tail has been played.
        move_done: the slow move of this state has arrived.
        fallen: the torso is tilted past the robot's limit.
        fault: a servo, sensor or supply asks for an orderly end (its reason), or None.
        bus_lost: nothing answers any more (its reason), or None.
    """

    start: bool = False
    stop: bool = False
    park: bool = False
    clear: bool = False
    estop: bool = False
    kill: bool = False
    plan_ready: bool = False
    plan_over: bool = False
    move_done: bool = False
    fallen: bool = False
    fault: str | None = None
    bus_lost: str | None = None

    def reset(self) -> None:
        """Forget everything that holds for one tick."""
        self.__init__()  # type: ignore[misc]


POWERED = (State.READY, State.STREAMING, State.HOLD, State.PARK, State.DAMPED)


class Ladder:
    """State machine; `step` once a tick.

    Args:
        limits: the robot file's safety limits.
        rate_hz: ticks a second.
        freeze_s, damp_s: how long a frozen and a damped robot is left before it parks or is switched off [s].

    Attributes:
        state: where it stands.
        fault: latched cause, kept until `clear`; None when healthy.
        stopping: a stop has been asked for: no new plan is taken but one that stops.
    """

    def __init__(self, limits: SafetyLimits, rate_hz: float, *, freeze_s: float = 0.5, damp_s: float = 1.0) -> None:
        self.limits = limits
        self.state = State.OFF
        self.fault: str | None = None
        self.stopping = False
        self._freeze_ticks = int(round(freeze_s * rate_hz))
        self._damp_ticks = int(round(damp_s * rate_hz))
        self._left = 0
        self._frozen = False
        self._parking = False  # asked for while streaming: once the robot stands
        self._pressed = False  # a button that is held down is pressed once

    def step(self, inputs: Inputs) -> Playback:
        """Advance one tick and say what to send."""
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
        }[self.state]

    def _latch(self, cause: str) -> None:
        # The first cause is the one to mend; later ones are its consequences.
        self.fault = self.fault or cause

    def _emergency(self, inputs: Inputs) -> bool:
        """Latch what has gone wrong; whether it decides this tick, so that no other request can undo it."""
        if inputs.kill:
            self._latch("kill: torque cut by an operator")
            self.state = State.FAULT
        elif inputs.bus_lost is not None:
            self._latch(inputs.bus_lost)
            self.state = State.FAULT
        elif self.state is State.DAMPED:
            return False
        elif inputs.fallen:
            self._latch("fall: torso tilted past the robot's limit")
            self.state, self._left = State.DAMPED, self._damp_ticks
        elif inputs.estop and not self._pressed:
            self._latch("e-stop: frozen by an operator")
            self.state, self._frozen, self._left = State.HOLD, True, self._freeze_ticks
        else:
            if inputs.fault is not None and self.fault is None:
                self._latch(inputs.fault)
                self.stopping = True
            return False
        return True

    def _in_off(self, inputs: Inputs) -> None:
        if inputs.start and not (inputs.estop or inputs.kill) and self.fault is None:
            self.state = State.READY
            self.stopping = self._frozen = self._parking = False
        elif inputs.kill:
            self._latch("kill: torque cut by an operator")
            self.state = State.FAULT

    def _in_ready(self, inputs: Inputs) -> None:
        if inputs.park or self.fault is not None:
            self.state = State.PARK
        else:
            self._hear_stop(inputs)
            if inputs.move_done and inputs.plan_ready and not self.stopping:
                self.state = State.STREAMING

    def _hear_stop(self, inputs: Inputs) -> None:
        """A stop holds until somebody asks for a start again: a plan alone does not undo it."""
        self.stopping = (self.stopping or inputs.stop) and not inputs.start

    def _in_streaming(self, inputs: Inputs) -> None:
        self._parking |= inputs.park
        self.stopping |= inputs.stop or inputs.park
        if inputs.plan_over:
            self.state = State.HOLD

    def _in_hold(self, inputs: Inputs) -> None:
        if self._frozen:
            self._left -= 1
            if self._left <= 0:
                self.state, self._frozen = State.PARK, False
        elif not inputs.plan_ready and (inputs.park or self._parking or self.fault is not None):
            self.state = State.PARK
        else:
            self._parking |= inputs.park
            self._hear_stop(inputs)
            if inputs.plan_ready and not self.stopping:
                self.state = State.STREAMING

    def _in_park(self, inputs: Inputs) -> None:
        if inputs.move_done:
            self.state = State.OFF if self.fault is None else State.FAULT

    def _in_damped(self, inputs: Inputs) -> None:
        self._left -= 1
        if self._left <= 0:
            self.state = State.FAULT

    def _in_fault(self, inputs: Inputs) -> None:
        if inputs.clear and not (inputs.estop or inputs.kill):
            self.state, self.fault = State.OFF, None
            self.stopping = self._frozen = self._parking = False
