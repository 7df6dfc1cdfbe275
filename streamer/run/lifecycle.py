"""`Lifecycle`: start, stream, settle, park. It steps before each tick and sets the inputs of the loop's ladder.

`flexmotion.streamer.run.session.Session` is one run (robot, source, settings), this the robot's course through it, and
`flexmotion.streamer.run.supervisor.Supervisor` the processes of a run on the real clock.
"""

from __future__ import annotations

from flexmotion.configs.stream import StreamSettings
from flexmotion.streamer.control.ladder import POWERED, State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.overridden import GET_UP
from flexmotion.streamer.run.requests import OF_JOINTS, Request

_SETTLE_S = 1.0
"""How long the robot stands in HOLD after the source is over, before it parks [s]."""
_HURRIED_SETTLE_S = 0.2
"""The same after a request for the end [s]."""
_SILENCE_S = 5.0
"""A run that should continue but has had no plan for this long is ended [s]."""
_PARKING_S = 12.0
"""Time that a run past its limit has left to stop and park [s]."""
MARGIN_S = 30.0
"""Longest run beyond the source's length: standing up, stopping, parking [s]."""
_AGAINST_A_START = (Request.STOP, Request.ESTOP, Request.KILL, Request.END)
"""If one of these arrives before the start, torque stays off; after a stop until it is cleared."""
_STOPS = (Request.STOP, Request.ESTOP, Request.KILL, Request.DISARM, Request.END)
"""These undo what is asked for in the same tick."""
_TOLD = {
    Request.LOST: "fault",
    Request.GIVEN_UP: "fault",
    Request.WARNING: "warning",
    Request.NOTE: "note",
}
"""Kinds of event of what is told to the run; all others are requests."""


