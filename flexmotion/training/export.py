"""`export`: writes a run's best weights as a bundle."""

from __future__ import annotations

from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from shutil import copyfile

import numpy as np
import torch
from torch import Tensor, nn

from flexmotion.bundles.bundle import CONTROL, DECODER, DENOISER, JACOBIAN, Bundle, write_bundle
from flexmotion.bundles.card import Making, write_card
from flexmotion.bundles.manifest import MANIFEST, SCHEMA, BodySize, Manifest
from flexmotion.configs.corrections import Corrections
from flexmotion.configs.errors import ConfigError
from flexmotion.features.constraint_layout import ConstraintLayout
from flexmotion.human.body import Body
from flexmotion.sampling.tangent import decoder_jacobian
from flexmotion.text.manners import manner_wordings, manners
from flexmotion.text.phrases import kinds, wordings
from flexmotion.text.sayings import sayings
from flexmotion.text.sentence_encoder import NETWORK, VOCABULARY, SentenceEncoder
from flexmotion.training.autoencoder import Autoencoder
from flexmotion.training.autoencoder_task import load_autoencoder
from flexmotion.training.checkpoints import is_trained, load_weights, training_record
from flexmotion.training.control_branch import ConstrainedDenoiser, ControlBranch
from flexmotion.training.denoiser import Denoiser
from flexmotion.training.eight_bits import to_eight_bits
from flexmotion.training.export_onnx import export_network
from flexmotion.training.half_weights import halve_weights
from flexmotion.training.listener_training import fit_listener, fit_manner_listener
from flexmotion.training.manner_conditions import mean_embedding
from flexmotion.training.noise_schedule import NoiseSchedule
from flexmotion.training.run import Run
from flexmotion.training.set_summary import SetSummary

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
    eight_bits: bool = False,
) -> Bundle:
    """Write a bundle; that of a person is made by `personal_export.export_personal`.

    Args:
        run: trained, and not personalised.
        folder: of the bundle; an existing bundle there is overwritten.
        distilled: True exports the student of the distillation, False the diffusion model.
        body: size and mass of the human, with the proportions of the set; None for the default.
        description: for the manifest and the model card.
        corrections: of the exported model; None for those of the run's configuration.
        eight_bits: whether products of matrices in denoiser and decoder are of integers (`eight_bits.py`).

    Raises:
        ConfigError: a stage has not been trained, the run is personalised, or the folder is not empty and no bundle.
    """
    if personal := run.personal_wordings():
        raise ConfigError(f"{run.folder}: is personalised to {personal[0]!r}, and no bundle without the model before")
    require_bundle_folder(folder)
    corrections = run.config.corrections if corrections is None else corrections
    corrections.require_known(kinds(), manners(), "corrections")
    known = {manner: own for manner, own in corrections.manner_speeds.items() if manner in run.summary().manners}
    corrections = corrections.model_copy(update={"manner_speeds": known})
    folder.mkdir(parents=True, exist_ok=True)
    autoencoder, denoiser = load_networks(run, distilled=distilled)
    remove_networks(folder)
    summary, config, layout = run.summary(), run.config, run.layout
    window, diffusion = config.window, config.diffusion
    inputs = denoiser_inputs(run, autoencoder.latent, distilled=distilled)
    write_denoiser(denoiser, folder / DENOISER, inputs, eight_bits=eight_bits)
    decoding = {"latent": inputs["noisy"][:1], "history": inputs["history"][:1]}
    decoder = Decoder(autoencoder, denoiser).eval()
    export_network(decoder, folder / DECODER, decoding, ["frames"])
    networks = [DECODER, NETWORK]
    if distilled and is_trained(run.stage("control")):
        export_control(load_control(run, denoiser), run, folder / CONTROL, inputs)
        networks.append(CONTROL)
    for name in (NETWORK, VOCABULARY):
        copyfile(run.stage("text") / name, folder / name)
    if eight_bits:
        to_eight_bits(folder / DECODER)
    for name in networks:
        halve_weights(folder / name)
    body = summary.with_proportions(body or Body())
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
        eight_bits=eight_bits,
        licence="; ".join(summary.licences) or UNKNOWN_LICENCE,
        versions={name: version(name) for name in LIBRARIES},
    )
    names = ["autoencoder", "diffusion", *(["distill"] if distilled else [])]
    names += [name for name in ("forces", "control") if is_trained(run.stage(name)) and (distilled or name == "forces")]
    records = {name: training_record(run.stage(name)) for name in names}
    begun = "" if run.origin is None else f"{run.origin.name}, hash {run.origin.hash}"
    made = Making(config.name, summary.hours, summary.clips, run.seed, records, begun)
    write_card(folder, manifest, made)
    arrays = _arrays(run, summary, diffusion.steps)
    if window.history:  # models of whole clips have a large one, which is measured where it is needed
        arrays[JACOBIAN] = _jacobian(run, decoder, summary)
    return write_bundle(folder, manifest, arrays)


