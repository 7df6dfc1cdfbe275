"""The calls that programs and the command line are built on: open a robot, a driver, a model, a session.

`import flexmotion as fm` offers all of it by name (`flexmotion/__init__.py`). SI units, radians; arrays over joints are
(n,), in the order of the robot file; quaternions w x y z.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.repertoire import robot_repertoire
from flexmotion.bundles.shipped import bundle_folder, shipped_bundle
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.robot_checks import doubtful_numbers
from flexmotion.configs.stream import StreamSettings, load_stream
from flexmotion.configs.tunable import unusual_numbers
from flexmotion.drivers.interface import Driver
from flexmotion.drivers.registry import create
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample
from flexmotion.importers import load
from flexmotion.retarget.stand_check import unbalanced
from flexmotion.retarget.standing_load import overloaded
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.gateway.listening import Listening, listen
from flexmotion.streamer.log.recording import record_to, show_in_foxglove
from flexmotion.streamer.mirror.mirroring import MirrorFrom, mirror_from
from flexmotion.streamer.motion.intents import Clip, Intent, Stop, Text
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.person_channel import PersonChannel
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item, check_script
from flexmotion.streamer.motion.sequence import sequence
from flexmotion.streamer.motion.sources import ClipSource, Performance, Source
from flexmotion.streamer.planning.offline import Trajectory, retarget_offline
from flexmotion.streamer.run.parts import Clock
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

Followed = Motion | Intent | Sequence[Item]
"""What a robot can follow: a motion, one intent, or a script of intents."""

STANDING = Text("stand still")
"""Intent of a model until it receives a target."""


def open_robot(name_or_folder: str | Path = "op3") -> Robot:
    """A robot that comes with the project, by name, or one of your own, by folder. Raises `ConfigError`."""
    return load_robot(name_or_folder)


def open_driver(name: str, robot: Robot | str | Path, **options: Any) -> Driver:
    """A driver for a robot, not yet connected.

    Args:
        name: "sim", or another of `flexmotion drivers`.
        robot: from `open_robot`, or its name or folder.
        options: fields of the driver's `Options`, such as `seed=1` or `port="/dev/ttyUSB0"`.

    Raises:
        ConfigError: driver or robot is unknown, the driver does not import, or an option is wrong.
    """
    return create(name, _opened(robot), **options)


def open_bundle(folder: str | Path | None = None) -> Bundle:
    """A motion model's bundle, by the name of one that comes with the project or by its folder; None: the default one.

    Raises:
        ConfigError: it is neither, damaged, or of another version, or the project comes without one.
    """
    found = shipped_bundle() if folder is None else bundle_folder(folder)
    if found is None:
        raise ConfigError("this version of FlexMotion comes without a model bundle; give the folder of one")
    return Bundle(found)


def open_sampler(
    folder: str | Path | None = None,
    steps: int | None = None,
    *,
    balanced: bool = False,
    robot: Robot | str | Path | None = None,
) -> Sampler:
    """The model of a bundle, ready to sample human motion; see `open_bundle`.

    Args:
        steps: of the diffusion; None: the bundle's default.
        balanced: with forces that belong to the motion, whose path is shifted for them. Robots follow motion without
            it: with it they fell more often when targets change within a second.
        robot: that follows, from `open_robot`, or its name or folder; None: none does. A sample of words for what it
            was judged not to do stands still, as one of words that are not understood; `Sampler.prompt(text).warning`
            says why, by name. A session refuses such words.

    Raises:
        ConfigError: there is no such bundle or robot, or the number of steps is out of range.
    """
    repertoire = None if robot is None else robot_repertoire(_opened(robot))
    return Sampler(open_bundle(folder), steps, balanced=balanced, robot=repertoire)


def _opened(robot: Robot | str | Path) -> Robot:
    return robot if isinstance(robot, Robot) else open_robot(robot)


def load_motion(path: str | Path, mapping: str | Path | None = None) -> Motion:
    """Human motion from a file: BVH, AMC, TRC, AMASS, or the project's own .npz.

    What is guessed or removed, such as an arm or a treadmill's belt, is logged as warnings. A mass that the file does
    not say is guessed without one, since no robot needs it: `mass_given` of the motion is False, and forces computed
    from it may be off by 30 %.

    Args:
        mapping: skeleton mapping, a shipped name or a YAML file; None: guessed from the joints' names.

    Raises:
        MotionFormatError: the file cannot be read as motion of a human.
        ConfigError: no mapping fits.
    """
    return replace(load(path, mapping=mapping), source=Path(path).name)


def open_source(
    robot: Robot | str | Path,
    followed: Followed,
    *,
    bundle: str | Path | None = None,
    mapping: str | Path | None = None,
    blend_frames: int = 8,
    name: str | None = None,
    seed: int = 0,
    seconds: float | None = None,
    clips: Sequence[str | Path] = (),
) -> Performance:
    """A source of human motion for a robot.

    A motion, a `Clip` or a script of clips is played once. Words and velocities are sampled from a model, whose human
    goes no faster than the robot can follow; such a source also follows targets (`Session.send`).

    Args:
        robot: from `open_robot`, or its name or folder.
        followed: what to do; a `Clip` names a file.
        bundle: of the model; None: the one that comes with the project.
        mapping: skeleton mapping of the files of clips; see `load_motion`.
        blend_frames: frames over which a script's clip takes over from the one before.
        name: what report and log call the source.
        seed: of all that the model draws.
        clips: files that targets of a model's source may name, by their file name.
        seconds: the source ends after this time; None: a clip with its last frame, a model with a `Stop` [s].

    Raises:
        ConfigError: there is no such robot, the items are no script, the model cannot follow an intent, or a bundle is
            given for clips.
        MotionFormatError: a clip cannot be read.
    """
    robot = _opened(robot)
    given: Any = followed  # a program without a type checker may give anything
    if isinstance(given, str) or not isinstance(given, Motion | Intent | Sequence):
        raise ConfigError(f"{followed!r}: expected a motion, an intent (Text, Velocity, Clip) or a script of items")
    if isinstance(followed, Stop):
        raise ConfigError("Stop: nothing is followed before it; expected a motion, Text, Velocity, Clip or a script")
    if isinstance(followed, Clip):
        followed = load_motion(followed.name, mapping)
    if isinstance(followed, Motion):
        motion = followed
    else:
        items = [Item(0.0, followed)] if isinstance(followed, Intent) else followed
        check_script(items)
        if not isinstance(items[0].intent, Clip):
            sampler = open_sampler(bundle, robot=robot)
            pace = human_pace(robot, sampler.body)
            allowed = {Path(clip).name: resample(load_motion(clip, mapping), sampler.fps) for clip in clips}
            return ModelSource(sampler, items, name or "model", seed, seconds, pace, clips=allowed)
        motion = _sequence(items, mapping, blend_frames)
    if bundle is not None or clips:
        raise ConfigError("a bundle or clips for targets are given, but a clip needs no model")
    source = ClipSource(motion if name is None else replace(motion, source=name))
    return source if seconds is None or seconds >= source.seconds else source.cut(seconds)


def open_mirror(bundle: str | Path | None = None, *, foreseen: bool = True) -> MirrorSource:
    """A source that follows a person live; `open_session(…, source, mirror=MirrorFrom())` receives the frames.

    Args:
        bundle: of the model that foresees what the person does; None: the one that comes with the project, if any.
        foreseen: whether a model is used; without one the person's speed is held and dies away.

    Raises:
        ConfigError: the bundle is damaged, or its model has another frame rate than live poses.
    """
    sampler = open_sampler(bundle) if foreseen and (bundle is not None or shipped_bundle() is not None) else None
    return MirrorSource(PersonChannel(), sampler)


def _sequence(items: Sequence[Item], mapping: str | Path | None, blend_frames: int) -> Motion:
    """The clips of a script, one after another."""
    clips = [(item.at, load(item.intent.name, mapping=mapping)) for item in items if isinstance(item.intent, Clip)]
    end = items[-1].at if isinstance(items[-1].intent, Stop) else None
    return sequence(clips, end, blend_frames)


def open_session(
    robot: Robot | str | Path,
    driver: Driver | str = "sim",
    source: Source | Followed = STANDING,
    *,
    clock: Clock = "lockstep",
    settings: StreamSettings | None = None,
    seed: int = 0,
    seconds: float | None = None,
    feedback: bool = True,
    stay: bool | None = None,
    realtime: bool = True,
    next_request: Callable[[], Request | None] | None = None,
    on_event: Callable[[Event], None] | None = None,
    log: str | Path | None = None,
    foxglove: bool = False,
    listening: Listening | None = None,
    mirror: MirrorFrom | None = None,
    allow_refused: bool = False,
    min_likeness: float | None = None,
    armed: bool = True,
    attended: bool = False,
) -> Session:
    """A robot, a driver and a source, ready to run.

    In lockstep a program steps the run itself, as fast as it computes:

        with fm.open_session("op3") as session:
            session.send(fm.Velocity(0.2, 0.0, 0.0))
            session.advance(5.0)
            print(session.state.torso)
            session.finish()

    On either clock `session.run()` runs to the end.

    Args:
        robot: from `open_robot`, or its name or folder.
        driver: from `open_driver`, or the name of one that needs no options.
        source: from `open_source`, or what that takes.
        clock: "lockstep" or "real", for `run` and for the header of the log.
        settings: stream settings; None: the shipped ones.
        seed: of a simulation that is given by name, and of a source that is opened here; log and report hold it.
        seconds: longest that the source is streamed; None: to its end [s].
        feedback: whether balance feedback acts.
        stay: keep standing after the source has ended, until END is requested; None: only where a program steps the run
            and its source follows targets without an end.
        realtime: on the real clock, ask the system for realtime scheduling.
        next_request: called before each tick (on the real clock every 20 ms); may read `session.state`, send targets
            and return a `Request`.
        on_event: called with every event as it happens.
        log: file (.mcap) to record to, in place of a log that is there already, with its parts; None: none.
        foxglove: show the run live in Foxglove, on the port of the settings, to programs of this machine.
        listening: how the run shows itself in a browser and listens for targets of other programs; None: not at all.
        mirror: where frames of a person are received, for a source of `open_mirror`; None: a program publishes poses.
        allow_refused: the report is ok although something that was asked was refused, dropped or not finished.
        min_likeness: the report is not ok below this likeness, in [0, 1], or where it is unknown; None: not judged.
        armed: torque goes on with the first tick; else with `Request.ARM`.
        attended: the run goes on in OFF and in FAULT until END: CLEAR and ARM lead back to READY.

    Raises:
        ConfigError: unknown or invalid robot, driver, option, source or bundle, or the log cannot be written.
        RetargetError: the robot's legs cannot be solved, or the settings make plans too short for its steps.
        MotionFormatError: a clip cannot be read.
    """
    robot = _opened(robot)
    settings = load_stream() if settings is None else settings
    if isinstance(driver, str):
        driver = open_driver(driver, robot, **({"seed": seed} if driver == "sim" else {}))
    if not isinstance(source, Source):
        source = open_source(robot, source, blend_frames=settings.blend_frames, seed=seed)
    session = Session(
        robot,
        driver,
        source,
        settings,
        seconds,
        feedback=feedback,
        stay=stay,
        realtime=realtime,
        seed=seed,
        clock=clock,
        next_request=next_request,
        allow_refused=allow_refused,
        min_likeness=min_likeness,
        armed=armed,
        attended=attended,
    )
    if on_event is not None:
        session.on_event = on_event
    if listening is not None:
        listen(session, listening)
    if mirror is not None:
        mirror_from(session, mirror)
    # Before the run only: once it has started, the loop is the ring's one writer.
    found = [one for one in (overloaded(robot), unbalanced(robot)) if one is not None]
    remarks = [*unusual_numbers(robot), *doubtful_numbers(robot), *found]
    for remark in (*remarks, *(source.remarks if isinstance(source, Performance) else ())):
        session.telemetry.emit(0, "note", remark)
    if log is not None:
        record_to(Path(log), session, clock)
    if foxglove:
        show_in_foxglove(settings.gateway.foxglove_port, session)
    return session


def retarget_motion(
    motion: Motion,
    robot: Robot | str | Path,
    settings: StreamSettings | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """A motion as the robot would play it, without running it: balanced and inside the joints' limits.

    Args:
        motion: of a human, as of `load_motion`.
        robot: from `open_robot`, or its name or folder.
        progress: called with the share done, in [0, 1].

    Returns:
        One row a tick of the robot: joint angles `q` (T, n) [rad], torso `base` (T, 7), planned `contacts` (T, 2), …

    Raises:
        ConfigError: the motion is longer than half an hour, or no motion.
        MotionFormatError: it has fewer than two frames.
    """
    if not isinstance(motion, Motion):
        raise ConfigError(f"motion: {motion!r}, expected a Motion, as of fm.load_motion(file)")
    robot = _opened(robot)
    return retarget_offline(robot, ClipSource(motion), load_stream() if settings is None else settings, progress)
