"""`export_personal`: the bundle of a personalised training, which is that of the model before with one more network.

Everything else is what it was: networks, arrays, corrections, and what its judges passed. A request that is not in the
person's manner is therefore sampled bit for bit as before.
"""

from __future__ import annotations

from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch

from flexmotion.bundles.bundle import DECODER, Bundle, control_of, write_bundle
from flexmotion.bundles.card import CARD, add_note
from flexmotion.bundles.manifest import SCHEMA
from flexmotion.configs.errors import ConfigError
from flexmotion.onnx_session import open_session
from flexmotion.onnx_session import run as run_network
from flexmotion.text.sentence_encoder import SentenceEncoder
from flexmotion.training.checkpoints import is_trained, training_record
from flexmotion.training.export import (
    Decoder,
    denoiser_inputs,
    export,
    export_control,
    load_control,
    load_networks,
    remove_networks,
    require_bundle_folder,
    write_denoiser,
)
from flexmotion.training.feature_store import FeatureStore
from flexmotion.training.half_weights import halve_weights
from flexmotion.training.manner_conditions import mean_embedding
from flexmotion.training.run import PERSON, Run
from flexmotion.training.store_index import INDEX

NETWORK = "person-{}.onnx"
"""Denoiser of a person, numbered from 1."""

SAME = 0.05
"""Root mean square by which decoders of one model may differ, in spreads of the features: in eight bits they do by
.013, in half precision by less."""


def export_bundle(run: Run, folder: Path, *, distilled: bool, onto: Bundle | None = None, **how: Any) -> Bundle:
    """Write the bundle of a run, personalised or not; see `export` and `export_personal`."""
    if run.personal_wordings():
        return export_personal(run, folder, distilled=distilled, onto=onto, **how)
    if onto is not None:
        raise ConfigError(f"{run.folder}: is not personalised, and cannot be added to a bundle")
    return export(run, folder, distilled=distilled, **how)


def export_personal(run: Run, folder: Path, *, distilled: bool, onto: Bundle | None = None, **how: Any) -> Bundle:
    """Write the bundle of a personalised run.

    Args:
        run: personalised and, for `distilled`, distilled.
        folder: of the bundle; an existing bundle there is overwritten.
        distilled: as in `export`, of both models.
        onto: bundle of the model before; None: it is exported from the training that the run began from, with the
            persons that it has.
        how: arguments of that export.

    Raises:
        ConfigError: a stage has not been trained; the training before is not there any more; or the bundle is of
            another model, or knows the person already.
    """
    if onto is not None:
        return _with_person(onto, run, folder, distilled=distilled)
    with TemporaryDirectory() as place:
        before = export_bundle(run.before(), Path(place) / "before", distilled=distilled, **how)
        return _with_person(before, run, folder, distilled=distilled)


def _with_person(before: Bundle, run: Run, folder: Path, *, distilled: bool) -> Bundle:
    manner, manifest = run.personal_wordings()[0], before.manifest
    require_bundle_folder(folder)
    if folder.resolve() == before.folder.resolve():
        raise ConfigError(f"{folder}: is the bundle of the model before, which is kept; choose another folder")
    if manner.lower() in (name.lower() for name in before.manners.names):
        raise ConfigError(f"{before.folder}: knows {manner!r} already")
    autoencoder, denoiser = load_networks(run, distilled=distilled)
    _require_model_of(before, run, Decoder(autoencoder, denoiser).eval(), distilled=distilled)
    folder.mkdir(parents=True, exist_ok=True)
    remove_networks(folder)
    for name in (*manifest.files, CARD):
        copyfile(before.folder / name, folder / name)
    network = NETWORK.format(len(manifest.personal) + 1)
    inputs = denoiser_inputs(run, autoencoder.latent, distilled=distilled)
    write_denoiser(denoiser, folder / network, inputs, eight_bits=manifest.eight_bits)
    if before.has_control and (branch := _branch_of(run)) is not None:
        control = folder / control_of(network)
        export_control(load_control(run, denoiser, branch), run, control, inputs)
        halve_weights(control)
    added = mean_embedding(run.personal_wordings(), SentenceEncoder(run.stage("text"))).astype(np.float16)
    arrays = before.arrays | {
        "manner_names": np.array([*before.manners.names, manner]),
        "manner_embeddings": np.concatenate([before.arrays["manner_embeddings"], added[None]]),
    }
    licences = sorted({*manifest.licence.split("; "), *run.summary().licences})
    changes = {"schema_": SCHEMA, "personal": manifest.personal | {manner: network}, "licence": "; ".join(licences)}
    made = write_bundle(folder, manifest.model_copy(update=changes), arrays)
    add_note(folder, _note(before, run, network, distilled=distilled))
    return made


