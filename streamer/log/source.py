"""Sources in logs: motions as attachments, and the parts from which a source is rebuilt."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.shipped import DEFAULT, bundle_folder, shipped_bundle, shipped_name
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.judged import Judged
from flexmotion.configs.repertoire import RobotRepertoire
from flexmotion.configs.schema import parse
from flexmotion.human.motion import Motion
from flexmotion.human.motion_file import load_motion, save_motion
from flexmotion.sampling.pace import Pace
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.motion.clip_library import ClipLibrary
from flexmotion.streamer.motion.intents import from_content, to_content
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.person_channel import PersonChannel
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.sources import ClipSource, Source

Parts = dict[str, Any]

MODEL = "model"
"""Kind of a source that samples from a bundle; the log holds the bundle's hash, not the bundle."""
MIRROR = "mirror"
"""Kind of a source that mirrors a person, whose poses the log holds."""
_FOLDER = "source"


def pack(source: Source) -> tuple[Parts, dict[str, bytes]]:
    """The parts of a source, and its motion files by attachment name (`flexmotion.human.motion_file`)."""
    if isinstance(source, ClipSource):
        file = f"{_FOLDER}/clip.npz"
        return {"kind": "clip", "name": source.name, "file": file}, {file: _pack_motion(source.motion)}
    if isinstance(source, ClipLibrary):
        files, packed = _pack_clips(source.clips)
        return {"kind": "clips", "first": source.first, "files": files}, packed
    if isinstance(source, NoisySource):
        parts, packed = pack(source.source)
        return {"kind": "noise", "size_m": source.size_m, "seed": source.seed, "of": parts}, packed
    if isinstance(source, ModelSource):
        named, packed = _pack_clips(source._clips.clips)
        return {**_pack_model(source), "clips": named}, packed
    if isinstance(source, MirrorSource):
        foreseen = {} if source.sampler is None else _bundle_parts(source.sampler)
        return {"kind": MIRROR, "name": source.name, **foreseen}, {}
    return {"kind": type(source).__name__}, {}


def unpack(parts: Parts, files: Mapping[str, bytes], origin: Path) -> Source:
    """The inverse of `pack`.

    Raises:
        ConfigError: logs do not hold this kind of source, or the log lacks a part of it.
        MotionFormatError: a motion in it is damaged.
    """
    kind = parts.get("kind")
    try:
        if kind == "clip":
            source = ClipSource(_unpack_motion(files[parts["file"]]))
            source.name = parts["name"]
            return source
        if kind == "clips":
            return ClipLibrary(_unpack_clips(parts["files"], files), parts["first"])
        if kind == "noise":
            return NoisySource(unpack(parts["of"], files, origin), parts["size_m"], parts["seed"])
        if kind == MODEL:
            return _unpack_model(parts, files, origin)
        if kind == MIRROR:
            sampler = _unpack_sampler(parts, origin) if "hash" in parts else None
            return MirrorSource(PersonChannel(), sampler, parts["name"])
    except (KeyError, TypeError) as error:
        raise ConfigError(f"{origin}: source {kind}: the log lacks {error}") from error
    raise ConfigError(f"{origin}: a source of kind {kind!r} is not kept in a log, expected clips, a model, a mirror")


def _pack_model(source: ModelSource) -> Parts:
    return {
        "kind": MODEL,
        "name": source.name,
        **_bundle_parts(source.sampler),
        "items": [{"at": item.at, **to_content(item.intent)} for item in source.items],
        "seed": source.seed,
        "seconds": source.seconds,
        "pace": None if source.pace is None else asdict(source.pace),
        "straight": source.straight,
    }


def _bundle_parts(sampler: Sampler) -> Parts:
    bundle = sampler.bundle
    shipped = shipped_name(bundle.folder)
    name = None if shipped == DEFAULT else shipped or str(bundle.folder.resolve())
    parts: Parts = {"bundle": name, "hash": bundle.hash, "balanced": sampler.balanced}
    robot = sampler.robot
    if robot is not None:
        kinds = {kind: judged.model_dump() for kind, judged in robot.kinds.items()}
        parts["repertoire"] = {"robot": robot.robot, "place": robot.place, "kinds": kinds}
    return parts


def _unpack_bundle(parts: Parts, origin: Path) -> Bundle:
    folder = shipped_bundle() if parts["bundle"] is None else bundle_folder(parts["bundle"])
    if folder is None:
        raise ConfigError(f"{origin}: source {parts['name']}: sampled from a bundle that this version comes without")
    bundle = Bundle(folder)
    if parts["hash"] not in bundle.hashes:
        raise ConfigError(
            f"{origin}: source {parts['name']}: {folder} is not the bundle of the run: its hash is {bundle.hash}, "
            f"the run's {parts['hash']}; replay it with the release that recorded it"
        )
    return bundle


def _unpack_sampler(parts: Parts, origin: Path) -> Sampler:
    # Earlier versions sampled windows as planted, with the forces of the decoder.
    balanced, robot = parts.get("balanced", False), _unpack_repertoire(parts.get("repertoire"), origin)
    return Sampler(_unpack_bundle(parts, origin), balanced=balanced, robot=robot)


def _unpack_repertoire(parts: Parts | None, origin: Path) -> RobotRepertoire | None:
    """What the robot of the run was judged to do; None: it was not, or an earlier version did not ask."""
    if parts is None:
        return None
    kinds = {kind: parse(Judged, judged, f"{origin}: source repertoire") for kind, judged in parts["kinds"].items()}
    return RobotRepertoire(parts["robot"], parts["place"], kinds)


def _unpack_model(parts: Parts, files: Mapping[str, bytes], origin: Path) -> ModelSource:
    sampler = _unpack_sampler(parts, origin)
    items = [Item(content["at"], from_content(content)) for content in parts["items"]]
    pace = _unpack_pace(parts.get("pace"), origin)  # older logs have none
    straight = parts.get("straight", False)  # older runs kept no course
    clips = _unpack_clips(parts.get("clips", {}), files)  # older logs have none
    how: dict[str, Any] = {"clips": clips, "straight": straight}
    return ModelSource(sampler, items, parts["name"], parts["seed"], parts["seconds"], pace, **how)


def _unpack_pace(speeds: Parts | None, origin: Path) -> Pace | None:
    try:
        return None if speeds is None else Pace(**speeds)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{origin}: source pace: {error}") from error


def _pack_clips(clips: Mapping[str, Motion]) -> tuple[dict[str, str], dict[str, bytes]]:
    """Attachment names of clips by the clips' names, and the motion files by attachment name."""
    files = {name: f"{_FOLDER}/{name}.npz" for name in clips}
    return files, {files[name]: _pack_motion(clip) for name, clip in clips.items()}


def _unpack_clips(named: Mapping[str, str], files: Mapping[str, bytes]) -> dict[str, Motion]:
    return {name: _unpack_motion(files[file]) for name, file in named.items()}


def _pack_motion(motion: Motion) -> bytes:
    # `save_motion` writes to a path.
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "motion.npz"
        save_motion(motion, file)
        return file.read_bytes()


def _unpack_motion(content: bytes) -> Motion:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "motion.npz"
        file.write_bytes(content)
        return load_motion(file)
