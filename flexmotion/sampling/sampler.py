"""`Sampler`: the next second of human motion from the last frames and a request; onnxruntime, no torch."""

from __future__ import annotations

from functools import cached_property
from operator import index
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from onnxruntime import InferenceSession

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.biomechanics.smoothing import CUTOFF
from flexmotion.bundles.bundle import DECODER, DENOISER, Bundle
from flexmotion.configs.errors import ConfigError, SamplingError
from flexmotion.configs.repertoire import RobotRepertoire
from flexmotion.features.constraints import Constraints
from flexmotion.features.decode import Anchor, decode
from flexmotion.features.encode import LEAD, encode
from flexmotion.features.inertialise import inertialised
from flexmotion.features.unhurried import CALM, FASTEST, unhurried
from flexmotion.human.motion import Motion
from flexmotion.onnx_session import open_session, run
from flexmotion.sampling.condition import Condition
from flexmotion.sampling.constraint_solver import CORRECTIONS, ConstraintSolver, check
from flexmotion.sampling.ddim import denoised
from flexmotion.sampling.delivery import KNOWN, Delivered
from flexmotion.sampling.draft import Draft
from flexmotion.sampling.guidance import guided
from flexmotion.sampling.kept_pose import KeptPose
from flexmotion.sampling.low_pass import SLOW_CUTOFF
from flexmotion.sampling.made_pose import made_pose
from flexmotion.sampling.request import Requests
from flexmotion.sampling.rhythm import SIZES, Rhythm
from flexmotion.sampling.still_stance import StillStance
from flexmotion.sampling.tangent import tangent_of
from flexmotion.text.prompt_reader import Prompt

__all__ = ["Condition", "Sampler"]

Float32 = NDArray[np.float32]

STANDS = 0.2
"""A body that has gone slower than this for a second stands [m/s]; a pelvis that goes down in a squat goes .15 back."""


