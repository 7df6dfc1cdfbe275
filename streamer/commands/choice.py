"""Which motion a command line asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path
from shlex import quote

import typer

from flexmotion.bundles.shipped import shipped_bundle
from flexmotion.configs.robot import Robot
from flexmotion.human.motion import Motion
from flexmotion.human.motion_file import load_motion
from flexmotion.human.resample import resample
from flexmotion.importers import read
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer import api
from flexmotion.streamer.checks.switching import shipped_clips, switched
from flexmotion.streamer.commands.output import print_note
from flexmotion.streamer.motion.intents import Clip, Intent, Text
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item, load_script
from flexmotion.streamer.motion.sources import LiveSource, Performance

DEFAULT_CLIP = "default.npz"
"""Clip in `flexmotion/data`, followed when nothing is asked for and no model is there."""
DEFAULT_SCRIPT = "default_script.yaml"
"""Script in `flexmotion/data`, followed when nothing is asked for and a model is there."""
SWITCHED_PROMPTS = (
    "wave with the right hand",
    "stand still",
    "raise both arms",
    "wave with the left hand",
    "raise the right hand",
)
"""Prompts for a measurement of latency. None of them walks: a gait that changes every half second may make the robot
fall, and a fall ends the measurement."""
LAST_S = 10.0
"""Length of a prompt, and of the last item of a script, without `--seconds` and without an amount [s]."""
SETTLE_S = 3.0
"""Time beyond its limits that a prompt with amounts is given to come to a stand [s]."""


def choose_source(
    robot: Robot,
    *,
    clip: Path | None = None,
    script: Path | None = None,
    prompt: str | None = None,
    bundle: Path | None = None,
    mapping: str | None = None,
    blend_frames: int = 8,
    seed: int = 0,
    seconds: float | None = None,
    endless: bool = False,
    listens: bool = False,
    clips: Sequence[Path] = (),
) -> Performance:
    """The source that a clip, a script or a prompt asks for, or the shipped one; the report says its name.

    Args:
        robot: that follows it; a model's motion is slowed to what the robot can follow.
        bundle: of the model that follows words and velocities; None: the one that comes with the project.
        blend_frames: frames over which a script's clip takes over from the one before.
        seed: of all that a model draws.
        seconds: longest that the source is followed [s].
        endless: a model goes on with its last item until the run is ended.
        clips: motion files that targets may name.
        listens: the run listens for targets: where nothing is asked for, the robot stands and waits for one.

    Raises:
        typer.BadParameter: options exclude each other, or the model that they need is missing.
        FlexMotionError: a motion file, a script or the bundle cannot be read.
    """
    choices = {"--clip": clip, "--script": script, "--prompt": prompt}
    given = [name for name, value in choices.items() if value is not None]
    if len(given) > 1:
        raise typer.BadParameter(f"{' and '.join(given)} exclude each other; give one")
    if clips and not listens:
        raise typer.BadParameter(
            "--clips are for targets of other programs, which `flexmotion run` takes with --web or --stdin"
        )
    if clips and clip is not None:
        raise typer.BadParameter("--clips and --clip exclude each other: a clip that is followed takes no targets")
    if clip is not None:
        return _clips(robot, choose_motion(clip, mapping), clip.name, bundle, seconds)
    if script is not None:
        items, name = load_script(script), f"script:{script.name}"
        if isinstance(items[0].intent, Clip):
            return _clips(robot, items, name, bundle, seconds, mapping, blend_frames)
        return _model(robot, items, name, str(script), bundle, seed, seconds, endless, clips)
    if prompt is not None:
        if not prompt.strip():
            raise typer.BadParameter('--prompt is empty: say in words what to do, such as "walk forward"')
        return _model(
            robot, [Item(0.0, Text(prompt))], f"prompt:{prompt}", "--prompt", bundle, seed, seconds, endless, clips
        )
    if listens:
        return _model(robot, [Item(0.0, api.STANDING)], "model:live", "--web", bundle, seed, seconds, endless, clips)
    if bundle is None and shipped_bundle() is None:
        return _clips(robot, choose_motion(), None, None, seconds)
    with as_file(files("flexmotion") / "data" / DEFAULT_SCRIPT) as path:
        items = load_script(path)
    source = _model(robot, items, "model:default", "the default script", bundle, seed, seconds, endless, clips)
    if not isinstance(source, ModelSource):
        return source
    if lacks := [one.asked for one in source.heard_items if one.state == "refused"]:
        lists = f"{'' if bundle is None else f'{quote(str(bundle))} '}--robot {quote(robot.place)}"
        raise typer.BadParameter(
            f"the built-in script asks for {', '.join(map(repr, lacks))}, which bundle {source.sampler.name} at robot "
            f"{robot.name} does not offer: give --prompt or --script (`flexmotion bundles {lists}` lists what they do)"
        )
    return source


def choose_mirror(
    *,
    clip: Path | None = None,
    script: Path | None = None,
    prompt: str | None = None,
    bundle: Path | None = None,
    clips: Sequence[Path] = (),
) -> MirrorSource:
    """A source that follows a person, foreseen by the model where there is one; see `choose_source`.

    Raises:
        typer.BadParameter: another motion is asked for too.
        ConfigError: the bundle cannot be read.
    """
    choices = {"--clip": clip, "--script": script, "--prompt": prompt, "--clips": clips or None}
    given = [name for name, value in choices.items() if value is not None]
    if given:
        raise typer.BadParameter(f"--mirror and {' and '.join(given)} exclude each other; give one")
    return api.open_mirror(bundle)


def choose_motion(clip: Path | None = None, mapping: str | None = None) -> Motion:
    """The motion of a clip, or the shipped one. Raises `FlexMotionError`."""
    if clip is not None:
        return replace(_read(clip, mapping), source=clip.name)
    with as_file(files("flexmotion") / "data" / DEFAULT_CLIP) as path:
        return replace(load_motion(path), source="default")


def _read(file: Path, mapping: str | None) -> Motion:
    """The motion in a file; notes about how it was read are printed. Raises `FlexMotionError`."""
    found = read(file, mapping=mapping)
    for warning in found.warnings:
        print_note(f"{file.name}: {warning}")
    return found.motion


def open_sampler(bundle: Path | None, asker: str) -> Sampler:
    """The model of a bundle, or the shipped one.

    Args:
        asker: option or file that needs the model, for the message.

    Raises:
        typer.BadParameter: no bundle is given and none is shipped.
        ConfigError: the bundle is missing or damaged, or cannot be run.
    """
    _needs_model(bundle, asker)
    return api.open_sampler(bundle)


def choose_switched(
    robot: Robot, clips: Sequence[Path], bundle: Path | None, mapping: str | None, seed: int
) -> tuple[LiveSource, tuple[Intent, ...]]:
    """A source that follows targets, and the targets: clips, a model's prompts, or parts of the shipped clip.

    Raises:
        typer.BadParameter: only one clip is given, or clips and a bundle.
        FlexMotionError: a file cannot be read.
    """
    if clips:
        _needs_no_model(bundle)
        return switched(library_of(clips, mapping))
    if bundle is None and shipped_bundle() is None:
        return switched(shipped_clips())
    intents = tuple(Text(prompt) for prompt in SWITCHED_PROMPTS)
    source = api.open_source(robot, intents[0], bundle=bundle, name="model:prompts", seed=seed)
    assert isinstance(source, LiveSource)
    return source, intents


def library_of(files: Sequence[Path], mapping: str | None = None) -> dict[str, Motion]:
    """Clips by file name, all at the first one's frame rate.

    Raises:
        typer.BadParameter: there are fewer than two, or two have the same name.
        FlexMotionError: a file cannot be read.
    """
    clips = {file.name: _read(file, mapping) for file in files}
    if len(clips) < 2 or len(clips) < len(files):
        raise typer.BadParameter("--clip: expected two or more files of different names to switch between")
    fps = next(iter(clips.values())).fps
    return {name: clip if clip.fps == fps else resample(clip, fps) for name, clip in clips.items()}


def _clips(
    robot: Robot,
    followed: Motion | Sequence[Item],
    name: str | None,
    bundle: Path | None,
    seconds: float | None,
    mapping: str | None = None,
    blend_frames: int = 8,
) -> Performance:
    _needs_no_model(bundle)
    return api.open_source(robot, followed, mapping=mapping, blend_frames=blend_frames, name=name, seconds=seconds)


def _needs_model(bundle: Path | None, asker: str) -> None:
    if bundle is None and shipped_bundle() is None:
        raise typer.BadParameter(f"{asker} needs a model bundle, and this version comes without one; give --bundle DIR")


def _needs_no_model(bundle: Path | None) -> None:
    if bundle is not None:
        raise typer.BadParameter("--bundle: clips need no model; leave out --bundle, or the clips")


def _model(
    robot: Robot,
    items: Sequence[Item],
    name: str,
    asker: str,
    bundle: Path | None,
    seed: int,
    seconds: float | None,
    endless: bool,
    clips: Sequence[Path],
) -> Performance:
    _needs_model(bundle, asker)
    source = api.open_source(robot, items, bundle=bundle, name=name, seed=seed, seconds=seconds, clips=clips)
    if seconds is not None or endless or not isinstance(source, ModelSource):
        return source
    # A program ends when the robot has done it, at the latest with the time limits of its steps.
    last_s = LAST_S if source.limit_s is None else source.limit_s + SETTLE_S
    return source.cut(items[-1].at + last_s)
