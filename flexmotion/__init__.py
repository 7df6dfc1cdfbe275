"""FlexMotion: human motion to a humanoid's servos, live.

    import flexmotion as fm

    with fm.open_session("op3") as session:
        session.send(fm.Velocity(0.2, 0.0, 0.0))
        session.advance(5.0)
        print(session.state.torso)

Nothing is imported before a name is used. `docs/library.md` lists the names; `examples/` has whole programs.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flexmotion.bundles.bundle import Bundle
    from flexmotion.configs.errors import (
        ConfigError,
        DriverError,
        FlexMotionError,
        GatewayError,
        MotionFormatError,
        RetargetError,
        SamplingError,
        SessionError,
    )
    from flexmotion.configs.robot import Robot
    from flexmotion.configs.stream import StreamSettings, load_stream
    from flexmotion.drivers.interface import Driver
    from flexmotion.features.constraints import Constraints
    from flexmotion.human.concatenate import concatenate
    from flexmotion.human.motion import Motion
    from flexmotion.human.motion_file import save_motion
    from flexmotion.sampling.sampler import Condition, Sampler
    from flexmotion.streamer.api import (
        load_motion,
        open_bundle,
        open_driver,
        open_mirror,
        open_robot,
        open_sampler,
        open_session,
        open_source,
        retarget_motion,
    )
    from flexmotion.streamer.control.ladder import State
    from flexmotion.streamer.control.run_trace import RunTrace
    from flexmotion.streamer.control.telemetry import Event
    from flexmotion.streamer.gateway.async_client import AsyncClient
    from flexmotion.streamer.gateway.client import Client
    from flexmotion.streamer.gateway.listening import Listening
    from flexmotion.streamer.gateway.messages import Answer
    from flexmotion.streamer.gateway.transports.zenoh_client import ZenohClient
    from flexmotion.streamer.log.reader import Log, read_log
    from flexmotion.streamer.mirror.clip_frames import clip_frames
    from flexmotion.streamer.mirror.mirroring import MirrorFrom
    from flexmotion.streamer.motion.heard import Heard
    from flexmotion.streamer.motion.intents import Clip, Heading, Stop, Text, Velocity, Waypoint
    from flexmotion.streamer.motion.part_intents import FootPlace, Hand, HeadPlace, JointAngle, Look, Point, Relax
    from flexmotion.streamer.motion.restriction_intents import Contact, Tension, TorqueCap
    from flexmotion.streamer.motion.script import Item, load_script
    from flexmotion.streamer.motion.sources import Performance, Source
    from flexmotion.streamer.motion.targets import Target
    from flexmotion.streamer.outcome import Outcome, outcome
    from flexmotion.streamer.planning.offline import Trajectory
    from flexmotion.streamer.report.report import Report
    from flexmotion.streamer.run.requests import Request
    from flexmotion.streamer.run.session import Session
    from flexmotion.streamer.run.session_state import SessionState

_MODULES = {
    "bundles.bundle": ("Bundle",),
    "configs.errors": (
        "ConfigError",
        "DriverError",
        "FlexMotionError",
        "GatewayError",
        "MotionFormatError",
        "RetargetError",
        "SamplingError",
        "SessionError",
    ),
    "configs.robot": ("Robot",),
    "configs.stream": ("StreamSettings", "load_stream"),
    "drivers.interface": ("Driver",),
    "features.constraints": ("Constraints",),
    "human.concatenate": ("concatenate",),
    "human.motion": ("Motion",),
    "human.motion_file": ("save_motion",),
    "sampling.sampler": ("Condition", "Sampler"),
    "streamer.api": (
        "load_motion",
        "open_bundle",
        "open_driver",
        "open_mirror",
        "open_robot",
        "open_sampler",
        "open_session",
        "open_source",
        "retarget_motion",
    ),
    "streamer.control.ladder": ("State",),
    "streamer.gateway.async_client": ("AsyncClient",),
    "streamer.gateway.client": ("Client",),
    "streamer.gateway.listening": ("Listening",),
    "streamer.gateway.messages": ("Answer",),
    "streamer.gateway.transports.zenoh_client": ("ZenohClient",),
    "streamer.control.run_trace": ("RunTrace",),
    "streamer.control.telemetry": ("Event",),
    "streamer.log.reader": ("Log", "read_log"),
    "streamer.mirror.clip_frames": ("clip_frames",),
    "streamer.mirror.mirroring": ("MirrorFrom",),
    "streamer.motion.heard": ("Heard",),
    "streamer.motion.intents": ("Clip", "Heading", "Stop", "Text", "Velocity", "Waypoint"),
    "streamer.motion.part_intents": ("FootPlace", "Hand", "HeadPlace", "JointAngle", "Look", "Point", "Relax"),
    "streamer.motion.restriction_intents": ("Contact", "Tension", "TorqueCap"),
    "streamer.motion.script": ("Item", "load_script"),
    "streamer.motion.sources": ("Performance", "Source"),
    "streamer.motion.targets": ("Target",),
    "streamer.outcome": ("Outcome", "outcome"),
    "streamer.planning.offline": ("Trajectory",),
    "streamer.report.report": ("Report",),
    "streamer.run.requests": ("Request",),
    "streamer.run.session": ("Session",),
    "streamer.run.session_state": ("SessionState",),
}
"""Names by the module that defines them. No name may be that of a subpackage (`retarget`), which would hide it."""
_WHERE = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "Answer",
    "AsyncClient",
    "Bundle",
    "Client",
    "Clip",
    "Condition",
    "ConfigError",
    "Constraints",
    "Contact",
    "Driver",
    "DriverError",
    "Event",
    "FlexMotionError",
    "FootPlace",
    "GatewayError",
    "Hand",
    "HeadPlace",
    "Heading",
    "Heard",
    "Item",
    "JointAngle",
    "Listening",
    "Log",
    "Look",
    "MirrorFrom",
    "Motion",
    "MotionFormatError",
    "Outcome",
    "Performance",
    "Point",
    "Relax",
    "Report",
    "Request",
    "RetargetError",
    "Robot",
    "RunTrace",
    "Sampler",
    "SamplingError",
    "Session",
    "SessionError",
    "SessionState",
    "Source",
    "State",
    "Stop",
    "StreamSettings",
    "Target",
    "Tension",
    "Text",
    "TorqueCap",
    "Trajectory",
    "Velocity",
    "Waypoint",
    "ZenohClient",
    "clip_frames",
    "concatenate",
    "load_motion",
    "load_script",
    "load_stream",
    "open_bundle",
    "open_driver",
    "open_mirror",
    "open_robot",
    "open_sampler",
    "open_session",
    "open_source",
    "outcome",
    "read_log",
    "retarget_motion",
    "save_motion",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"{__name__}.{_WHERE[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted(globals().keys() | set(__all__))