def _branch_of(run: Run) -> Path | None:
    """Folder of the control branch of the model before; None where that has none, or is not there any more.

    It keeps a hand in its place for the fine-tuned student as well as for the one that it was trained on
    (docs/decisions.md).
    """
    while run.personal_wordings():
        if not run.has_before:
            return None
        run = run.before()
    return run.stage("control") if is_trained(run.stage("control")) else None


def _require_model_of(before: Bundle, run: Run, decoder: Decoder, *, distilled: bool) -> None:
    """Raise `ConfigError` where a bundle is not that of the model that a run fine-tuned."""
    manifest, window = before.manifest, run.config.window
    other = f"{before.folder}: is not of the model that {run.folder} began from"
    if manifest.guided != distilled or not manifest.manner:
        way = "distilled" if manifest.guided else "of the diffusion"
        raise ConfigError(f"{before.folder}: is {way}{'' if manifest.manner else ', without manners'}; export it anew")
    ours = (run.layout.hash, window.history, window.future, decoder.autoencoder.latent, run.config.diffusion.steps)
    theirs = (manifest.layout, manifest.history, manifest.future, manifest.latent, manifest.times)
    statistics = run.summary().statistics
    same = np.array_equal(statistics.mean, before.arrays["mean"])
    if ours != theirs or not same or not np.array_equal(statistics.spread, before.arrays["spread"]):
        raise ConfigError(f"{other} (windows or features differ)")
    (said,) = run.personal_wordings()
    if not np.allclose(SentenceEncoder(before.folder)(said), SentenceEncoder(run.stage("text"))(said), atol=SAME):
        raise ConfigError(f"{other} (sentence encoders differ)")
    draw = np.random.default_rng(0).standard_normal
    latent = draw((1, manifest.latent), np.float32)
    history = before.statistics.normalise(before.rest)[len(before.rest) - manifest.history :][None].astype(np.float32)
    with torch.no_grad():
        own = decoder(torch.from_numpy(latent), torch.from_numpy(history)).numpy()
    path = before.folder / DECODER
    found = run_network(open_session(path), path, {"latent": latent, "history": history})
    if np.sqrt(np.square(found - own).mean()) > SAME:
        raise ConfigError(f"{other} (decoders differ)")


def _note(before: Bundle, run: Run, network: str, *, distilled: bool) -> str:
    """Paragraph of the model card about a person; a weights file has none of its clips."""
    seen = ""
    if (run.folder / PERSON / INDEX).is_file():
        clips = [clip for clip in FeatureStore(run.folder / PERSON).clips if clip.recorded]
        minutes = sum(clip.frames for clip in clips) / run.config.window.fps / 60
        seen = f", on {len(clips)} clips and mirror images, {minutes:.1f} min"
    steps = f"{training_record(run.stage('diffusion')).steps} steps"
    steps += f", {training_record(run.stage('distill')).steps} of the student" if distilled else ""
    return (
        f"**{run.personal_wordings()[0]}** is the manner of a person, with a network of its own (`{network}`: {steps}"
        f"{seen}), added to the bundle {before.hash}. Requests in other manners are sampled as by that bundle, of which"
        " the figures are; no judge has seen the person's."
    )
