"""Options that come together: each group is a dataclass, and `grouped` makes its fields options of a command."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields, is_dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, get_type_hints

from flexmotion.streamer.commands.options import (
    AllowRefusedOption,
    ArmOption,
    BeltOption,
    BundleOption,
    ClipOption,
    ClipsOption,
    FeedbackOption,
    FoxgloveOption,
    GamepadOption,
    HeightOption,
    JsonOption,
    ListenOption,
    LogOption,
    MappingOption,
    MassOption,
    MemberOption,
    MinLikenessOption,
    MirrorOption,
    NameOption,
    PromptOption,
    RealtimeOption,
    ReportOption,
    Ros2Option,
    ScriptOption,
    SecondsOption,
    SeedOption,
    SettingsOption,
    StdinOption,
    StopPortOption,
    TokenFileOption,
    VideoOption,
    ViewOption,
    WebOption,
    WebPortOption,
    ZenohOption,
    ZenohRouterOption,
)

if TYPE_CHECKING:
    from flexmotion.configs.robot import Robot
    from flexmotion.configs.stream import Gateway, StreamSettings
    from flexmotion.drivers.interface import Driver
    from flexmotion.importers import Import
    from flexmotion.streamer.gateway.listening import Listening
    from flexmotion.streamer.mirror.mirroring import MirrorFrom
    from flexmotion.streamer.motion.mirror_source import MirrorSource
    from flexmotion.streamer.motion.sources import Performance, Source
    from flexmotion.streamer.run.parts import Clock
    from flexmotion.streamer.run.session import Session


@dataclass(frozen=True)
class MotionOptions:
    """Which motion a robot follows."""

    clip: ClipOption = None
    clips: ClipsOption = None
    script: ScriptOption = None
    prompt: PromptOption = None
    bundle: BundleOption = None
    mapping: MappingOption = None
    seed: SeedOption = 0

    def source(
        self,
        robot: Robot,
        settings: StreamSettings,
        seconds: float | None,
        *,
        endless: bool = False,
        listens: bool = False,
    ) -> Performance:
        """The source of that motion; see `flexmotion.streamer.commands.choice.choose_source`."""
        from flexmotion.streamer.commands.choice import choose_source

        return choose_source(
            robot,
            clip=self.clip,
            script=self.script,
            prompt=self.prompt,
            bundle=self.bundle,
            mapping=self.mapping,
            blend_frames=settings.blend_frames,
            seed=self.seed,
            seconds=seconds,
            endless=endless,
            listens=listens,
            clips=self.clips or (),
        )


@dataclass(frozen=True)
class FollowedOptions(MotionOptions):
    """Which motion a robot follows live: also that of a person."""

    mirror: MirrorOption = None

    @property
    def mirrors(self) -> bool:
        """Whether a person is mirrored."""
        return self.mirror is not None

    def mirror_from(self, token_file: Path | None) -> MirrorFrom | None:
        """Where frames of a person are received; None: nobody is mirrored. Raises `ConfigError`."""
        if self.mirror is None:
            return None
        from flexmotion.streamer.gateway.admission import find_token
        from flexmotion.streamer.mirror.mirroring import MirrorFrom
        from flexmotion.streamer.mirror.service import parse_address

        host, port = parse_address(self.mirror)
        return MirrorFrom(host, port, find_token(token_file), self.mapping)

    def followed(
        self,
        robot: Robot,
        settings: StreamSettings,
        seconds: float | None,
        *,
        endless: bool = False,
        listens: bool = False,
    ) -> Performance | MirrorSource:
        """The source of that motion, or of the person; see `source` and `choice.choose_mirror`."""
        if not self.mirrors:
            return self.source(robot, settings, seconds, endless=endless, listens=listens)
        from flexmotion.streamer.commands.choice import choose_mirror

        return choose_mirror(
            clip=self.clip, script=self.script, prompt=self.prompt, bundle=self.bundle, clips=self.clips or ()
        )


@dataclass(frozen=True)
class ImportOptions:
    """How a motion file is read, and whose motion it is."""

    mapping: MappingOption = None
    clip: MemberOption = None
    belt: BeltOption = "detect"
    mass: MassOption = None
    height: HeightOption = None

    def check(self) -> None:
        """Check mass and height before any file is read. Raises `ConfigError`."""
        from flexmotion.importers.body_size import check_size

        check_size(self.mass, self.height)

    def read(self, file: Path, fps: float | None) -> Import:
        """The motion in a file; see `flexmotion.importers.read`."""
        from flexmotion.importers import read

        belt: float | Literal["detect"] | None = None
        if self.belt != "none":
            belt = "detect" if self.belt == "detect" else float(self.belt)
        return read(file, mapping=self.mapping, clip=self.clip, fps=fps, belt=belt, mass=self.mass, height=self.height)


@dataclass(frozen=True)
class RunOptions:
    """How a run goes and what it leaves behind."""

    seconds: SecondsOption = None
    feedback: FeedbackOption = True
    realtime: RealtimeOption = True
    settings: SettingsOption = None
    report: ReportOption = None
    video: VideoOption = False
    log: LogOption = None
    view: ViewOption = False
    web: WebOption = False
    web_port: WebPortOption = None
    stop_port: StopPortOption = None
    listen: ListenOption = "127.0.0.1"
    token_file: TokenFileOption = None
    stdin: StdinOption = False
    arm: ArmOption = None
    foxglove: FoxgloveOption = False
    name: NameOption = None
    zenoh: ZenohOption = False
    zenoh_router: ZenohRouterOption = None
    ros2: Ros2Option = False
    gamepad: GamepadOption = False
    allow_refused: AllowRefusedOption = False
    min_likeness: MinLikenessOption = None
    as_json: JsonOption = False

    @property
    def listens(self) -> bool:
        """Whether targets of other programs are taken."""
        ways = (self.web, self.stdin, self.zenoh, self.zenoh_router is not None, self.ros2, self.gamepad)
        return any(ways)

    def _listening(self) -> Listening | None:
        if not (self.listens or self.view):
            return None
        import os

        from flexmotion.streamer.gateway.admission import find_token
        from flexmotion.streamer.gateway.listening import Listening

        return Listening(
            address=self.listen,
            port=self.web_port,
            stop_port=self.stop_port,
            token=find_token(self.token_file),
            network=self.web or self.view,
            takes_targets=self.listens,
            # Copies: a forked process closes its standard input.
            lines=(os.dup(0), os.dup(1)) if self.stdin else None,
            name=self.name,
            zenoh=self.zenoh,
            zenoh_router=self.zenoh_router,
            ros2=self.ros2,
            gamepad=self.gamepad,
        )

    @contextmanager
    def outputs(self) -> Iterator[None]:
        """Context of what the run writes, entered before anything is loaded: a second run by mistake ends at once.

        Raises:
            ConfigError: another run writes to the same log, or into the same report; the log exists already; or a video
                is asked for without a report, or without its extra.
        """
        if self.video:
            from flexmotion.configs.errors import ConfigError
            from flexmotion.streamer.plots.video import check_video

            if self.report is None:
                raise ConfigError("--video films a run for its report: give --report DIR too")
            check_video()
        from flexmotion.streamer.log.lock import locked_folder, refuse_locked
        from flexmotion.streamer.log.parts import refuse_existing

        refuse_locked(self.log)
        refuse_existing(self.log)
        with locked_folder(self.report):
            yield

    def check_ports(self, settings: Gateway) -> None:
        """Raise `ConfigError` where a port is taken: before the motion and the model, which take long to load."""
        if not (self.web or self.view):
            return
        from flexmotion.streamer.gateway.ports import check_free

        check_free(self.listen, settings.port if self.web_port is None else self.web_port, "--web-port")
        check_free(self.listen, settings.stop_port if self.stop_port is None else self.stop_port, "--stop-port")

    def streamed_s(self, source: Source, *, stay: bool) -> float | None:
        """How much of a source a run streams at most [s]; None: what there is.

        After a whole clip the robot goes on to where the human is by then, for as long as its report takes account of.
        """
        from flexmotion.streamer.motion.sources import ClipSource, Performance
        from flexmotion.streamer.report.metrics import STANDS_AGAIN_S

        if stay:
            return None
        if isinstance(source, ClipSource) and self.seconds is None:
            return source.seconds + STANDS_AGAIN_S
        return source.seconds if isinstance(source, Performance) else self.seconds

    def session(
        self,
        driver: Driver,
        source: Source,
        settings: StreamSettings,
        *,
        clock: Clock,
        seed: int,
        seconds: float | None,
        stay: bool = False,
        armed: bool = True,
        mirror: MirrorFrom | None = None,
    ) -> Session:
        """The session that `flexmotion.streamer.api.open_session` opens with these options.

        Args:
            armed: whether the command itself arms the robot, where `--arm` and `--no-arm` are not given.
            mirror: see `MotionOptions.mirror_from`.
        """
        from flexmotion.streamer.api import open_session
        from flexmotion.streamer.commands.log_option import log_file

        return open_session(
            driver.robot,
            driver,
            source,
            clock=clock,
            settings=settings,
            seed=seed,
            seconds=seconds,
            feedback=self.feedback,
            stay=stay,
            realtime=self.realtime,
            log=log_file(self.log, self.report),
            foxglove=self.foxglove,
            listening=self._listening(),
            mirror=mirror,
            allow_refused=self.allow_refused,
            min_likeness=self.min_likeness,
            armed=armed if self.arm is None else self.arm,
            attended=stay and self.listens,
        )


@dataclass(frozen=True)
class CheckOptions:
    """How a check is set and where its result goes."""

    settings: SettingsOption = None
    report: ReportOption = None
    as_json: JsonOption = False


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """Make every field of a parameter that is annotated with a dataclass an option of its own.

    Typer has no such feature; it reads the options of a command from its signature.
    """
    parameters = signature(command, eval_str=True).parameters
    groups: dict[str, Any] = {name: one.annotation for name, one in parameters.items() if is_dataclass(one.annotation)}
    for name, one in parameters.items():
        if any(is_dataclass(part) for part in get_args(one.annotation)):
            raise TypeError(f"{command.__name__}: {name}: a group of options cannot be optional or in a union")

    def expanded(**values: Any) -> None:
        built = {
            name: group(**{field.name: values.pop(field.name) for field in fields(group)})
            for name, group in groups.items()
        }
        command(**values, **built)

    flat: list[Parameter] = []
    for name, one in parameters.items():
        if name not in groups:
            flat.append(one.replace(kind=Parameter.KEYWORD_ONLY))
            continue
        types = get_type_hints(groups[name], include_extras=True)
        for field in fields(groups[name]):
            default = field.default if field.default_factory is MISSING else field.default_factory()
            default = Parameter.empty if default is MISSING else default
            flat.append(Parameter(field.name, Parameter.KEYWORD_ONLY, default=default, annotation=types[field.name]))
    expanded.__name__, expanded.__doc__ = command.__name__, command.__doc__
    expanded.__annotations__ = {one.name: one.annotation for one in flat}
    expanded.__signature__ = Signature(flat)  # type: ignore[attr-defined]
    return expanded
