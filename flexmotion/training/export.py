"""`export`: writes a run's best weights as a bundle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields, replace
from importlib.metadata import version
from pathlib import Path
from shutil import copyfile

import numpy as np
import torch
from torch import Tensor, nn

from flexmotion.bundles.bundle import DECODER, DENOISER, Bundle, write_bundle
from flexmotion.bundles.card import Making, write_card
from flexmotion.bundles.manifest import SCHEMA, BodySize, Manifest
from flexmotion.configs.corrections import Corrections
from flexmotion.configs.errors import ConfigError
from flexmotion.features.layout import POINTS, Layout
from flexmotion.human.body import Body, Segments
from flexmotion.human.skeleton import SIDES
from flexmotion.text.phrases import ALIASES, STAND, WALK, kinds, wordings
from flexmotion.text.sayings import sayings
from flexmotion.text.sentence_encoder import NETWORK, VOCABULARY, SentenceEncoder
from flexmotion.training.autoencoder import Autoencoder
from flexmotion.training.autoencoder_task import load_autoencoder
from flexmotion.training.checkpoints import is_trained, load_weights, training_record
from flexmotion.training.conditions import STILL, clip_kind
from flexmotion.training.denoiser import Denoiser
from flexmotion.training.export_onnx import export_network
from flexmotion.training.feature_store import FeatureStore
from flexmotion.training.half_weights import halve_weights
from flexmotion.training.listener_training import fit_listener, fit_manner_listener
from flexmotion.training.manner_conditions import Manners
from flexmotion.training.noise_schedule import NoiseSchedule
from flexmotion.training.run import Run
from flexmotion.training.window_set import WindowSet

LIBRARIES = ("flexmotion", "torch", "onnx", "scikit-learn")

UNKNOWN_LICENCE = "as the data that it was trained on"


class Decoder(nn.Module):
    """Decodes a normalised latent, given the history, to normalised frames."""

    def __init__(self, autoencoder: Autoencoder, denoiser: Denoiser) -> None:
        super().__init__()
        self.autoencoder = autoencoder
        self.register_buffer("mean", denoiser.latent_mean.clone())
        self.register_buffer("spread", denoiser.latent_spread.clone())

    mean: Tensor
    spread: Tensor

    def forward(self, latent: Tensor, history: Tensor) -> Tensor:
        """(N, latent), (N, H, F) -> (N, W, F)."""
        return self.autoencoder.decode(history, latent * self.spread + self.mean)


def load_networks(run: Run, *, distilled: bool) -> tuple[Autoencoder, Denoiser]:
    """The best autoencoder and denoiser of a run.

    Raises:
        ConfigError: one of them has not been trained, or the forces are of another autoencoder's motion.
    """
    config, layout = run.config, run.layout
    autoencoder = load_autoencoder(run)
    denoiser = Denoiser(config.diffusion, config.window, layout, autoencoder.latent, guided=distilled)
    load_weights(denoiser, run.stage("distill" if distilled else "diffusion"))
    return autoencoder.eval(), denoiser.eval()


def export(
    run: Run,
    folder: Path,
    *,
    distilled: bool,
    body: Body | None = None,
    description: str = "",
    corrections: Corrections | None = None,
) -> Bundle:
    """Write a bundle.

    Args:
        run: trained.
        folder: of the bundle; an existing bundle there is overwritten.
        distilled: True exports the student of the distillation, False the diffusion model.
        body: size and mass of the human, with the proportions of the set; None for the default.
        description: for the manifest and the model card.
        corrections: of the exported model; None for those of the run's configuration.

    Raises:
        ConfigError: a stage has not been trained, or the folder is not empty and no bundle.
    """
    if folder.exists() and any(folder.iterdir()) and not (folder / "manifest.json").is_file():
        raise ConfigError(f"{folder}: is not empty and not a bundle")
    corrections = run.config.corrections if corrections is None else corrections
    corrections.require_known(kinds(), "corrections")
    folder.mkdir(parents=True, exist_ok=True)
    autoencoder, denoiser = load_networks(run, distilled=distilled)
    store, config, layout = run.store(), run.config, run.layout
    window, diffusion = config.window, config.diffusion
    rows = 1 if distilled else 3
    inputs = {
        "noisy": torch.zeros(rows, autoencoder.latent),
        "time": torch.zeros(rows, dtype=torch.int64),
        "history": torch.zeros(rows, window.history, layout.size),
        "sentence": torch.zeros(rows, diffusion.text),
        "velocity": torch.zeros(rows, 3),
        "manner": torch.zeros(rows, diffusion.text),
        "present": torch.zeros(rows, 3),
    }
    if distilled:
        inputs["guidance"] = torch.ones(rows, 2)
    export_network(denoiser, folder / DENOISER, inputs, ["clean"])
    decoding = {"latent": inputs["noisy"][:1], "history": inputs["history"][:1]}
    export_network(Decoder(autoencoder, denoiser).eval(), folder / DECODER, decoding, ["frames"])
    for name in (NETWORK, VOCABULARY):
        copyfile(run.stage("text") / name, folder / name)
    for name in (DENOISER, DECODER, NETWORK):
        halve_weights(folder / name)
    body = with_proportions(body or Body(), store)
    manifest = Manifest(
        schema_=SCHEMA,
        name=config.name,
        description=description,
        layout=layout.hash,
        fps=window.fps,
        muscles=layout.muscles,
        joint_contact=layout.joint_contact,
        history=window.history,
        future=window.future,
        latent=autoencoder.latent,
        steps=config.distillation.sampling_steps if distilled else diffusion.sampling_steps,
        times=diffusion.steps,
        guided=distilled,
        guidance=diffusion.guidance,
        manner_guidance=diffusion.manner_guidance,
        velocity=diffusion.velocity,
        manner=True,
        body=BodySize(height=body.height, mass=body.mass, sex=body.sex, segments=asdict(body.segments)),
        corrections=corrections,
        licence="; ".join(store.licences) or UNKNOWN_LICENCE,
        versions={name: version(name) for name in LIBRARIES},
    )
    training = [clip for clip in store.clips if clip.split == "train"]
    hours = sum(clip.frames for clip in training) / window.fps / 3600
    names = ["autoencoder", "diffusion", *(["distill"] if distilled else [])]
    if is_trained(run.stage("forces")):
        names.append("forces")
    records = {name: training_record(run.stage(name)) for name in names}
    made = Making(config.name, hours, len(training), run.seed, records)
    write_card(folder, manifest, made)
    return write_bundle(folder, manifest, _arrays(run, store, layout, diffusion.steps))


def _arrays(run: Run, store: FeatureStore, layout: Layout, steps: int) -> dict[str, np.ndarray]:
    encode = SentenceEncoder(run.stage("text"))
    shown = shown_kinds(store)
    prompts = [(kind, wording) for kind in shown for wording in wordings(kind)]
    training = [clip for clip in store.clips if clip.split == "train"]
    manners = [Manners(training, encode)]
    if personal := run.personal_wordings():
        manners.append(Manners(training[:1], encode, personal))
    return {
        **asdict(store.statistics),
        "kept": NoiseSchedule(steps).kept.numpy(),
        "rest": standing_features(store, run),
        "prompt_kinds": np.array([kind for kind, _ in prompts]),
        "prompt_embeddings": np.stack([encode(wording) for _, wording in prompts]).astype(np.float16),
        "manner_names": np.array([name for one in manners for name in one.names]),
        "manner_embeddings": np.concatenate([one.means.numpy() for one in manners]).astype(np.float16),
        **fit_listener(encode, sayings()),
        **fit_manner_listener(encode, personal),
    }


def shown_kinds(store: FeatureStore) -> tuple[str, ...]:
    """Kinds of motion with wordings that clips of the training split show; standing is in every set."""
    found = {clip_kind(clip) for clip in store.clips if clip.split == "train"}
    # Straight windows of turning clips are trained as walking.
    straight = {WALK for kind in found if kind.startswith("walk-turn")}
    own = {ALIASES.get(kind, kind) for kind in found} | straight | {STAND}
    return tuple(kind for kind in kinds() if kind in own)


def with_proportions(body: Body, store: FeatureStore) -> Body:
    """A human of this size with the median proportions of a store's humans, weighted by their frames.

    With other proportions the same joint angles would put the feet above or below the floor.
    """
    # Variants have bodies that nobody recorded.
    clips = [clip for clip in store.clips if clip.split == "train" and clip.recorded]
    seconds = np.maximum(np.array([clip.frames for clip in clips]) // round(store.layout.fps), 1)
    segments = {}
    for name in (item.name for item in fields(Segments)):
        lengths = name != "toe_out"
        values = [getattr(clip.body.segments, name) / (clip.body.leg if lengths else 1.0) for clip in clips]
        median = float(np.median(np.repeat(values, seconds)))
        segments[name] = round(median * (body.leg if lengths else 1.0), 5)
    return replace(body, fitted=Segments(**segments))


def standing_features(store: FeatureStore, run: Run) -> np.ndarray:
    """Features of a human who stands still, arms hanging, not normalised, (H, F): the stretch nearest to the median."""
    window = run.config.window.model_copy(update={"history": 0, "future": max(run.config.window.history, 1)})
    windows = WindowSet(store, window, "train", variants=False).draw((run.seed, 41), 4096)
    features = store.statistics.restore(windows.future.numpy())
    speed = features[..., layout_columns(store.layout, ("velocities",))]
    still = np.abs(speed).mean(axis=(1, 2)) < STILL / 4
    upright = features[..., store.layout.blocks["root"]][..., -1, 3] > 1.0
    places = features[..., store.layout.blocks["positions"]].reshape(*features.shape[:2], len(POINTS), 3)
    hands, hips = (places[:, -1, [POINTS.index(f"{name}_{side}") for side in SIDES], 2] for name in ("hand", "hip"))
    resting = still & upright & (hands < hips).all(axis=1)
    chosen = features[resting] if resting.any() else features
    poses = chosen[:, -1, layout_columns(store.layout, ("rotations",))]
    nearest = np.linalg.norm(poses - np.median(poses, axis=0), axis=1).argmin()
    rest: np.ndarray = chosen[nearest].astype(np.float32)
    return rest


def layout_columns(layout: Layout, names: Sequence[str]) -> list[int]:
    """Columns of some blocks."""
    return [at for name in names for at in range(layout.blocks[name].start, layout.blocks[name].stop)]