class Lifecycle:
    """Drives the loop's inputs through one run; `step` before each tick.

    Args:
        seconds: how much of the source is streamed [s]; None: all of it.
        stay: after the source is over, and while no plans come, the robot stands on; else the run ends.
        armed: torque goes on with the first tick; else it waits for ARM.
        attended: the run goes on in OFF and in FAULT until END: an operator can clear the fault and arm it again.
        patient: the source may have nothing for any time, as a person who is mirrored and is not there.

    Attributes:
        quit: the run ends now, in whatever state the robot is.
        broken: why no more plans can be made; None while they can.
        robot_answers: set to False while a robot that is not there is waited for.
    """

    def __init__(
        self,
        loop: ControlLoop,
        settings: StreamSettings,
        *,
        seconds: float | None,
        stay: bool,
        armed: bool = True,
        attended: bool = False,
        patient: bool = False,
    ) -> None:
        self.loop, self.settings, self.seconds, self.stay = loop, settings, seconds, stay
        self.attended, self._arms, self._patient = attended, armed, patient
        loop.awaits_arm = attended or not armed
        self.quit = False
        self.robot_answers = True
        self.broken: str | None = None
        self._given_up: str | None = None
        # It ticks; torque was to go on once, and went on.
        self._begun = self._started = self._was_on = self._ending = False
        self._start_tick = 0
        self._withheld: Request | None = None
        self._stream_start: int | None = None
        self._hold_ticks = self._idle_ticks = 0
        self._most_ticks = None if stay or seconds is None else int((seconds + MARGIN_S) * loop.robot.rate_hz)

    @property
    def finished(self) -> bool:
        """Whether the run is over."""
        loop = self.loop
        if self.quit or (self._most_ticks is not None and self._ticks >= self._most_ticks):
            return True
        if loop.ladder.state not in (State.OFF, State.FAULT):
            return False
        over = self._started and not self.attended and (self._was_on or not loop.awaits_arm)
        return self._begun and (self._ending or over)

    @property
    def ending(self) -> bool:
        """Whether the end was requested."""
        return self._ending or self.quit

    def request(self, request: Request, reason: str = "") -> None:
        """Take a request; it acts on the next tick."""
        inputs = self.loop.inputs
        if request in OF_JOINTS:
            self._of_joints(request, reason)
            return
        kind = _TOLD.get(request)
        self._emit(*(("request", request.name) if kind is None else (kind, reason)))
        if not self._begun and request in _AGAINST_A_START:
            self._withheld = request
        if request in _STOPS:
            sender = reason.rpartition(": ")[0] or reason  # "SOURCE: TYPE OF ITS MESSAGE", or a way, such as zenoh
            self.loop.stopped_by.append(f"{request.name} from {sender}" if sender else request.name)
        if request is Request.STOP:
            inputs.stop = True
        elif request is Request.ESTOP:
            inputs.estop = True
        elif request is Request.KILL:
            inputs.kill = True
        elif request is Request.CLEAR:
            self._clear()
        elif request is Request.ARM:
            self._arm()
        elif request is Request.GET_UP:
            self._get_up()
        elif request is Request.DISARM:
            inputs.park = True
        elif request is Request.FAULT:
            self.broken = reason
        elif request is Request.GIVEN_UP:
            self._given_up = reason
        elif request is Request.QUIT:
            self.quit = True
        elif request is Request.END and not self._ending:
            self._ending = inputs.stop = True

    def _of_joints(self, request: Request, names: str) -> None:
        """Forward a request for single joints, which the loop decides on in its next tick."""
        asked = f"{request.name} {names}"
        self._emit("request", asked)
        if self._ending:
            self._emit("refused", f"{asked}: the run is ending")
        elif not self.robot_answers:
            self._emit("refused", f"{asked}: the robot is not there yet")
        else:
            self.loop.joints.ask(request.name, tuple(names.split(",")))

    def _clear(self) -> None:
        """Clear a fault, or release a STOP: the robot then stands, or waits without torque, until it is asked."""
        ladder, restarting = self.loop.ladder, self.loop.joints.restarting
        if ladder.state is State.FAULT and restarting is None:
            self.loop.inputs.clear = True
        elif ladder.state is State.FAULT:
            self._emit("refused", f"CLEAR: {restarting}")
        elif self._ending:
            self._emit("refused", "CLEAR: the run is ending")
        elif ladder.fault is not None:
            self._emit("refused", f"CLEAR: the robot is still in {ladder.state.name}, on its way to FAULT")
        elif self.loop.joints.reason is not None:
            self._emit("refused", f"CLEAR: {self.loop.joints.reason}")
        elif ladder.state in (State.READY, State.HOLD):
            self.loop.inputs.start = True
        elif ladder.state is State.OFF and ladder.stopped:
            self.loop.inputs.clear = True
        elif ladder.state is State.OFF:
            self._emit("refused", "CLEAR: the torque is off, and no stop is in force: there is nothing to clear")
        else:
            why = "it changes nothing yet: it releases a STOP once the robot stands"
            self._emit("refused", f"CLEAR: in {ladder.state.name} {why}")

    def _arm(self) -> None:
        """Switch the torque on, where the ladder and the loop permit it."""
        ladder, reason = self.loop.ladder, self._cannot_stand
        if reason is not None:
            self._emit("refused", f"ARM: {reason}")
        elif ladder.state is State.FAULT:
            self._emit("refused", f"ARM: a fault is latched: {ladder.fault}; clear it first")
        elif ladder.state is not State.OFF:
            self._emit("refused", f"ARM: torque is on, the robot is in {ladder.state.name}")
        elif ladder.stopped:
            self._emit("refused", "ARM: a stop is in force; clear it first")
        else:
            self._start()
            self.loop.inputs.start = True

    def _get_up(self) -> None:
        """Let a robot that lies get up, where the ladder and the loop permit it."""
        ladder, reason = self.loop.ladder, self._cannot_stand
        if reason is not None:
            self._emit("refused", f"{GET_UP}: {reason}")
        elif ladder.state not in (State.OFF, State.FAULT):
            self._emit("refused", f"{GET_UP}: torque is on, the robot is in {ladder.state.name}")
        else:
            self._start()
            self.loop.inputs.get_up = True

    @property
    def _cannot_stand(self) -> str | None:
        """Why torque must not go on, whatever the robot does; None where it may."""
        if self._ending:
            return "the run is ending"
        if not self.robot_answers:
            # A start that waited for the robot would switch torque on minutes later, when somebody powers it.
            return "the robot is not there yet"
        if self.broken is not None:
            return f"no plan can be made: {self.broken}; end the run and start it again"
        if self._given_up is not None:
            # The robot would stand up for no target that it could ever follow.
            return f"there is no planner: {self._given_up}; end the run and start it again"
        return None

    def _start(self) -> None:
        self._started = True
        self._start_tick = self.loop.tick_count
        self._stream_start = None

    @property
    def _ticks(self) -> int:
        """Ticks since the robot was armed; 0 before."""
        return self.loop.tick_count - self._start_tick if self._started else 0

    def step(self) -> None:
        """Set the loop's inputs for its next tick."""
        loop, inputs, rate = self.loop, self.loop.inputs, self.loop.robot.rate_hz
        state = loop.ladder.state
        self._was_on |= state in POWERED
        if not self._begun:
            self._begun = True
            if self._withheld is not None:
                self._started = not loop.awaits_arm
                self._emit("note", f"no start: {self._withheld.name} was requested before it")
            elif self._arms:
                self._start()
                inputs.start = True
            else:
                self._emit("note", "torque is off: the run waits to be armed (flexmotion arm, or the page)")
        if self._stream_start is None and loop.intake.playing is not None:
            self._stream_start = loop.intake.playing.plan.start_tick
        # Without torque there is nothing to wind down: a robot that is armed again begins anew.
        loop.winding_down = self._ending or (self._stream_over() and state in POWERED)
        if self.broken is not None:
            inputs.fault = f"planner: {self.broken}"
        if self._most_ticks is not None and self._ticks >= self._most_ticks - int(_PARKING_S * rate):
            inputs.fault = "the run exceeded its time limit"
        if state is State.READY and self._ending:
            inputs.park = True
        self._check_for_plans(state)
        self._hold_ticks = self._hold_ticks + 1 if state is State.HOLD else 0
        settle = _HURRIED_SETTLE_S if self._ending else _SETTLE_S
        # With a blocked leg it stands until an operator ends the run.
        over = self._ending or (self._over() and not loop.ladder.waits)
        if over and self._hold_ticks >= settle * rate:
            inputs.park = True

    def _over(self) -> bool:
        if self._ending:
            return True
        source_over = self.loop.intake.playing is not None and self.loop.intake.playing.ticket.source_over
        return not self.stay and (source_over or self._stream_over())

    def _stream_over(self) -> bool:
        """Whether the requested part of the source has been played; the lead-in before it does not count."""
        if self._stream_start is None or self.seconds is None:
            return False
        since = (self.loop.tick_count - self._stream_start) / self.loop.robot.rate_hz
        return since - self.settings.lead_in_s >= self.seconds

    def _check_for_plans(self, state: State) -> None:
        """Raise a fault if the robot has waited too long for a plan; who is asked to stand waits for none."""
        playing = self.loop.intake.playing
        asked_to_stand = playing is not None and playing.ticket.stops
        waiting = self.loop.ready or (state is State.HOLD and not asked_to_stand and not self._over())
        self._idle_ticks = self._idle_ticks + 1 if waiting and not self.loop.must_stop else 0
        if not (self.stay or self._patient) and self._idle_ticks > _SILENCE_S * self.loop.robot.rate_hz:
            self.loop.inputs.fault = f"planner: no plan for {_SILENCE_S:.0f} s"

    def _emit(self, kind: str, message: str) -> None:
        self.loop.telemetry.emit(self.loop.tick_count, kind, message)
