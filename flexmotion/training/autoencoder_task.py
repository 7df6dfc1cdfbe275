"""The autoencoder's stages: all modalities first, then torques, forces, contacts and activations alone."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import ModelConfig
from flexmotion.features.layout import JOINT_CONTACT
from flexmotion.training.autoencoder import Autoencoder
from flexmotion.training.checkpoints import digest, is_trained, load_weights
from flexmotion.training.draws import normal
from flexmotion.training.feature_store import FeatureStore
from flexmotion.training.kinematics import points, pose, segments
from flexmotion.training.losses import Reconstruction, divergence, weighted
from flexmotion.training.muscle_torques import MuscleTorques
from flexmotion.training.principal_components import principal_components
from flexmotion.training.processes import Processes
from flexmotion.training.run import Run
from flexmotion.training.window_set import WindowSet
from flexmotion.training.windows import Windows

VALIDATION = 256
"""Windows of the validation, always the same."""


class AutoencoderTask:
    """Training of the autoencoder; see `stage.Task`.

    Args:
        config: of the model.
        store: features of the set.
        seed: of the weights and of all draws.
        processes: that train.
        muscles: muscle torques; None for no such loss.
        trained: folder of a trained autoencoder, whose forces alone are trained further; None for a new one.
        begun: folder of trained weights to go on from, all of them; None for a new network.

    Raises:
        ConfigError: `trained` or `begun` holds no weights, or those of another network.
    """

    def __init__(
        self,
        config: ModelConfig,
        store: FeatureStore,
        seed: int,
        processes: Processes,
        muscles: MuscleTorques | None = None,
        trained: Path | None = None,
        begun: Path | None = None,
    ) -> None:
        torch.manual_seed(seed)
        self.config, self.seed, self.processes = config, seed, processes
        self._stage = config.stages.autoencoder if trained is None else config.stages.forces
        self._new = trained is None
        self.network = Autoencoder(config.autoencoder, config.window, store.layout).to(processes.device)
        self.loss = Reconstruction(store.layout, store.statistics, config.losses, muscles)
        self.training = WindowSet(store, config.window, "train")
        held_out = WindowSet(store, config.window, "validation")
        self._held_out = held_out.draw((seed, 1), VALIDATION).to(processes.device)
        self._humans = self.training.humans.to(processes.device)
        if trained is not None:
            load_weights(self.network, trained)
            self.network.hold_motion()
        elif begun is not None:
            load_weights(self.network, begun)
        elif config.autoencoder.shortcut:
            known = self.network.known.cpu()
            self.network.begin_with(
                principal_components(self.training, store.layout, config.losses, config.autoencoder.latent, known, seed)
            )

    def losses(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        """See `stage.Task`."""
        batch = self._stage.batch
        windows = self.training.draw((self.seed, 0, step, self.processes.rank), batch).to(self.processes.device)
        noise = normal((self.seed, 2, step, self.processes.rank), (batch, self.config.autoencoder.latent))
        noise = noise.to(self.processes.device)
        return self._losses(windows, noise, self.config.losses.physics_share, self._physics_weight(step))

    def _physics_weight(self, step: int) -> float:
        """Factor of the physics losses at a step, 0 to 1."""
        begin = self.config.losses.physics_from if self._new else 0
        return min(max(step / begin - 1.0, 0.0), 1.0) if begin else 1.0

    def _losses(
        self, windows: Windows, noise: Tensor, physics_share: float, physics: float = 1.0
    ) -> tuple[Tensor, dict[str, Tensor]]:
        with self.processes.mixed_precision():
            decoded, mean, spread = self.network(windows.history, windows.future, noise, windows.future_loads)
        decoded = decoded.float()
        terms = self.loss.kinematic(decoded, windows) | self.loss.muscular(decoded)
        terms["divergence"] = divergence(mean.float(), spread.float())
        part = int(round(physics_share * len(decoded)))
        if part:
            some = windows.first_of(part)
            humans = self._humans[torch.from_numpy(some.clip).to(decoded.device)]
            terms |= self.loss.physical(decoded[:part], some, humans)
        return weighted(terms, self.config.losses, physics), terms

    def validate(self) -> dict[str, float]:
        """See `measure`, of the held-out windows."""
        return self.measure(self._held_out)

    def measure(self, windows: Windows) -> dict[str, float]:
        """Losses of windows; mean distances of points [mm] and of joint contact forces [body weights]."""
        noise = torch.zeros(len(windows.future), self.config.autoencoder.latent, device=windows.future.device)
        total, terms = self._losses(windows, noise, 1.0)
        figures = {name: float(value.detach()) for name, value in terms.items()} | {"loss": float(total.detach())}
        latent = self.network.encode(windows.history, windows.future)[0]
        decoded = self.network.decode(windows.history, latent, windows.future_loads)
        humans = self._humans[torch.from_numpy(windows.clip).to(decoded.device)]
        layout = self.loss.layout
        found, expected = (
            points(segments(pose(self.loss.restore(frames.float()), layout, humans), humans), humans)
            for frames in (decoded, windows.future)
        )
        if layout.joint_contact:
            columns = layout.blocks[JOINT_CONTACT]
            missing = [self.loss.restore(frames.float())[..., columns] for frames in (decoded, windows.future)]
            distance = (missing[0] - missing[1]).detach().unflatten(-1, (-1, 3)).norm(dim=-1)
            figures["joint_contact_bw"] = float(distance[windows.good[:, -distance.shape[1] :]].mean())
        figures["points_mm"] = 1e3 * float((found - expected).detach().norm(dim=-1)[windows.mask].mean())
        return figures


def load_autoencoder(run: Run) -> Autoencoder:
    """A run's best autoencoder, with the forces of the stage `forces` where that was trained.

    Raises:
        ConfigError: it has not been trained, or the forces are of another autoencoder's motion.
    """
    network = Autoencoder(run.config.autoencoder, run.config.window, run.layout)
    load_weights(network, run.stage("autoencoder"))
    folder = run.stage("forces")
    if not is_trained(folder):
        return network
    expected = digest(network.motion())
    load_weights(network, folder)
    if digest(network.motion()) != expected:
        raise ConfigError(f"{folder}: is of another autoencoder's motion; train it again in an empty folder")
    return network
