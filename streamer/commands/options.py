"""Options that several commands share, each declared once."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Annotated, Literal

import typer


def writable_folder(folder: Path | None) -> Path | None:
    """Check that a folder exists or can be made, before any work is done. Raises `typer.BadParameter`."""
    if folder is not None:
        nearest = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
        if not nearest.is_dir() or not os.access(nearest, os.W_OK):
            raise typer.BadParameter(f"{nearest} is no folder that can be written to")
    return folder


def belt_choice(value: str) -> str:
    """Check the value of `--belt`. Raises `typer.BadParameter`."""
    if value not in ("detect", "none"):
        try:
            speed = float(value)
        except ValueError:
            speed = math.nan
        if not math.isfinite(speed):
            raise typer.BadParameter(f"{value!r}, expected a speed in m/s, none or detect")
    return value


Clock = Literal["real", "lockstep"]

RobotOption = Annotated[
    str, typer.Option("--robot", "-r", help="A shipped robot's name (see `flexmotion robots`) or a robot folder.")
]
ClipOption = Annotated[
    Path | None,
    typer.Option(
        "--clip",
        "-c",
        help="Motion file to follow: BVH, AMC, TRC, C3D, AMASS, or `data import`'s .npz.",
        show_default=False,
    ),
]
ClipsOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--clips",
        help="Motion file that targets may name, by its file name (repeatable; with --web).",
        show_default=False,
    ),
]
ScriptOption = Annotated[
    Path | None,
    typer.Option(
        "--script",
        help="YAML list of {at: seconds, text: WORDS | velocity: \\[vx, vy, wz] | heading: RAD | waypoint: \\[x, y] | "
        "stop: true}, or of clips.",
        show_default=False,
    ),
]
PromptOption = Annotated[
    str | None, typer.Option("--prompt", help='What to do, in words: "wave with the right hand".', show_default=False)
]
MIRROR_ADDRESS = "127.0.0.1:39539"
"""Where frames of a person are received if no address is given: the port of the Virtual Motion Capture protocol."""
MirrorOption = Annotated[
    str | None,
    typer.Option(
        "--mirror",
        metavar="[ADDRESS]",
        help="Mirror a person whose frames come over UDP (VMC, MediaPipe, JSON: docs/live.md); address and port to "
        f"receive them on, else {MIRROR_ADDRESS}.",
        show_default=False,
    ),
]
BundleOption = Annotated[
    Path | None,
    typer.Option(
        "--bundle",
        metavar="NAME|DIR",
        help="Motion model to sample from: one of `bundles`, or a folder; else the default one.",
        show_default=False,
    ),
]
MappingOption = Annotated[
    str | None,
    typer.Option(
        "--mapping",
        help="Skeleton mapping of the clip: a shipped name or a YAML file; else guessed from the joint names.",
    ),
]
MemberOption = Annotated[
    str | None, typer.Option("--clip", help="Name of the clip in a packed file.", show_default=False)
]
BeltOption = Annotated[
    str,
    typer.Option(
        "--belt",
        metavar="V|none",
        callback=belt_choice,
        help="Speed of a treadmill's belt, backwards \\[m/s]; none: never remove one; default: detected.",
    ),
]
MassOption = Annotated[
    float | None, typer.Option("--mass", help="Mass of the human \\[kg]; else guessed.", show_default=False)
]
HeightOption = Annotated[
    float | None,
    typer.Option("--height", help="Height of the human \\[m]; else estimated from the legs.", show_default=False),
]
SettingsOption = Annotated[
    Path | None, typer.Option("--settings", help="Stream settings (YAML) instead of the shipped ones.")
]
SecondsOption = Annotated[
    float | None,
    typer.Option(
        "--seconds",
        "-s",
        min=0.1,
        max=1e6,
        help="Follow at most this many seconds; standing up, stopping and parking take some 8 s more.",
        show_default=False,
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")]
ReportOption = Annotated[
    Path | None,
    typer.Option(
        "--report",
        callback=writable_folder,
        help="Folder for the report: figures as JSON, pictures, and after a run a page with all of them.",
        show_default=False,
    ),
]
LogOption = Annotated[
    Path | None,
    typer.Option(
        "--log",
        help="Log of the run, a new file (.mcap), or a folder for it; if not given, beside the report.",
        show_default=False,
    ),
]
AllowRefusedOption = Annotated[
    bool,
    typer.Option(
        "--allow-refused", help="Pass although something that was asked was refused, dropped or not finished in time."
    ),
]
VideoOption = Annotated[
    bool,
    typer.Option("--video", help="With --report: film human and robot too; needs the extra `video`."),
]
MinLikenessOption = Annotated[
    float | None,
    typer.Option(
        "--min-likeness",
        min=0.0,
        max=1.0,
        help="Fail where the robot did less than this share of the human's motion, or where that is not known.",
        show_default=False,
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
RealtimeOption = Annotated[
    bool,
    typer.Option("--realtime/--no-realtime", help="On the real clock: request realtime scheduling from the system."),
]
ReplanNoiseOption = Annotated[
    float,
    typer.Option(
        "--replan-noise",
        metavar="METRES",
        min=0.0,
        help="Redraw every plan's human motion with an error that grows to this in a second, as a live model does.",
    ),
]
ViewOption = Annotated[
    bool,
    typer.Option(
        "--view/--no-view", help="Show the run in the browser, as --web, but take no targets; it can be stopped."
    ),
]
FeedbackOption = Annotated[bool, typer.Option("--feedback/--no-feedback", help="Balance feedback.")]
WebOption = Annotated[
    bool,
    typer.Option(
        "--web/--no-web",
        help="Show the run in the browser and steer it there, or by other programs (`flexmotion send`).",
    ),
]
WebPortOption = Annotated[
    int | None,
    typer.Option(
        "--web-port",
        min=1,
        max=65535,
        help="Port of the page and for targets; else that of the stream settings (8790).",
        show_default=False,
    ),
]
StopPortOption = Annotated[
    int | None,
    typer.Option(
        "--stop-port",
        min=1,
        max=65535,
        help="Port that takes stops alone; else that of the stream settings (8791).",
        show_default=False,
    ),
]
ListenOption = Annotated[
    str,
    typer.Option("--listen", metavar="ADDRESS", help="Address to listen on; others than this machine's need a token."),
]
TokenFileOption = Annotated[
    Path | None,
    typer.Option(
        "--token-file",
        help="File with the token of the run; else the environment variable FLEXMOTION_TOKEN.",
        show_default=False,
    ),
]
FoxgloveOption = Annotated[
    bool,
    typer.Option(
        "--foxglove/--no-foxglove", help="Show the run live in Foxglove, on this machine (ws://127.0.0.1:8765)."
    ),
]
NameOption = Annotated[
    str | None,
    typer.Option(
        "--name",
        metavar="NAME",
        help="Name of this robot in keys of zenoh and topics of ROS 2; else that of the robot file.",
        show_default=False,
    ),
]
ZenohOption = Annotated[
    bool, typer.Option("--zenoh", help="Take targets and stops over zenoh (keys: docs/transports.md).")
]
ZenohRouterOption = Annotated[
    str | None,
    typer.Option(
        "--zenoh-router",
        metavar="ENDPOINT",
        help="Zenoh router to connect to, such as tcp/127.0.0.1:7447; another machine's needs a token.",
        show_default=False,
    ),
]
Ros2Option = Annotated[
    bool,
    typer.Option(
        "--ros2",
        help="Take part in ROS 2 over the zenoh router on this machine (rmw_zenoh; topics: docs/transports.md).",
    ),
]
GamepadOption = Annotated[
    bool, typer.Option("--gamepad", help="Steer by the gamepads of this machine; buttons: docs/transports.md.")
]
StdinOption = Annotated[
    bool,
    typer.Option("--stdin", help="Read targets from standard input, a JSON object a line; answers go to stdout."),
]
ArmOption = Annotated[
    bool | None,
    typer.Option(
        "--arm/--no-arm",
        help="Switch the torque on at once, or wait for `flexmotion arm`.",
        show_default="at once; a `run` that takes targets of other programs waits",
    ),
]
