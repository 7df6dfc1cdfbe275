"""The topics of a log and their schemas."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, get_args

from flexmotion.streamer.control.ladder import State as LadderState
from flexmotion.streamer.control.plan_buffer import Offer, Ticket
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.log.cdr import Column, columns_of, encode
from flexmotion.streamer.motion.heard import Over, State
from flexmotion.streamer.motion.part_intents import PARTS
from flexmotion.streamer.motion.person_channel import PersonRow

TICK, PLAN, TARGET, HEARD, EVENT, PERSON = "/tick", "/plan", "/target", "/heard", "/event", "/person"
TICK_SCHEMA, PLAN_SCHEMA, PERSON_SCHEMA = "flexmotion/msg/Tick", "flexmotion/msg/Plan", "flexmotion/msg/Person"

_UNITS = {
    "ns, perf_counter": ("stamp_ns", "target_ns", "seen_ns"),
    "tick": ("tick", "plan_start", "plan_end", "asked_tick", "start_tick"),
    "s": (
        *("source_s", "sample_s", "retarget_s"),
        *("target_to_command_s", "target_to_effect_s", "seen_to_command_s"),
        *("work_s", "lateness_s", "robot_lateness_s"),
    ),
    "rad": ("q_ref", "q_cmd", "q", "tilt", "true_q"),
    "rad/s": ("qd_ref", "qd", "gyro"),
    "N·m": ("torque_ref", "torque", "effort", "true_torque"),
    "V": ("voltage",),
    "°C": ("temperature",),
    "m/s²": ("accel",),
    "m": (
        *("com_ref", "com", "dcm_ref", "dcm", "zmp_ref", "zmp_shift", "zmp"),
        *("hand_error", "true_foot", "true_com"),
    ),
    "m, m, m, rad; left then right": ("foot_ref", "feet"),
    "m, m, rad": ("odometry",),
    "m, w x y z": ("base_ref", "true_base"),
    "m/s": ("true_foot_velocity",),
    "N": ("true_foot_force",),
    "reads": ("stale", "imu_stale"),
    "row": ("effect_row", "stop_row"),
}
UNITS = {name: unit for unit, names in _UNITS.items() for name in names}

PERSON_UNITS = {
    "time_s": "s, perf_counter; in lockstep since the start",
    "arrived_s": "s, perf_counter; in lockstep since the start",
    "height": "m",
    "mass": "kg",
    "segments": "m; the last one rad",
    "root_position": "m",
    "root_quaternion": "w x y z",
    "joints": "rad",
}
"""Units of the fields of `/person`."""

_ROWS = (("q", None), ("qd", None), ("torque", None), ("feet", 8), ("com", 3), ("zmp", 2), ("dcm", 2))
"""Arrays of a plan that are logged row by row, and numbers in a row; None: one for each joint."""


def tick_columns(joints: int) -> list[Column]:
    """Fields of `/tick`: those of `flexmotion.streamer.control.tick_row.TickRow`, in its order."""
    states = tuple((state.name, int(state)) for state in LadderState)
    return [
        Column(column.name, column.kind, column.size, column.unit, states) if column.name == "state" else column
        for column in columns_of(TickRow.dtype(joints=joints), UNITS)
    ]


def _scalar(name: str, kind: str) -> Column:
    return Column(name, {"int": "int64", "float": "float64", "bool": "bool"}[kind], unit=UNITS.get(name, ""))


PLAN_COLUMNS = [
    *(_scalar(field.name, str(field.type)) for field in fields(Ticket)),
    *(_scalar(name, "int") for name in ("start_tick", "stop_row", "rows", "joints")),
    *(Column(name, "float32", None, UNITS.get(name, "")) for name, _ in _ROWS),
    Column("contacts", "bool", None, "left, right"),
]
"""Fields of `/plan`; sequences hold row after row, `rows` of them."""


def person_columns() -> list[Column]:
    """Fields of `/person`: those of `flexmotion.streamer.motion.person_channel.PersonRow`, in its order."""
    return columns_of(PersonRow.dtype(), PERSON_UNITS)


def plan_message(offer: Offer) -> bytes:
    """A plan as a message of `/plan`."""
    ticket, plan = offer.ticket, offer.plan
    values: dict[str, Any] = {field.name: getattr(ticket, field.name) for field in fields(Ticket)}
    values |= {"start_tick": plan.start_tick, "stop_row": plan.stop_row, "rows": len(plan), "joints": plan.q.shape[1]}
    values |= {name: getattr(plan, name) for name, _ in _ROWS} | {"contacts": plan.contacts}
    return encode(PLAN_COLUMNS, values)


EVENT_SCHEMA = {
    "title": "flexmotion.Event",
    "type": "object",
    "properties": {
        "tick": {"type": "integer", "description": "tick of the loop"},
        "stamp_ns": {"type": "integer", "description": "perf_counter [ns]"},
        "kind": {"type": "string", "description": "state, request, refused, done, fault, warning or note"},
        "message": {"type": "string"},
    },
    "required": ["tick", "stamp_ns", "kind", "message"],
}
HEARD_SCHEMA = {
    "title": "flexmotion.Heard",
    "type": "object",
    "description": "answer to a target, or to an item of the script; the newest one of an id and an item counts",
    "properties": {
        "stamp_ns": {"type": "integer", "description": "perf_counter at which it was written [ns]"},
        "id": {"type": "integer", "description": "number of the target; 0: of the script or the prompt"},
        "item": {"type": ["integer", "null"], "description": "number of the script's item, from 0"},
        "at_s": {"type": ["number", "null"], "description": "followed from this time on [s]"},
        "tick": {"type": ["integer", "null"], "description": "followed from this tick on"},
        "asked": {"type": "string"},
        "state": {"type": "string", "description": ", ".join(get_args(State))},
        "heard_as": {"type": ["string", "null"], "description": "kinds of motion"},
        "manner": {"type": ["string", "null"], "description": "in which they are done, in the same order"},
        "certainty": {"type": ["number", "null"], "description": "the listener's share of that kind"},
        "slowed": {"type": ["string", "null"]},
        "moved": {"type": ["string", "null"], "description": "place, direction or angle that a part was moved to"},
        "dropped": {"type": "array", "items": {"type": "string"}},
        "reason": {"type": ["string", "null"]},
        "notes": {"type": "array", "items": {"type": "string"}},
        "steps": {"type": "array", "items": {"type": "object"}},
        "holds": {"type": ["string", "null"], "description": "what holds from then on: part or restriction"},
        "there": {"type": ["string", "null"], "description": "of a part that is there: how far from its place"},
        "missed": {"type": ["string", "null"], "description": "of a part that was not there in time: likewise"},
        "over": {"type": ["string", "null"], "description": "how it ended: " + ", ".join(get_args(Over))},
    },
    "required": ["stamp_ns", "asked", "state"],
}
TARGET_SCHEMA = {
    "title": "flexmotion.Target",
    "type": "object",
    "properties": {
        "id": {"type": "integer", "description": "number of the target, from 1"},
        "stamp_ns": {"type": "integer", "description": "perf_counter at which it arrived [ns]"},
        "clip": {"type": "string", "description": "follow the clip of this name"},
        "text": {"type": "string", "description": "do what the words say"},
        "velocity": {
            "type": "array",
            "items": {"type": "number"},
            "description": "forward, left [m/s], turning [rad/s]",
        },
        **{word: {"type": "object", "description": f"fields of {kind.__name__}"} for word, kind in PARTS.items()},
        "holds_s": {"type": "number", "description": "the robot comes to a stand when the target is this old [s]"},
        "stop": {"type": "boolean", "description": "come to a stop"},
    },
    "required": ["id", "stamp_ns"],
    "additionalProperties": True,
}