class Sampler:
    """Samples motion from a bundle, one window at a time, on one thread; buffers are made once.

    Windows in a person's manner are sampled by the network of that person, all others by the bundle's denoiser: what is
    not asked in that manner is what a bundle without the person samples, bit for bit.

    Args:
        bundle: trained and exported.
        steps: of the diffusion; None for the bundle's default.
        unjudged: whether to offer what the bundle knows and was not judged to do, as its judges need.
        balanced: whether windows are low-passed and balanced, with forces that belong to their motion (`delivery.py`);
            else they are as planted, with the forces of the decoder, as earlier versions sampled them.
        corrections: steps by which windows with constraints are corrected (`constraint_solver.py`); with 0 a
            course acts by velocities alone.
        robot: what the robot that follows was judged to do; None: all. Words for any other kind of motion mean standing
            still, and the warning of `prompt` names it.

    Raises:
        ConfigError: a network of the bundle cannot be run, or the number of steps is out of range.
    """

    def __init__(
        self,
        bundle: Bundle,
        steps: int | None = None,
        *,
        unjudged: bool = False,
        balanced: bool = True,
        corrections: int = CORRECTIONS,
        robot: RobotRepertoire | None = None,
    ) -> None:
        manifest = bundle.manifest
        self.balanced, self.corrections, self.robot = balanced, corrections, robot
        self.bundle, self.layout, self.body = bundle, bundle.layout, bundle.body
        self.history, self.future = manifest.history, manifest.future
        self.steps = manifest.steps if steps is None else steps
        if not 1 <= self.steps <= manifest.times:
            raise ConfigError(f"steps is {self.steps}, expected 1 to {manifest.times}")
        # Joining paths takes as long as a matrix product.
        self._denoiser_path, self._decoder_path = bundle.folder / DENOISER, bundle.folder / DECODER
        self._denoiser, self._decoder = open_session(self._denoiser_path), open_session(self._decoder_path)
        self.requests = Requests(bundle, unjudged, robot)
        self._rest = self.standing()
        self._statistics, self._kept = bundle.statistics, bundle.kept
        # A distilled network has guidance as an input: one evaluation a step. Else guidance takes one with the request,
        # one in any manner and one without a request.
        conditions = 3 if manifest.manner else 2
        self._rows = rows = 1 if manifest.guided else conditions
        width = bundle.prompts.embeddings.shape[1]
        self._inputs: dict[str, np.ndarray] = {
            "noisy": np.zeros((rows, manifest.latent), np.float32),
            "time": np.zeros(rows, np.int64),
            "history": np.zeros((rows, self.history, self.layout.size), np.float32),
            "sentence": np.zeros((rows, width), np.float32),
            "velocity": np.zeros((rows, 3), np.float32),
            "present": np.zeros((rows, conditions), np.float32),
        }
        if manifest.manner:
            self._inputs["manner"] = np.zeros((rows, width), np.float32)
        if manifest.guided:
            self._inputs["guidance"] = np.zeros((rows, 2) if manifest.manner else rows, np.float32)
        self._branches: dict[Path, InferenceSession] = {}
        self._rhythms: dict[tuple[str, int], Rhythm] = {}
        # Opened and run once now: a live planner has no time for that when it is first asked for the manner.
        self._personal = {manner: (open_session(path), path) for manner, path in bundle.personal.items()}
        for session, path in self._personal.values():
            run(session, path, self._inputs)

    @property
    def fps(self) -> float:
        """Frames per second of history and samples."""
        return self.layout.fps

    @cached_property
    def free(self) -> Constraints:
        """Constraints of a window that ask for nothing."""
        return Constraints.none(self.layout, self.body, self.future)

    def rhythm(self, condition: Condition, size: int = 0) -> Rhythm | None:
        """The gesture that a condition's words mean, where arms and head make it over a human that stands; else None.

        Args:
            condition: before it is `meant`.
            size: which of its sizes, any number; all take the same time.
        """
        kind = self.requests.rhythm(condition)
        if kind is None:
            return None
        key = kind, size % SIZES
        if key not in self._rhythms:
            self._rhythms[key] = Rhythm.of(kind, self.body, self._rest.joints[-1], size)
        return self._rhythms[key].paced(condition.tempo)

    def rests(self, condition: Condition, history: Motion) -> bool:
        """Whether pelvis and legs of a human stay as they are, where a condition of `meant` has no constraints.

        Args:
            condition: of the window after the history.
            history: at least one frame.
        """
        return self.requests.leaves_legs(condition) and StillStance.of(history, self._rest) is not None

    def made_pose(self, condition: Condition, begin: Motion, seed: int) -> KeptPose | None:
        """The pose in which a gesture that a condition of `meant` asks for is held; None: it is left to the model.

        Args:
            condition: of words.
            begin: the motion up to its begin, at least one frame.
            seed: of what is left open of the pose.
        """
        kind = self.requests.pose(condition)
        if kind is None:
            return None
        return made_pose(kind, self.body, begin.joints[-1], self._rest.joints[-1], seed)

    @property
    def name(self) -> str:
        """Name of the bundle."""
        return self.bundle.manifest.name

    @property
    def remembers(self) -> int:
        """Frames of history that a sample depends on."""
        return max(self.history + LEAD, KNOWN if self.balanced else 0)

    @property
    def unsettled(self) -> int:
        """Last frames of a window whose forces the next window changes: they are used after it is sampled."""
        return EDGE if self.balanced else 0

    @property
    def follows_velocity(self) -> bool:
        """Whether a velocity can be requested."""
        return self.bundle.manifest.velocity

    def standing(self, after: Motion | None = None) -> Motion:
        """A standing human: a history to begin with.

        Args:
            after: the human stands where this motion ends, with its last heading; None: at the origin, facing x.
        """
        anchor = Anchor.origin() if after is None else Anchor.after(after)
        return decode(self.bundle.rest, self.layout, self.body, anchor, source=self._source)

    def sample(self, history: Motion, condition: Condition, seed: int) -> Motion:
        """The `future` frames after a history.

        Args:
            history: the last frames, of the bundle's body, at its frame rate; `remembers` of them determine the
                sample. With fewer, motion before them is taken as even.
            condition: the request.
            seed: of the noise, 0 or more.

        Raises:
            SamplingError: the history is empty, or has another frame rate or body; or constraints are of another model,
                or of what it cannot follow; or the seed is negative or no whole number.
            ConfigError: a network of the bundle fails.
        """
        return self.extend(history, condition, seed).window

    def extend(self, history: Motion, condition: Condition, seed: int) -> Delivered:
        """The window of `sample`, and the last frames of the history with forces that belong to what follows now.

        Args:
            history, condition, seed: see `sample`.

        Raises:
            SamplingError, ConfigError: see `sample`.
        """
        constraints, meant = condition.constrained, self.meant(condition)
        if constraints is not None:
            manner = self.requests.manner(meant)
            check(constraints, self.bundle, self.balanced, branch=self.bundle.control(manner) is not None)
        remembered = self._remember(history)
        latent = self._latent(remembered, meant, seed)
        draft = self._draft(history, remembered, condition, meant)
        if constraints is not None:
            return self._solver.window(draft, self._frames, latent, constraints, self.corrections)
        found = self._frames(latent)
        return draft.delivered(draft.planted(draft.joined(found))[0], found)

    def planted(self, features: Float32, history: Motion, condition: Condition) -> Motion:
        """Motion of features after a history, its loaded feet in place; forces are as decoded."""
        return self._draft(history, features[:0], condition, self.meant(condition)).planted(features)[0]

    def _draft(self, history: Motion, remembered: Float32, condition: Condition, meant: Condition) -> Draft:
        """The window in the making; parts of the body that the condition, as it is `meant`, leaves alone rest in it."""
        asked = condition.constrained
        free = asked is None or not asked.of_frames
        # Feet of a body that still walks would go through the floor.
        came = history[max(0, len(history) - round(self.fps)) :].net_speed
        slow = condition.held or came < STANDS and self.requests.is_slow(meant)
        return Draft(
            layout=self.layout,
            body=self.body,
            history=history,
            remembered=remembered,
            balanced=self.balanced,
            rest=self._rest,
            idle=self.requests.idle(meant) if free else frozenset(),
            stands=free and self.requests.stands(meant),
            quiet=asked is None and self.requests.leaves_legs(meant),
            on_the_spot=not self.requests.travels(meant),
            in_place=free and self.requests.keeps_feet(meant),
            fastest=self._fastest(meant),
            asked=asked,
            pose=condition.pose or self.rhythm(condition),
            beside=condition.beside,
            cutoff=SLOW_CUTOFF if free and slow else CUTOFF,
            source=self._source,
        )

    def prepare(self) -> None:
        """Make now what the first window with constraints needs: a live planner has no time for that."""
        _ = self._solver

    @cached_property
    def _solver(self) -> ConstraintSolver:
        return ConstraintSolver(self.layout, tangent_of(self.bundle, self._decode))

    def features(self, history: Motion, condition: Condition, seed: int) -> Float32:
        """Features of a sample as decoded and joined, before its feet are planted, not normalised, (W, layout.size)."""
        remembered, meant = self._remember(history), self.meant(condition)
        frames = self._frames(self._latent(remembered, meant, seed))
        return unhurried(inertialised(frames, remembered, self.layout), remembered, self.layout, self._fastest(meant))

    def _fastest(self, meant: Condition) -> float:
        """Fastest turn of an upper arm in a condition of `meant` [rad/s]."""
        return FASTEST if self.requests.hurries(meant) else CALM

    def _frames(self, latent: Float32) -> Float32:
        """Features of a latent after the history of the last request, not joined to it, not normalised, (W, F)."""
        return self._statistics.restore(self._decode(latent, self._inputs["history"][:1]))

    def _decode(self, latent: Float32, history: Float32) -> Float32:
        """Normalised features, (W, F), of a latent (1, L) after a normalised history (1, H, F)."""
        return run(self._decoder, self._decoder_path, {"latent": latent, "history": history})[0]

    def _remember(self, history: Motion) -> Float32:
        """Features of the history, not normalised, (H, F)."""
        if not len(history):
            raise SamplingError("the history has no frames")
        if history.body != self.body:
            raise SamplingError(f"the history is of {history.body}, the bundle's human is {self.body}")
        last = history[max(0, len(history) - self.history - LEAD) :]
        # The inputs of the networks are kinematic.
        encoded = encode(last.kinematics, self.layout)
        features = encoded[len(encoded) - min(self.history, len(encoded)) :]
        if len(features) < self.history:
            first = np.repeat(features[:1], self.history - len(features), axis=0)
            features = np.concatenate([first, features])
        return features.astype(np.float32)

    def _latent(self, remembered: Float32, condition: Condition, seed: int) -> Float32:
        """A normalised latent of a condition of `meant`, (1, L)."""
        inputs, manifest = self._inputs, self.bundle.manifest
        inputs["history"][:] = self._statistics.normalise(remembered)
        scale, manner_scale = self.requests.guidance(condition)
        self.requests.write(condition, remembered, inputs)
        if manifest.guided:
            inputs["guidance"][:] = (scale, manner_scale) if manifest.manner else scale
        noisy = _generator(seed).standard_normal((1, manifest.latent), np.float32)
        noisy *= self.requests.noise(condition)

        def estimate(noisy: Float32, time: int) -> Float32:
            inputs["noisy"][:], inputs["time"][:] = noisy, time
            return self._estimate(condition, scale, manner_scale)

        return denoised(noisy, self._kept, self.steps, estimate)

    def _estimate(self, condition: Condition, scale: float, manner_scale: float) -> Float32:
        """The network's estimate of the clean latent from its inputs, (1, L)."""
        asked, manner = condition.constrained, self.requests.manner(condition)
        # The branch was trained on what is asked of frames; means are left to the corrections.
        branch = None if asked is None or not asked.of_frames else self.bundle.control(manner)
        if asked is not None and branch is not None:
            values = {"values": asked.values[None].astype(np.float32), "mask": asked.mask[None].astype(np.float32)}
            return run(self._controlled(branch), branch, self._inputs | values)
        session, path = self._personal.get(manner, (self._denoiser, self._denoiser_path))
        found = run(session, path, self._inputs)
        return found if self.bundle.manifest.guided else guided(found, scale, manner_scale)

    def _controlled(self, path: Path) -> InferenceSession:
        """A network with a control branch, opened on first use."""
        if path not in self._branches:
            self._branches[path] = open_session(path)
        return self._branches[path]

    def meant(self, condition: Condition) -> Condition:
        """See `Requests.meant`."""
        return self.requests.meant(condition)

    def own_velocity(self, condition: Condition) -> tuple[float, float, float] | None:
        """See `Requests.own_velocity`."""
        return self.requests.own_velocity(condition)

    def prompt(self, text: str | None) -> Prompt:
        """See `Requests.prompt`."""
        return self.requests.prompt(text)

    def is_word(self, word: str) -> bool:
        """See `flexmotion.text.prompt_reader.PromptReader.is_word`."""
        return self.requests.reader.is_word(word)

    @property
    def _source(self) -> str:
        return f"model:{self.name}"


def _generator(seed: int) -> np.random.Generator:
    """Random numbers of a seed. Raises `SamplingError` where it is negative or no whole number."""
    try:
        return np.random.default_rng(index(seed))
    except (TypeError, ValueError) as error:
        raise SamplingError(f"seed is {seed!r}, expected a whole number, 0 or more") from error
