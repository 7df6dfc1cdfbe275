"""`overridden`: requests that another one of the same tick has undone, so that each is answered at once."""

from __future__ import annotations

from flexmotion.streamer.control.ladder import Inputs, State

GET_UP = "GET_UP"
"""The request to get up, as its events name it: `refused` with the reason, or `done`."""


def overridden(inputs: Inputs, before: State, after: State) -> list[str]:
    """Names of the requests that a stop of their tick has undone, as events name them.

    Args:
        inputs: of the tick.
        before, after: the ladder's states.
    """
    if not (inputs.stop or inputs.park or inputs.estop or inputs.kill):
        return []
    names = {
        GET_UP: inputs.get_up and after is not State.GET_UP,
        "ARM": inputs.start and before is State.OFF and after is not State.READY,
        "CLEAR": (inputs.clear and (after is before is State.FAULT or before is State.OFF))
        or (inputs.start and before in (State.READY, State.HOLD) and (inputs.stop or inputs.estop or inputs.kill)),
    }
    return [name for name, undone in names.items() if undone]