def require_bundle_folder(folder: Path) -> None:
    """Raise `ConfigError` where a folder holds something else than a bundle."""
    if folder.exists() and any(folder.iterdir()) and not (folder / MANIFEST).is_file():
        raise ConfigError(f"{folder}: is not empty and not a bundle")


def remove_networks(folder: Path) -> None:
    """Remove the networks of an earlier bundle, of which a new one may lack some."""
    for path in folder.glob("*.onnx"):
        path.unlink()


def denoiser_inputs(run: Run, latent: int, *, distilled: bool) -> dict[str, Tensor]:
    """Inputs of an exported denoiser by name; without guidance as an input, those of a step under guidance."""
    window, diffusion, rows = run.config.window, run.config.diffusion, 1 if distilled else 3
    inputs = {
        "noisy": torch.zeros(rows, latent),
        "time": torch.zeros(rows, dtype=torch.int64),
        "history": torch.zeros(rows, window.history, run.layout.size),
        "sentence": torch.zeros(rows, diffusion.text),
        "velocity": torch.zeros(rows, 3),
        "manner": torch.zeros(rows, diffusion.text),
        "present": torch.zeros(rows, 3),
    }
    return inputs | ({"guidance": torch.ones(rows, 2)} if distilled else {})


def write_denoiser(denoiser: Denoiser, path: Path, inputs: dict[str, Tensor], *, eight_bits: bool) -> None:
    """Write a denoiser as a bundle keeps it."""
    export_network(denoiser, path, inputs, ["clean"])
    if eight_bits:
        to_eight_bits(path)
    halve_weights(path)


def load_control(run: Run, denoiser: Denoiser, folder: Path | None = None) -> ConstrainedDenoiser:
    """The distilled denoiser of a run with its control branch.

    Args:
        run: of the denoiser.
        denoiser: distilled.
        folder: of the branch's weights; None for the run's own.

    Raises:
        ConfigError: the branch has not been trained, or has weights of another network.
    """
    branch = ControlBranch(denoiser, run.config.control, run.config.window, run.layout)
    load_weights(branch, run.stage("control") if folder is None else folder)
    return ConstrainedDenoiser(denoiser, branch).eval()


def export_control(controlled: ConstrainedDenoiser, run: Run, path: Path, inputs: dict[str, Tensor]) -> None:
    """Write a denoiser with its control branch; `inputs`: those of the denoiser."""
    shape = (1, run.config.window.future, ConstraintLayout(run.layout).size)
    constraints = {"values": torch.zeros(shape), "mask": torch.zeros(shape)}
    export_network(controlled, path, inputs | constraints, ["clean"])


def _jacobian(run: Run, decoder: Decoder, summary: SetSummary) -> np.ndarray:
    """Derivatives of a standing human's decoded motion by the latent; see `bundle.JACOBIAN`."""
    window, size = run.config.window, decoder.autoencoder.latent
    rest = summary.statistics.normalise(summary.rest)[len(summary.rest) - window.history :]
    history = torch.from_numpy(rest)[None]

    def decode(latent: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            found: np.ndarray = decoder(torch.from_numpy(latent), history)[0].numpy()
        return found

    blocks = run.layout.blocks
    moved = slice(blocks["root"].start, blocks["rotations"].stop)
    return decoder_jacobian(decode, size)[:, moved].astype(np.float16)


def _arrays(run: Run, summary: SetSummary, steps: int) -> dict[str, np.ndarray]:
    encode = SentenceEncoder(run.stage("text"))
    prompts = [(kind, wording) for kind in summary.kinds for wording in wordings(kind)]
    manners = {name: manner_wordings(name) for name in summary.manners}
    return {
        **summary.arrays(),
        "kept": NoiseSchedule(steps).kept.numpy(),
        "prompt_kinds": np.array([kind for kind, _ in prompts]),
        "prompt_embeddings": np.stack([encode(wording) for _, wording in prompts]).astype(np.float16),
        "manner_names": np.array(list(manners)),
        "manner_embeddings": np.stack([mean_embedding(said, encode) for said in manners.values()]).astype(np.float16),
        **fit_listener(encode, sayings()),
        **fit_manner_listener(encode),
    }
