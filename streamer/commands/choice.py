"""Which motion a command line asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path

import typer

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.shipped import shipped_bundle
from flexmotion.configs.robot import Robot
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample
from flexmotion.importers import load
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.checks.latency import shipped_clips, switched
from flexmotion.streamer.motion.intents import Clip, Intent, Stop, Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item, load_script
from flexmotion.streamer.motion.sequence import sequence
from flexmotion.streamer.motion.sources import ClipSource, LiveSource, Performance

DEFAULT_CLIP = "default.npz"
"""Shipped in `flexmotion/data`: what is followed when nothing is asked for and there is no model."""
DEFAULT_SCRIPT = "default_script.yaml"
"""The same where there is one."""
SWITCHED_PROMPTS = (
    "wave with the right hand",
    "stand still",
    "raise both arms",
    "wave with the left hand",
    "raise the right hand",
)
"""What a model is asked for in turn where only its speed matters: who is asked for another gait every half second may
fall, and a fall ends the measurement."""
LAST_S = 10.0
"""How long the last item of a script, or a prompt, is followed where nobody says how long [s]."""


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
) -> Performance:
    """What a clip, a script or a prompt asks for, or what is shipped; its name is what the report calls it.

    Args:
        robot: that follows it; a model's human waits for it.
        bundle: of the model that follows words and velocities; None: the one that comes with the project.
        blend_frames: frames over which a script's clip takes over from the one before.
        seed: of all that a model draws.
        seconds: follow it so long at most [s].
        endless: a model goes on as last asked until somebody ends it.

    Raises:
        typer.BadParameter: options exclude each other, or there is no model for what they ask.
        FlexMotionError: a motion file, a script or the bundle cannot be read.
    """
    choices = {"--clip": clip, "--script": script, "--prompt": prompt}
    given = [name for name, value in choices.items() if value is not None]
    if len(given) > 1:
        raise typer.BadParameter(f"{' and '.join(given)} exclude each other; give one")
    if clip is not None:
        return _at_most(ClipSource(choose_motion(clip, mapping)), seconds, bundle)
    if script is not None:
        items, name = load_script(script), f"script:{script.name}"
        if isinstance(items[0].intent, Clip):
            motion = replace(_clips(items, mapping, blend_frames), source=name)
            return _at_most(ClipSource(motion), seconds, bundle)
        return _model(robot, items, name, str(script), bundle, seed, seconds, endless)
    if prompt is not None:
        if not prompt.strip():
            raise typer.BadParameter('--prompt is empty: say in words what to do, such as "walk forward"')
        return _model(robot, [Item(0.0, Text(prompt))], f"prompt:{prompt}", "--prompt", bundle, seed, seconds, endless)
    if bundle is None and shipped_bundle() is None:
        return _at_most(ClipSource(choose_motion()), seconds, None)
    with as_file(files("flexmotion") / "data" / DEFAULT_SCRIPT) as path:
        return _model(robot, load_script(path), "model:default", "the default script", bundle, seed, seconds, endless)


def choose_motion(clip: Path | None = None, mapping: str | None = None) -> Motion:
    """The motion of a clip, or the shipped one. Raises `FlexMotionError`."""
    if clip is not None:
        return replace(load(clip, mapping=mapping), source=clip.name)
    with as_file(files("flexmotion") / "data" / DEFAULT_CLIP) as path:
        return replace(load(path), source="default")


def open_sampler(bundle: Path | None, asker: str) -> Sampler:
    """The model of a bundle, or the shipped one, which `asker` needs.

    Raises:
        typer.BadParameter: none is given and none is shipped.
        ConfigError: the bundle is none, is damaged, or cannot be run.
    """
    folder = shipped_bundle() if bundle is None else bundle
    if folder is None:
        raise typer.BadParameter(f"{asker} needs a model bundle, and this version comes without one; give --bundle DIR")
    return Sampler(Bundle(folder))


def choose_switched(
    robot: Robot, clips: Sequence[Path], bundle: Path | None, mapping: str | None, seed: int
) -> tuple[LiveSource, tuple[Intent, ...]]:
    """A source that follows targets, and what it may be asked for: clips, a model's prompts, parts of the shipped clip.

    Raises:
        typer.BadParameter: one clip is given, or clips and a bundle.
        FlexMotionError: a file cannot be read.
    """
    if clips:
        _needs_no_model(bundle)
        return switched(library_of(clips, mapping))
    if bundle is None and shipped_bundle() is None:
        return switched(shipped_clips())
    intents = tuple(Text(prompt) for prompt in SWITCHED_PROMPTS)
    sampler = open_sampler(bundle, "--bundle")
    pace = human_pace(robot, sampler.body)
    return ModelSource(sampler, [Item(0.0, intents[0])], "model:prompts", seed, pace=pace), intents


def library_of(files: Sequence[Path], mapping: str | None = None) -> dict[str, Motion]:
    """Clips by file name, all at the first one's frame rate.

    Raises:
        typer.BadParameter: there are fewer than two, or two have one name.
        FlexMotionError: a file cannot be read.
    """
    clips = {file.name: load(file, mapping=mapping) for file in files}
    if len(clips) < 2 or len(clips) < len(files):
        raise typer.BadParameter("--clip: expected two or more files of different names to switch between")
    fps = next(iter(clips.values())).fps
    return {name: clip if clip.fps == fps else resample(clip, fps) for name, clip in clips.items()}


def _clips(items: Sequence[Item], mapping: str | None, blend_frames: int) -> Motion:
    clips = [(item.at, load(item.intent.name, mapping=mapping)) for item in items if isinstance(item.intent, Clip)]
    end = items[-1].at if isinstance(items[-1].intent, Stop) else None
    return sequence(clips, end, blend_frames)


def _at_most(source: ClipSource, seconds: float | None, bundle: Path | None) -> ClipSource:
    _needs_no_model(bundle)
    return source if seconds is None or seconds >= source.seconds else source.cut(seconds)


def _needs_no_model(bundle: Path | None) -> None:
    if bundle is not None:
        raise typer.BadParameter("--bundle: clips need no model; give --prompt, a --script of text, or nothing")


def _model(
    robot: Robot,
    items: Sequence[Item],
    name: str,
    asker: str,
    bundle: Path | None,
    seed: int,
    seconds: float | None,
    endless: bool,
) -> ModelSource:
    if seconds is None and not endless:
        seconds = items[-1].at + LAST_S
    sampler = open_sampler(bundle, asker)
    return ModelSource(sampler, items, name, seed, seconds, human_pace(robot, sampler.body))
