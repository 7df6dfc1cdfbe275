"""A release from a training folder, and a training folder from a release.

A release holds the weights that are used (`best.pt` of each stage), not the state of the optimiser. A training that
begins from it goes on at the step of those weights.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import torch
from torch import Tensor, nn

from flexmotion.bundles.bundle import sha256
from flexmotion.bundles.shipped import shipped_bundles
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import ModelConfig, load_model_config
from flexmotion.features.layout import Layout
from flexmotion.text.sentence_encoder import NETWORK, VOCABULARY
from flexmotion.training.autoencoder import Autoencoder
from flexmotion.training.autoencoder_task import load_autoencoder
from flexmotion.training.checkpoints import (
    BEGUN,
    BEST,
    begun_from,
    digest,
    fill,
    is_trained,
    read_checkpoint,
    training_record,
    write_checkpoint,
)
from flexmotion.training.control_branch import ControlBranch
from flexmotion.training.denoiser import Denoiser
from flexmotion.training.evaluator import Evaluator
from flexmotion.training.half_weights import halve_weights
from flexmotion.training.release_file import (
    SCHEMA,
    ReleaseFile,
    ReleaseHeader,
    SetFigures,
    StageRecord,
    halved,
    write_release_file,
)
from flexmotion.training.run import PERSONAL, RELEASED, Origin, Run, different_settings, layout_of
from flexmotion.training.set_summary import SetSummary

NEEDS: dict[str, tuple[str, ...]] = {
    "autoencoder": (),
    "diffusion": ("autoencoder",),
    "distill": ("autoencoder", "diffusion"),
    "control": ("autoencoder", "diffusion", "distill"),
    "evaluator": (),
}
"""Stages of which a release can hold weights, and the stages that they build on. The stage `forces` is part of the
autoencoder there."""

_BUILT_ON = {"distill": "diffusion", "control": "distill"}
"""The stage whose weights a stage was trained on, where it may lie in a file of its own."""

_APART = (*_BUILT_ON, "evaluator")
"""Stages that may lie in a file of their own."""

TEXT = "text"
TEXT_FILES = (NETWORK, VOCABULARY)
LIBRARIES = ("flexmotion", "torch", "safetensors")


def write_release(run: Run, path: Path, *, stages: Sequence[str] | None = None, description: str = "") -> ReleaseFile:
    """Write the best weights of a run as a release.

    Args:
        run: trained, or still in training.
        path: of the file.
        stages: of `NEEDS`, and `text` for the sentence encoder; None for all that are trained. Without `text` the
            encoder lies in the folder `text` beside the file, unless a shipped bundle has it.
        description: for the header.

    Raises:
        ConfigError: a stage is unknown, has not been trained, or its weights are not finite.
    """
    known = (*NEEDS, TEXT)
    for name in stages or ():
        if name not in known:
            raise ConfigError(f"stage {name!r}: expected one of: {', '.join(known)}")
    chosen = [name for name in NEEDS if (is_trained(run.stage(name)) if stages is None else name in stages)]
    if not chosen:
        raise ConfigError(f"{run.folder}: no trained stage; run 'flexmotion train autoencoder' first")
    tensors: dict[str, Tensor] = {}
    for name in chosen:
        for parameter, value in _trained_weights(run, name).items():
            if value.is_floating_point() and not bool(value.isfinite().all()):
                raise ConfigError(f"{run.stage(name)}: {parameter}: holds numbers that are not finite")
            tensors[f"{name}.{parameter}"] = halved(value)
    has_text = (run.stage(TEXT) / NETWORK).is_file()
    if stages is not None and TEXT in stages and not has_text:
        raise ConfigError(f"{run.stage(TEXT)}: not trained; run 'flexmotion train text' first")
    encoder = _halved_text(run.stage(TEXT)) if has_text else {}
    if encoder and stages is not None and TEXT not in stages:
        _write_encoder(encoder, path.parent / TEXT)
    if stages is None or TEXT in stages:
        tensors |= {name: torch.frombuffer(bytearray(content), dtype=torch.uint8) for name, content in encoder.items()}
    summary = run.summary()
    tensors |= {name: torch.from_numpy(value) for name, value in summary.arrays().items()}
    header = ReleaseHeader(
        schema_=SCHEMA,
        name=run.config.name,
        description=description,
        config=run.config,
        seed=run.seed,
        layout=run.layout.hash,
        stages={name: _record(run.stage(name)) for name in chosen},
        set=SetFigures(**summary.figures()),
        text={name: hashlib.sha256(content).hexdigest() for name, content in encoder.items()},
        begun=run.origin.hash if run.origin else "",
        built_on={name: _mark(_trained_weights(run, below)) for name, below in _BUILT_ON.items() if name in chosen},
        personal=list(run.personal_wordings()),
        versions={name: version(name) for name in LIBRARIES},
    )
    return write_release_file(header, tensors, path)


def offered_stages(path: Path) -> list[str]:
    """Stages of `NEEDS` that a training may begin from: in a release, or in files beside it, see `begin_run`.

    Raises:
        ConfigError: the file is no release.
    """
    release = ReleaseFile(path)
    held = {name for name in NEEDS if name in _holding(release, name).header.stages}
    return [name for name, needs in NEEDS.items() if held.issuperset((name, *needs))]


def begin_run(
    path: Path, folder: Path, stages: Sequence[str], config: str | None = None, seed: int | None = None
) -> Run:
    """A training folder that begins from a release; an existing one that began from it is resumed.

    Args:
        path: of the release.
        folder: of the training.
        stages: whose weights are taken over, with those that they build on (`NEEDS`) and the sentence encoder; a
            student, a control branch and an evaluator that the file lacks from files beside it that were trained on
            its weights, or on its words and features. A stage that the folder has already is left as it is, and none is
            added to what the folder has trained further.
        config: name or file of a configuration with the same networks and windows; None for that of the release.
        seed: of everything drawn; None for that of the release.

    Raises:
        ConfigError: the release lacks a stage, does not fit this version or the configuration (the message names
            field or parameter), or the folder holds another training.
    """
    release = ReleaseFile(path)
    header, layout = release.header, layout_of(release.header.config)
    if header.layout != layout.hash:
        raise ConfigError(
            f"{path}: field layout: {header.layout}, this version has {layout.hash}: joints, points or blocks differ"
        )
    asked = header.config if config is None else load_model_config(config)
    if found := different_settings(header.config, asked):
        raise ConfigError(f"{path}: another configuration: {found}")
    if "corrections" not in asked.model_fields_set:
        asked = asked.model_copy(update={"corrections": header.config.corrections})
    wanted = list(dict.fromkeys(name for stage in stages for name in (*NEEDS.get(stage, ()), stage)))
    files = {name: _holding(release, name) for name in wanted}
    for name, file in files.items():
        _fitting(asked, layout, name, file)
    run = Run.begin(folder, asked, header.seed if seed is None else seed, Origin(name=header.name, hash=release.hash))
    arrays = {name: release.tensors[name].numpy() for name in ("mean", "spread", "rest")}
    SetSummary.of(arrays, header.set_.model_dump()).write(folder)
    if header.personal:
        (run.folder / PERSONAL).write_text(json.dumps(header.personal), encoding="utf-8")
    _unpack_text(release, run.stage(TEXT))
    for name, file in files.items():
        if is_trained(run.stage(name)) or (name in _BUILT_ON and _trained_further(run, NEEDS[name])):
            continue
        run.stage(name).mkdir(exist_ok=True)
        content = {"network": file.weights(name), **file.header.stages[name].model_dump(), BEGUN: file.hash}
        write_checkpoint(content, run.stage(name) / BEST)
    return run


def begin_to_export(path: Path, folder: Path, stage: str = "diffusion") -> Run:
    """A training folder with all that a bundle of a release needs: a stage, and student and control branch if any.

    Of a personalised release, also with the training that it began from, where its release lies beside it.

    Args:
        path: of the release.
        folder: of the training.
        stage: that the release or a file beside it must have.

    Raises:
        ConfigError: see `begin_run`.
    """
    more = [stage for stage in ("distill", "control") if stage in offered_stages(path)]
    run = begin_run(path, folder, [stage, *more])
    header = ReleaseFile(path).header
    if header.personal and (base := _release_beside(path, header.begun)) is not None:
        run.link_before(begin_to_export(base, folder / RELEASED))
    return run


def _release_beside(path: Path, wanted: str) -> Path | None:
    """The release with a hash, beside another one."""
    for other in sorted(path.parent.glob(f"*{path.suffix}")):
        with suppress(ConfigError, OSError, ValueError):  # of another program, or not readable
            if other != path and ReleaseFile(other).hash == wanted:
                return other
    return None


def _trained_weights(run: Run, name: str) -> dict[str, Tensor]:
    if name == "autoencoder":
        return load_autoencoder(run).state_dict()
    if not is_trained(run.stage(name)):
        raise ConfigError(f"{run.stage(name) / BEST}: not found; run 'flexmotion train {name}' first")
    weights: dict[str, Tensor] = read_checkpoint(run.stage(name) / BEST)["network"]
    return weights


def _record(folder: Path) -> StageRecord:
    made = training_record(folder)
    return StageRecord(
        step=made.best, steps=made.steps, processes=made.processes, batch=made.batch, figures=dict(made.figures)
    )


def _network(config: ModelConfig, layout: Layout, stage: str) -> nn.Module:
    if stage == "autoencoder":
        return Autoencoder(config.autoencoder, config.window, layout)
    if stage == "evaluator":
        return Evaluator(config.evaluator, config.window, layout, config.diffusion.text)
    latent, guided = config.autoencoder.latent, stage in ("distill", "control")
    denoiser = Denoiser(config.diffusion, config.window, layout, latent, guided=guided)
    if stage == "control":
        return ControlBranch(denoiser, config.control, config.window, layout)
    return denoiser


def _holding(release: ReleaseFile, stage: str) -> ReleaseFile:
    """The file with the weights of a stage: the release, or one beside it that belongs to it, see `_belongs`."""
    if stage in release.header.stages or stage not in _APART:
        return release
    for path in sorted(release.path.parent.glob(f"*{release.path.suffix}")):
        if path == release.path:
            continue
        with suppress(ConfigError, OSError, ValueError):  # of another program, or not readable: none of this training
            other = ReleaseFile(path)
            if stage in other.header.stages and _belongs(other, release, stage):
                return other
    return release  # which names the stages that it has


def _belongs(other: ReleaseFile, release: ReleaseFile, stage: str) -> bool:
    """Whether a stage of another file was trained on what a release holds: weights, or words and features."""
    below = _BUILT_ON.get(stage)
    if below is None:
        same = all(torch.equal(other.tensors[name], release.tensors[name]) for name in ("mean", "spread"))
        return bool(release.header.text) and other.header.text == release.header.text and same
    base = _holding(release, below)
    return below in base.header.stages and other.header.built_on.get(stage) == _mark(base.weights(below))


def _mark(weights: Mapping[str, Tensor]) -> str:
    """Digest of weights as a release stores them."""
    return digest({name: halved(value).float() for name, value in weights.items()})


def _trained_further(run: Run, stages: Sequence[str]) -> bool:
    """Whether a folder has trained one of these stages itself."""
    return any(is_trained(run.stage(name)) and begun_from(run.stage(name)) is None for name in stages)


def _fitting(config: ModelConfig, layout: Layout, stage: str, release: ReleaseFile) -> None:
    """Raise `ConfigError` where a stage's weights are not those of this version's network."""
    fill(_network(config, layout, stage), release.weights(stage), f"{release.path}, stage {stage}")


def _halved_text(folder: Path) -> dict[str, bytes]:
    """Content of the sentence encoder's files, as in a bundle."""
    with TemporaryDirectory() as place:
        network = Path(place) / NETWORK
        network.write_bytes((folder / NETWORK).read_bytes())
        halve_weights(network)
        return {NETWORK: network.read_bytes(), VOCABULARY: (folder / VOCABULARY).read_bytes()}


