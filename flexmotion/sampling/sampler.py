"""`Sampler`: the next second of human motion from the last frames and a request; onnxruntime, no torch."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache
from math import hypot

import numpy as np
from numpy.typing import NDArray
from onnxruntime import InferenceSession

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.bundles.bundle import CONTROL, DECODER, DENOISER, Bundle
from flexmotion.bundles.repertoire import offered_kinds, offered_manners
from flexmotion.configs.errors import ConfigError
from flexmotion.features.decode import Anchor, decode
from flexmotion.features.encode import LEAD, encode
from flexmotion.features.heading_frame import chord
from flexmotion.features.inertialise import inertialised
from flexmotion.human.motion import Motion
from flexmotion.onnx_session import open_session, run
from flexmotion.sampling.condition import Condition
from flexmotion.sampling.constraint_solver import CORRECTIONS, ConstraintSolver, check
from flexmotion.sampling.ddim import denoised
from flexmotion.sampling.delivery import KNOWN, Delivered
from flexmotion.sampling.draft import Draft
from flexmotion.sampling.guidance import guided
from flexmotion.sampling.tangent import tangent_of
from flexmotion.text import phrases
from flexmotion.text.manners import NORMAL
from flexmotion.text.phrases import BACK, STAND, TURNS, WALK
from flexmotion.text.prompt_reader import Prompt, PromptReader

__all__ = ["Condition", "Sampler"]

Float32 = NDArray[np.float32]

STILL = 0.05
"""A velocity without words whose components are all smaller than this means standing still [m/s, rad/s]."""

RUN_FROM = 2.0
"""Humans change between walking and running at about this speed [m/s]."""

SPOT = 0.25
"""A turn at a lower speed than this is a turn on the spot [m/s]."""

BACK_FROM = 0.1
"""The words of walking backward are used from this backward speed on; a smaller one does not change the gait [m/s]."""


class Sampler:
    """Samples motion from a bundle, one window at a time, on one thread; buffers are made once.

    Args:
        bundle: trained and exported.
        steps: of the diffusion; None for the bundle's default.
        unjudged: whether to offer what the bundle knows and was not judged to do, as its judges need.
        balanced: whether windows are low-passed and balanced, with forces that belong to their motion (`delivery.py`);
            else they are as planted, with the forces of the decoder, as earlier versions sampled them.
        corrections: steps by which windows with constraints are corrected (`constraint_solver.py`).

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
    ) -> None:
        manifest = bundle.manifest
        self.balanced, self.corrections = balanced, corrections
        self.bundle, self.layout, self.body = bundle, bundle.layout, bundle.body
        self.history, self.future = manifest.history, manifest.future
        self.steps = manifest.steps if steps is None else steps
        if not 1 <= self.steps <= manifest.times:
            raise ConfigError(f"steps is {self.steps}, expected 1 to {manifest.times}")
        self._denoiser = open_session(bundle.folder / DENOISER)
        self._decoder = open_session(bundle.folder / DECODER)
        prompts = bundle.prompts
        known, embeddings = bundle.manners.names, bundle.manners.embeddings
        self._manners = dict(zip(known, embeddings, strict=True))
        self.manners = known if unjudged else offered_manners(bundle)
        self.reader = PromptReader(
            bundle.folder,
            prompts.kinds,
            prompts.embeddings,
            bundle.listener,
            None if unjudged else offered_kinds(bundle),
            self.manners,
            bundle.manner_listener,
        )
        self._rest = self.standing().joints[-1]
        self._walking, self._backing = self.reader.meaning(WALK), self.reader.meaning(BACK)
        self._turning = tuple(self.reader.meaning(kind) for kind in TURNS)
        self.read = lru_cache(maxsize=64)(self.reader)
        self._statistics, self._kept = bundle.statistics, bundle.kept
        self._corrections = manifest.corrections
        # A distilled network has guidance as an input: one evaluation a step. Else guidance takes one with the request,
        # one in any manner and one without a request.
        conditions = 3 if manifest.manner else 2
        self._rows = rows = 1 if manifest.guided else conditions
        width = prompts.embeddings.shape[1]
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

    @property
    def fps(self) -> float:
        """Frames per second of history and samples."""
        return self.layout.fps

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
            seed: of the noise.

        Raises:
            ValueError: the history is empty, or has another frame rate or body; or constraints are of another model, or
                of what it cannot follow.
            ConfigError: a network of the bundle fails.
        """
        return self.extend(history, condition, seed).window

    def extend(self, history: Motion, condition: Condition, seed: int) -> Delivered:
        """The window of `sample`, and the last frames of the history with forces that belong to what follows now.

        Args:
            history, condition, seed: see `sample`.

        Raises:
            ValueError, ConfigError: see `sample`.
        """
        constraints = condition.constrained
        if constraints is not None:
            check(constraints, self.bundle, self.balanced)
        remembered = self._remember(history)
        latent = self._latent(remembered, condition, seed)
        draft = self._draft(history, remembered, condition)
        if constraints is not None:
            return self._solver.window(draft, self._frames, latent, constraints, self.corrections)
        found = self._frames(latent)
        return draft.delivered(draft.planted(draft.joined(found))[0], found)

    def planted(self, features: Float32, history: Motion, condition: Condition) -> Motion:
        """Motion of features after a history, its loaded feet in place; forces are as decoded."""
        return self._draft(history, features[:0], condition).planted(features)[0]

    def _draft(self, history: Motion, remembered: Float32, condition: Condition) -> Draft:
        """The window in the making; its upper body goes to rest where it stands and nothing else is asked of it."""
        rests = condition.constrained is None and self._stands(self.meant(condition))
        rest = self._rest if rests else None
        return Draft(self.layout, self.body, history, remembered, self.balanced, rest, self._source)

    @cached_property
    def _solver(self) -> ConstraintSolver:
        """Made on first use."""
        return ConstraintSolver(self.layout, tangent_of(self.bundle, self._decode))

    def features(self, history: Motion, condition: Condition, seed: int) -> Float32:
        """Features of a sample as decoded, before its feet are planted, not normalised, (W, layout.size)."""
        remembered = self._remember(history)
        return inertialised(self._frames(self._latent(remembered, condition, seed)), remembered, self.layout)

    def _frames(self, latent: Float32) -> Float32:
        """Features of a latent after the history of the last request, not joined to it, not normalised, (W, F)."""
        return self._statistics.restore(self._decode(latent, self._inputs["history"][:1]))

    def _decode(self, latent: Float32, history: Float32) -> Float32:
        """Normalised features, (W, F), of a latent (1, L) after a normalised history (1, H, F)."""
        return run(self._decoder, self.bundle.folder / DECODER, {"latent": latent, "history": history})[0]

    def _remember(self, history: Motion) -> Float32:
        """Features of the history, not normalised, (H, F)."""
        if not len(history):
            raise ValueError("the history has no frames")
        if history.body != self.body:
            raise ValueError(f"the history is of {history.body}, the bundle's human is {self.body}")
        last = history[max(0, len(history) - self.history - LEAD) :]
        # The inputs of the networks are kinematic.
        encoded = encode(last.kinematics, self.layout)
        features = encoded[len(encoded) - min(self.history, len(encoded)) :]
        if len(features) < self.history:
            first = np.repeat(features[:1], self.history - len(features), axis=0)
            features = np.concatenate([first, features])
        return features.astype(np.float32)

    def _latent(self, remembered: Float32, condition: Condition, seed: int) -> Float32:
        """A normalised latent, (1, L)."""
        inputs, manifest = self._inputs, self.bundle.manifest
        inputs["history"][:] = self._statistics.normalise(remembered)
        scale = manifest.guidance if condition.guidance is None else condition.guidance
        manner_scale = manifest.manner_guidance if condition.manner_guidance is None else condition.manner_guidance
        condition = self.meant(condition)
        self._set_request(condition, remembered)
        if manifest.guided:
            inputs["guidance"][:] = (scale, manner_scale) if manifest.manner else scale
        noisy = np.random.default_rng(seed).standard_normal((1, manifest.latent), np.float32)
        noisy *= self._noise(condition)

        def estimate(noisy: Float32, time: int) -> Float32:
            inputs["noisy"][:], inputs["time"][:] = noisy, time
            return self._estimate(condition, scale, manner_scale)

        return denoised(noisy, self._kept, self.steps, estimate)

    def _estimate(self, condition: Condition, scale: float, manner_scale: float) -> Float32:
        """The network's estimate of the clean latent from its inputs, (1, L)."""
        asked, folder = condition.constrained, self.bundle.folder
        if asked is not None and self.bundle.has_control:
            values = {"values": asked.values[None].astype(np.float32), "mask": asked.mask[None].astype(np.float32)}
            return run(self._controlled, folder / CONTROL, self._inputs | values)
        found = run(self._denoiser, folder / DENOISER, self._inputs)
        return found if self.bundle.manifest.guided else guided(found, scale, manner_scale)

    @cached_property
    def _controlled(self) -> InferenceSession:
        """The network with its control branch, opened on first use."""
        return open_session(self.bundle.folder / CONTROL)

    def meant(self, condition: Condition) -> Condition:
        """The condition with words replaced by the velocity that they mean, where they mean one, within its pace."""
        if not self.follows_velocity or condition.wordless:
            return condition
        if condition.text is not None and condition.manner is None:
            said = self.prompt(condition.text).manner
            condition = replace(condition, manner=None if said == NORMAL else said)
        if condition.velocity is None:
            kind = self.prompt(condition.text).kind
            meant, speed = phrases.velocity(kind), self._corrections.speeds.get(kind)
            if meant is not None:
                return self._slowed(replace(condition, text=None, velocity=meant))
            slowed = None if speed is None else self._slowed(replace(condition, velocity=speed))
            # Within its pace a motion follows its words alone.
            if speed is None or slowed is None or slowed.velocity == speed:
                return condition
            assert slowed.velocity is not None
            walks = hypot(*speed[:2]) > RUN_FROM > hypot(*slowed.velocity[:2])
            # Words of running, and of turning, pull the body to their own speed: half as fast again in a turn.
            return replace(slowed, text=None) if walks or speed[2] else slowed
        still = condition.text is None and np.abs(condition.velocity).max() < STILL
        return replace(condition, velocity=None) if still else self._slowed(condition)

    @property
    def travelling_noise(self) -> float:
        """Most noise of windows that travel, relative to others."""
        return self._corrections.travelling_noise

    def own_velocity(self, condition: Condition) -> tuple[float, float, float] | None:
        """Velocity at which a condition of `meant` is done; None where its words are of an unknown speed."""
        if condition.velocity is not None:
            return condition.velocity
        kind = self.prompt(condition.text).kind
        return (0.0, 0.0, 0.0) if kind == STAND else self._corrections.speeds.get(kind)

    @staticmethod
    def _slowed(condition: Condition) -> Condition:
        if condition.pace is None or condition.velocity is None:
            return condition
        return replace(condition, velocity=condition.pace.slowed(condition.velocity))

    def _noise(self, condition: Condition) -> float:
        """Scale of the noise that a window begins from."""
        if self._stands(condition):
            return condition.noise * self._corrections.standing_noise
        if condition.velocity is None:
            return condition.noise
        spot, travelling = self._corrections.spot_noise, self._corrections.travelling_noise
        return min(condition.noise, spot if self._turns_on_the_spot(condition) else travelling)

    @staticmethod
    def _turns_on_the_spot(condition: Condition) -> bool:
        if condition.text is not None or condition.velocity is None:
            return False
        forward, left, turning = condition.velocity
        return hypot(forward, left) < SPOT and abs(turning) >= STILL

    def _stands(self, condition: Condition) -> bool:
        return not condition.wordless and condition.velocity is None and self.prompt(condition.text).kind == STAND

    def _set_request(self, condition: Condition, remembered: Float32) -> None:
        """Write the request to the inputs: the first row has it, the second is the one without for guidance."""
        inputs, corrections = self._inputs, self._corrections
        inputs["present"][:] = 0.0
        if condition.wordless:
            if condition.velocity is not None and self.bundle.manifest.velocity:
                self._set_velocity(condition.velocity)
            return
        if condition.velocity is not None and self.bundle.manifest.velocity:
            ahead, aside, turning = condition.asked or condition.velocity
            more = self._catch_up(condition.velocity, remembered)
            ahead = corrections.asked_ahead(ahead) + more[0] - corrections.ahead_per_aside * abs(aside)
            turning = corrections.turning * turning + corrections.turning_per_aside * aside
            # Bodies sway sideways in every gait: without a sideways velocity nothing is caught up with.
            aside = corrections.aside * (aside + more[1]) if aside else 0.0
            self._set_velocity((ahead, aside, turning))
        elif condition.asked is not None and self.bundle.manifest.velocity:
            self._set_velocity(condition.asked)
        inputs["sentence"][:] = self._words(condition).embedding
        inputs["present"][0, 0] = 1.0
        if self.bundle.manifest.manner:
            inputs["present"][1:-1] = inputs["present"][0]  # without guidance as an input: the request in any manner
            manner = self._manner(condition)
            if manner is not None:
                inputs["manner"][:] = manner
                inputs["present"][0, 2] = 1.0

    def _set_velocity(self, velocity: tuple[float, float, float]) -> None:
        # The network was trained on the displacement of a window in its first heading, which is a chord of the arc.
        forward, left = chord(*velocity, seconds=self.future / self.fps)
        self._inputs["velocity"][:] = (forward / self.body.leg, left / self.body.leg, velocity[2])
        self._inputs["present"][0, 1] = 1.0

    def _manner(self, condition: Condition) -> Float32 | None:
        """Embedding of the manner of a request; None where the model was trained on no clip of the normal one."""
        name = condition.manner
        if name is None:
            name = NORMAL if condition.text is None else self.prompt(condition.text).manner
        if name not in self._manners and name != NORMAL:
            raise ConfigError(f"manner {name!r}: model {self.name} knows {', '.join(self._manners) or 'none'}")
        return self._manners.get(name)

    def _words(self, condition: Condition) -> Prompt:
        """The words of the request; of a velocity without words, those of walking, or of turning on the spot."""
        if condition.velocity is None or condition.text is not None:
            return self.prompt(condition.text)
        # Without words the model reaches a velocity in any manner: on its knees, or with its hands in the air.
        forward, left, turning = condition.velocity
        if self._turns_on_the_spot(condition):
            return self._turning[turning < 0]
        return self._backing if forward < -max(abs(left), BACK_FROM) else self._walking

    def _catch_up(self, velocity: tuple[float, float, float], remembered: Float32) -> tuple[float, float]:
        """Forward and left velocity added to the request for what the history lacks [m/s]."""
        if not len(remembered):
            return 0.0, 0.0
        start = self.layout.blocks["root"].start
        lacks = np.array(velocity[:2]) - self.body.leg * remembered[:, start : start + 2].mean(axis=0)
        limit = self._corrections.catch_up_limit
        ahead, aside = np.clip(self._corrections.catch_up * lacks, -limit, limit)
        return float(ahead), float(aside)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of motion that it offers."""
        return self.reader.offered

    def prompt(self, text: str | None) -> Prompt:
        """Meaning of a text; standing still for None."""
        return self.reader.idle if text is None else self.read(text)

    @property
    def _source(self) -> str:
        return f"model:{self.name}"
