"""Model settings: windows, networks, losses and training stages. `paper` and `stream` are shipped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from flexmotion.configs.corrections import Corrections
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import Strict, load

FOLDER = Path(__file__).parent / "model"


class Window(Strict):
    """The frames of one sample, at `fps`.

    Attributes:
        fps: frames per second.
        history: known frames; 0 for whole clips.
        future: frames that are generated.
        patch: frames per token.
        muscles: whether muscle activations are part of a frame.
        joint_contact: whether joint contact forces are part of a frame.
        padded: whether clips shorter than a window are extended by their last frame (whole clips); else left out.
    """

    fps: float = Field(gt=0)
    history: int = Field(ge=0)
    future: int = Field(gt=0)
    patch: int = Field(gt=0)
    muscles: bool = True
    joint_contact: bool = False
    padded: bool = False

    @model_validator(mode="after")
    def _fits(self) -> Window:
        for name in ("history", "future"):
            if getattr(self, name) % self.patch:
                raise ValueError(f"{name} {getattr(self, name)} must be a multiple of patch {self.patch}")
        return self


class Transformer(Strict):
    """A stack of Transformer layers; the feed-forward part has width `expansion` x `width`."""

    width: int = Field(gt=0)
    heads: int = Field(gt=0)
    layers: int = Field(gt=0)
    expansion: int = Field(default=4, gt=0)

    @model_validator(mode="after")
    def _fits(self) -> Transformer:
        if self.width % self.heads:
            raise ValueError(f"width {self.width} must be a multiple of heads {self.heads}")
        return self


class AutoencoderConfig(Strict):
    """Encoder and decoder around a latent vector of `latent` numbers.

    Attributes:
        shortcut: whether principal components of windows are added to each network, which learns the residual. For
            short windows; the size of the components is that of a window times that of the latent.
        loads: whether the decoder of forces is told the external loads of a set's variants. It learns forces for every
            load; an exported model has none. Else it learns the forces of the mean load.
    """

    latent: int = Field(gt=0)
    shortcut: bool = False
    loads: bool = False
    encoder: Transformer
    decoder: Transformer


class LossWeights(Strict):
    """Weights of the autoencoder's losses; 0: not used.

    Attributes:
        blocks: each block of features: mean square of the normalised error; wrenches: mean absolute error.
        force_error: estimated error of the ground forces at which the labels of forces, torques, contacts, joint
            contact and activations count half in a frame [body weights]; 0: every `good` frame counts alike. About the
            error of a model in frames with good labels (`training/losses.py` has the rule).
        path: path of the root over the window, from the first frame on.
        points: points of the body from forward kinematics.
        change: change from frame to frame, including the join with the history.
        divergence: Kullback-Leibler divergence of the latent from a standard normal.
        euler_joints, euler_root: residual of the equations of motion, per body weight and leg.
        muscle_limits: activations outside [0, 1].
        muscle_torques: difference between muscle torques and joint torques.
        physics_share: share of every batch on which points and physics are computed (the most expensive losses).
        physics_from: step at which the physics losses begin; they reach full weight after as many steps again. Before
            poses are nearly right, residuals of second derivatives are noise that dominates the other losses.
    """

    blocks: dict[str, float]
    force_error: float = Field(default=0.1, ge=0)
    path: float = Field(default=0.0, ge=0)
    points: float = Field(default=0.0, ge=0)
    change: float = Field(default=0.0, ge=0)
    divergence: float = Field(default=0.0, ge=0)
    euler_joints: float = Field(default=0.0, ge=0)
    euler_root: float = Field(default=0.0, ge=0)
    muscle_limits: float = Field(default=0.0, ge=0)
    muscle_torques: float = Field(default=0.0, ge=0)
    physics_share: float = Field(default=1.0, ge=0, le=1)
    physics_from: int = Field(default=0, ge=0)


class DiffusionConfig(Strict):
    """Latent diffusion.

    Attributes:
        denoiser: the network.
        steps: of the noise schedule (cosine).
        text: width of the sentence embeddings.
        velocity: whether a velocity of the root can be commanded.
        drop_text, drop_velocity, drop_history: share of samples without this condition, as guidance needs.
        drop_manner: share of samples with a sentence that are given no manner; those without sentence never are.
        normal: least share of a kind's samples in the normal manner, where it has clips of it.
        history_noise: standard deviation of the noise on the history, of normalised features.
        decoded: weight of the error of the decoded motion; that of the latent has weight 1.
        decoded_every: one of this many samples of a batch is decoded (decoding costs as much as denoising).
        roll_out: final share of samples whose history is the model's own sample of the window before.
        roll_out_steps: DDIM steps of that sample.
        switched: share of samples that change from one clip's motion to another's, as after a new target.
        switch_frames: frames of this change.
        begun: of the other samples of clips, share at the beginning of a motion, after a stand.
        roll_out_from, roll_out_grown: training steps at which roll-outs begin and reach their final share.
        guidance: default scale of classifier-free guidance.
        manner_guidance: likewise, of the manner against any manner.
        sampling_steps: default number of DDIM steps.
        sampled: share of samples at the very times of these steps; the others are at any time.
    """

    denoiser: Transformer
    steps: int = Field(default=1000, gt=0)
    text: int = Field(default=384, gt=0)
    velocity: bool = True
    drop_text: float = Field(default=0.1, ge=0, le=1)
    drop_velocity: float = Field(default=0.5, ge=0, le=1)
    drop_history: float = Field(default=0.0, ge=0, le=1)
    drop_manner: float = Field(default=0.15, ge=0, le=1)
    normal: float = Field(default=0.4, ge=0, lt=1)
    history_noise: float = Field(default=0.0, ge=0)
    decoded: float = Field(default=0.0, ge=0)
    decoded_every: int = Field(default=1, gt=0)
    roll_out: float = Field(default=0.0, ge=0, le=1)
    roll_out_steps: int = Field(default=1, gt=0)
    switched: float = Field(default=0.0, ge=0, le=1)
    switch_frames: int = Field(default=16, gt=0)
    begun: float = Field(default=0.0, ge=0, le=1)
    roll_out_from: int = Field(default=0, ge=0)
    roll_out_grown: int = Field(default=1, ge=1)
    guidance: float = Field(default=2.5, gt=0)
    manner_guidance: float = Field(default=1.5, gt=0)
    sampling_steps: int = Field(default=50, gt=0)
    sampled: float = Field(default=0.0, ge=0, le=1)

    @model_validator(mode="after")
    def _fits(self) -> DiffusionConfig:
        if self.roll_out + self.switched > 1.0:
            raise ValueError(f"roll_out {self.roll_out:g} and switched {self.switched:g} must be at most 1 together")
        return self


class DistillationConfig(Strict):
    """Distillation of guidance: one evaluation of the student for three of its teacher.

    Attributes:
        guidance_low, guidance_high: range of the random guidance scale, an input of the student.
        huber: error at which the loss changes from quadratic to linear.
        sampling_steps: default number of steps of the student.
    """

    guidance_low: float = Field(default=1.0, gt=0)
    guidance_high: float = Field(default=4.0, gt=0)
    huber: float = Field(default=0.5, gt=0)
    sampling_steps: int = Field(default=2, ge=1)

    @model_validator(mode="before")
    @classmethod
    def _without_former(cls, content: Any) -> Any:
        """Without settings of a distillation of earlier releases, which their files still hold."""
        if not isinstance(content, dict):
            return content
        return {name: value for name, value in content.items() if name not in ("grid", "skip")}


class ControlConfig(Strict):
    """The control branch: how constraints of single frames get into a distilled model.

    Attributes:
        layers: of the denoiser that are copied, from the first on.
        patch: frames per token of constraints.
        latent: weight of the error of the latent; that of the constrained values has weight 1.
    """

    layers: int = Field(default=3, gt=0)
    patch: int = Field(default=8, gt=0)
    latent: float = Field(default=1.0, ge=0)


class EvaluatorConfig(Strict):
    """Encoders of motion and text into a common space of `width` numbers, trained contrastively."""

    motion: Transformer
    width: int = Field(default=128, gt=0)
    temperature: float = Field(default=0.1, gt=0)


class Stage(Strict):
    """Training of one network.

    Attributes:
        steps: of the optimiser.
        batch: windows per step.
        learning_rate: after `warm_up` steps; constant until the last `cool_down` share of the steps, then linear to 0.
        decay: weight decay (AdamW).
        average: decay of the moving average of the weights, which are the result of the training.
        validate_every: steps between validations; the best weights are kept too.
    """

    steps: int = Field(gt=0)
    batch: int = Field(gt=0)
    learning_rate: float = Field(gt=0)
    warm_up: int = Field(default=200, ge=0)
    cool_down: float = Field(default=0.2, ge=0, le=1)
    decay: float = Field(default=0.01, ge=0)
    average: float = Field(default=0.999, ge=0, lt=1)
    validate_every: int = Field(default=500, gt=0)


class Stages(Strict):
    """The stages in the order of training."""

    autoencoder: Stage
    diffusion: Stage
    distill: Stage
    forces: Stage = Stage(steps=20000, batch=64, learning_rate=6.0e-4)
    control: Stage = Stage(steps=20000, batch=64, learning_rate=3.0e-4)
    evaluator: Stage


class ModelConfig(Strict):
    """All settings of a model and its training; the data are separate.

    `corrections` are written into exported bundles as they are; training does not depend on them.
    """

    name: str
    window: Window
    autoencoder: AutoencoderConfig
    losses: LossWeights
    diffusion: DiffusionConfig
    distillation: DistillationConfig
    control: ControlConfig = ControlConfig()
    evaluator: EvaluatorConfig
    stages: Stages
    corrections: Corrections = Corrections()

    @model_validator(mode="after")
    def _control_fits(self) -> ModelConfig:
        if self.control.layers > self.diffusion.denoiser.layers:
            raise ValueError(
                f"control.layers {self.control.layers} must be at most those of the denoiser,"
                f" {self.diffusion.denoiser.layers}"
            )
        return self


def shipped_models() -> list[str]:
    """Names of the shipped configurations."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def load_model_config(name: str | Path) -> ModelConfig:
    """A shipped configuration by name, or a YAML file. Raises `ConfigError`."""
    if str(name) in shipped_models():
        return load(ModelConfig, FOLDER / f"{name}.yaml")
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"model configuration {str(name)!r}: expected {', '.join(shipped_models())} or a YAML file")
    return load(ModelConfig, path)
