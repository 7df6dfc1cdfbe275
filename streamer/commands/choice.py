"""Which motion a command line asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path

import typer

from flexmotion.importers import load
from flexmotion.motion import Motion
from flexmotion.resample import resample
from streamer.script import load_script
from streamer.sequence import sequence

DEFAULT_CLIP = "default.npz"
"""Shipped in `flexmotion/data`: what is followed when nothing is asked for."""


def choose_motion(
    *,
    clip: Path | None = None,
    script: Path | None = None,
    prompt: str | None = None,
    mapping: str | None = None,
    blend_frames: int = 8,
) -> Motion:
    """The motion of a clip or a script, or the shipped one; its `source` is what the report calls it.

    Raises:
        typer.BadParameter: more than one is given, or a prompt, which needs a model.
        FlexMotionError: a file cannot be read (see `flexmotion.importers.load`, `streamer.script`).
    """
    choices = {"--clip": clip, "--script": script, "--prompt": prompt}
    given = [name for name, value in choices.items() if value is not None]
    if len(given) > 1:
        raise typer.BadParameter(f"{' and '.join(given)} exclude each other; give one")
    if prompt is not None:
        raise typer.BadParameter("--prompt needs a model bundle, which this version lacks; use --clip or --script")
    if clip is not None:
        return replace(load(clip, mapping=mapping), source=clip.name)
    if script is not None:
        items = load_script(script)
        clips = [(item.at, load(item.clip, mapping=mapping)) for item in items if item.clip is not None]
        end = items[-1].at if items[-1].clip is None else None
        return replace(sequence(clips, end, blend_frames), source=f"script:{script.name}")
    with as_file(files("flexmotion") / "data" / DEFAULT_CLIP) as path:
        return replace(load(path), source="default")


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