def _write_encoder(encoder: Mapping[str, bytes], folder: Path) -> None:
    """Write the files of a sentence encoder to `folder`, unless a shipped bundle has them."""
    expected = {name: hashlib.sha256(content).hexdigest() for name, content in encoder.items()}
    if any(_has_encoder(bundle, expected) for bundle in shipped_bundles().values()):
        return
    folder.mkdir(exist_ok=True)
    for name, content in encoder.items():
        (folder / name).write_bytes(content)


def _has_encoder(folder: Path, expected: Mapping[str, str]) -> bool:
    return all((folder / name).is_file() and sha256(folder / name) == expected[name] for name in TEXT_FILES)


def _unpack_text(release: ReleaseFile, folder: Path) -> None:
    """Write the sentence encoder of a release: that of the file, of the folder `text` beside it, or of a bundle."""
    expected = release.header.text
    if not expected or (folder / NETWORK).is_file():
        return
    if all(name in release.tensors for name in TEXT_FILES):
        content = {name: release.tensors[name].numpy().tobytes() for name in TEXT_FILES}
    else:
        beside = release.path.parent / TEXT
        same = (place for place in (beside, *shipped_bundles().values()) if _has_encoder(place, expected))
        place = next(same, None)
        if place is None:
            raise ConfigError(
                f"{release.path}: was written without its sentence encoder; expected it in {beside}, or in a bundle of"
                " this installation; write it with --stages ...,text"
            )
        content = {name: (place / name).read_bytes() for name in TEXT_FILES}
    folder.mkdir(exist_ok=True)
    for name, data in content.items():
        (folder / name).write_bytes(data)
