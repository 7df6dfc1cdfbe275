"""`Requests`: what a condition means to a model, and how it is written into the inputs of its network."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import hypot

import numpy as np
from numpy.typing import NDArray

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.repertoire import offered_kinds, offered_manners
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.repertoire import RobotRepertoire
from flexmotion.features.heading_frame import chord
from flexmotion.sampling.beside import fits_beside
from flexmotion.sampling.condition import Condition
from flexmotion.sampling.idle_joints import idle_joints
from flexmotion.sampling.made_gestures import sinks
from flexmotion.sampling.rhythm import rhythm_kinds
from flexmotion.text import phrases
from flexmotion.text.manners import NORMAL
from flexmotion.text.phrases import BACK, STAND, TURNS, WALK
from flexmotion.text.prompt_reader import Prompt, PromptReader

Float32 = NDArray[np.float32]

STILL = 0.05
"""A velocity without words whose components are all smaller than this means standing still [m/s, rad/s]."""

RUN_FROM = 2.0
"""Humans change between walking and running at about this speed [m/s]."""

SPOT = 0.25
"""A turn at a lower speed than this is a turn on the spot [m/s]."""

BACK_FROM = 0.02
"""The words of walking backward are used from this backward speed on [m/s]. With those of walking a human that was to
go back at .05 to .1 m/s went ahead by .6 m first, and its robot by .15."""


def is_still(velocity: tuple[float, float, float]) -> bool:
    """Whether a velocity without words means standing still."""
    return bool(np.abs(velocity).max() < STILL)


class Requests:
    """Reads the words of conditions and says them to the network of one bundle.

    Args:
        bundle: of the model.
        unjudged: whether to offer what the bundle knows and was not judged to do.
        robot: what the robot that follows was judged to do; None: all.
    """

    def __init__(self, bundle: Bundle, unjudged: bool = False, robot: RobotRepertoire | None = None) -> None:
        manifest, prompts = bundle.manifest, bundle.prompts
        self._bundle, self._manifest, self._corrections = bundle, manifest, manifest.corrections
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
            robot,
        )
        self._rhythms = rhythm_kinds()
        self._walking, self._backing = self.reader.meaning(WALK), self.reader.meaning(BACK)
        self._turning = tuple(self.reader.meaning(kind) for kind in TURNS)
        self.read = lru_cache(maxsize=64)(self.reader)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of motion that the bundle, and the robot, offer."""
        return self.reader.offered

    def prompt(self, text: str | None) -> Prompt:
        """Meaning of a text; standing still for None."""
        return self.reader.idle if text is None else self.read(text)

    def meant(self, condition: Condition) -> Condition:
        """The condition with words replaced by the velocity that they mean, where they mean one, within its pace.

        Words of a rhythm mean standing.
        """
        if self.rhythm(condition) is not None:
            condition = replace(condition, text=None)
        if not self._manifest.velocity or condition.wordless:
            return condition
        if condition.text is not None and condition.manner is None:
            said = self.prompt(condition.text).manner
            condition = condition if said == NORMAL else replace(condition, manner=said)
        if condition.velocity is None:
            kind = self.prompt(condition.text).kind
            meant, speed = phrases.velocity(kind), self._corrections.speed(kind, self.manner(condition))
            if meant is not None:
                return self._slowed(replace(condition, text=None, velocity=meant))
            slowed = None if speed is None else self._slowed(replace(condition, velocity=speed))
            # Within its pace a motion follows its words alone.
            if speed is None or slowed is None or slowed.velocity == speed:
                return condition
            assert slowed.velocity is not None
            walks = hypot(*speed[:2]) >= RUN_FROM > hypot(*slowed.velocity[:2])
            # Words of running, and of turning, pull the body to their own speed: half as fast again in a turn.
            return replace(slowed, text=None) if walks or speed[2] else slowed
        still = condition.text is None and is_still(condition.velocity)
        return replace(condition, velocity=None) if still else self._slowed(condition)

    @property
    def travelling_noise(self) -> float:
        """Most noise of windows that travel, relative to others."""
        return self._corrections.travelling_noise

    def rhythm(self, condition: Condition) -> str | None:
        """The kind of a condition's words where that is a rhythm, which is not the model's; else None."""
        if condition.wordless or condition.text is None or condition.velocity is not None:
            return None
        kind = self.prompt(condition.text).kind
        return kind if kind in self._rhythms else None

    def pose(self, condition: Condition) -> str | None:
        """The kind of a condition of `meant` where that is a pose, else None."""
        kind = self._said(condition)
        return kind if kind is not None and phrases.is_pose(kind) else None

    def _said(self, condition: Condition) -> str | None:
        """The kind of a condition of `meant` that asks by words alone, else None."""
        return None if condition.velocity is not None or condition.wordless else self.prompt(condition.text).kind

    def held(self, condition: Condition) -> Condition:
        """A condition of `meant` whose pose is reached, as it is held; any other motion as it is."""
        if self.pose(condition) is None:
            return condition
        return replace(condition, noise=min(condition.noise, self._corrections.pose_noise), held=True)

    def is_slow(self, condition: Condition) -> bool:
        """Whether a condition of `meant` is held, or sinks and rises by a recipe: nothing of it is faster than 1 Hz."""
        kind = self._said(condition)
        return condition.held or kind is not None and sinks(kind)

    def is_brief(self, condition: Condition) -> bool:
        """Whether a condition of `meant` is a pose that people leave as soon as it is reached."""
        kind = self.pose(condition)
        return kind is not None and phrases.is_brief(kind)

    def own_velocity(self, condition: Condition) -> tuple[float, float, float] | None:
        """Velocity at which a condition of `meant` is done; None where its words are of an unknown speed."""
        if condition.velocity is not None:
            return condition.velocity
        kind = self.prompt(condition.text).kind
        return (0.0, 0.0, 0.0) if kind == STAND else self._corrections.speed(kind, self.manner(condition))

    def noise(self, condition: Condition) -> float:
        """Scale of the noise that a window of a condition of `meant` begins from."""
        if self.stands(condition):
            return condition.noise * self._corrections.standing_noise
        if condition.velocity is None:
            return condition.noise
        spot, travelling = self._corrections.spot_noise, self._corrections.travelling_noise
        return min(condition.noise, spot if self._turns_on_the_spot(condition) else travelling)

    def guidance(self, condition: Condition) -> tuple[float, float]:
        """Scales of the guidance of a condition of `meant`: of the request, and of its manner."""
        corrections, asked, manner = self._corrections, condition.guidance, condition.manner_guidance
        if asked is None:
            # A velocity alone is led to its places by the course: more guidance makes walks back of one speed.
            spoken = condition.text is not None or condition.velocity is None
            kind = self._words(condition).kind if spoken and not condition.wordless else ""
            asked = corrections.guidance.get(kind, self._manifest.guidance)
        if manner is None and self.manner(condition) == NORMAL:
            manner = corrections.normal_guidance
        return asked, self._manifest.manner_guidance if manner is None else manner

    def stands(self, condition: Condition) -> bool:
        """Whether a condition of `meant` is that of standing still."""
        return self._said(condition) == STAND

    def idle(self, condition: Condition) -> frozenset[int]:
        """Joints above the legs that a condition of `meant` leaves alone."""
        kind = self._said(condition)
        return frozenset() if kind is None else idle_joints(kind)

    def leaves_legs(self, condition: Condition) -> bool:
        """Whether a condition of `meant` is done standing, by arms or head, if by anything."""
        kind = self._said(condition)
        return kind is not None and (kind == STAND or fits_beside(kind, STAND))

    def keeps_feet(self, condition: Condition) -> bool:
        """Whether a condition of `meant` is done on feet that stay where they stand."""
        kind = self._said(condition)
        return kind is not None and (phrases.is_in_place(kind) or self.leaves_legs(condition))

    def travels(self, condition: Condition) -> bool:
        """Whether a condition of `meant` leads away or turns, or may do so.

        Nothing is known of wordless ones without a velocity, and of all words where no speeds were measured.
        """
        velocity = condition.velocity if condition.wordless else self.own_velocity(condition)
        return any(velocity) if velocity is not None else condition.wordless or not self._corrections.speeds

    def hurries(self, condition: Condition) -> bool:
        """Whether a condition of `meant` is done by running, or in another manner than the normal one."""
        velocity = self.own_velocity(condition)
        return self.manner(condition) != NORMAL or velocity is not None and hypot(*velocity[:2]) >= RUN_FROM

    def write(self, condition: Condition, remembered: Float32, inputs: dict[str, np.ndarray]) -> None:
        """Write a condition of `meant` into the inputs of the network; the last of several rows is without it.

        What is not asked is zero: the network multiplies it by its presence, and a NaN of an earlier one would stay.

        Args:
            condition: the request.
            remembered: features of the history, not normalised, (H, F).
            inputs: `sentence`, `velocity`, `manner` and `present`, by rows.

        Raises:
            ConfigError: the model does not know its manner.
        """
        present = inputs["present"]
        for name in ("sentence", "velocity", "present", *(("manner",) if self._manifest.manner else ())):
            inputs[name][:] = 0.0
        velocity = self._velocity(condition, remembered)
        if velocity is not None:
            inputs["velocity"][:] = velocity
            present[0, 1] = 1.0
        if condition.wordless:
            return
        inputs["sentence"][:] = self._words(condition).embedding
        present[0, 0] = 1.0
        if self._manifest.manner:
            present[1:-1] = present[0]  # without guidance as an input: the request in any manner
            manner = self._manner(condition)
            if manner is not None:
                inputs["manner"][:] = manner
                present[0, 2] = 1.0

    def _velocity(self, condition: Condition, remembered: Float32) -> tuple[float, float, float] | None:
        """What the network is asked for: forward, left [leg/s], turning [rad/s]; None for no velocity."""
        if not self._manifest.velocity:
            return None
        if condition.wordless:
            asked = condition.velocity
        elif condition.velocity is None:
            asked = condition.asked
        else:
            asked = self._corrected(condition.velocity, condition.asked or condition.velocity, remembered)
        if asked is None:
            return None
        # The network was trained on the displacement of a window in its first heading, which is a chord of the arc.
        forward, left = chord(*asked, seconds=self._manifest.future / self._manifest.fps)
        leg = self._bundle.body.leg
        return forward / leg, left / leg, asked[2]

    def _corrected(
        self, wanted: tuple[float, float, float], asked: tuple[float, float, float], remembered: Float32
    ) -> tuple[float, float, float]:
        """What has to be asked for, so that the motion has the wanted velocity, or keeps its course by `asked`."""
        corrections, (ahead, aside, turning) = self._corrections, asked
        more = self._catch_up(wanted, remembered)
        return (
            corrections.asked_ahead(ahead) + more[0] - corrections.ahead_per_aside * abs(aside),
            # Bodies sway sideways in every gait: without a sideways velocity nothing is caught up with.
            corrections.aside * (aside + more[1]) if aside else 0.0,
            corrections.turning * turning + corrections.turning_per_aside * aside,
        )

    def manner(self, condition: Condition) -> str:
        """Manner in which a condition of `meant` is to be done; the normal one where nothing is said."""
        if condition.wordless:
            return NORMAL
        if condition.manner is not None:
            return condition.manner
        return NORMAL if condition.text is None else self.prompt(condition.text).manner

    def _manner(self, condition: Condition) -> Float32 | None:
        """Embedding of the manner of a request; None where the model was trained on no clip of the normal one."""
        name = self.manner(condition)
        if name not in self._manners and name != NORMAL:
            raise ConfigError(
                f"manner {name!r}: model {self._manifest.name} knows {', '.join(self._manners) or 'none'}"
            )
        return self._manners.get(name)

    def words_kind(self, condition: Condition) -> str:
        """The kind of the words that the network is told of a condition of `meant`; a velocity alone has some too."""
        return self._words(condition).kind

    def _words(self, condition: Condition) -> Prompt:
        """The words of the request; of a velocity without words, those of walking, or of turning on the spot."""
        if condition.velocity is None or condition.text is not None:
            return self.prompt(condition.text)
        # Without words the model reaches a velocity in any manner: on its knees, or with its hands in the air.
        forward, left, turning = condition.velocity
        if self._turns_on_the_spot(condition):
            return self._turning[int(turning < 0)]
        return self._backing if forward < -max(abs(left), BACK_FROM) else self._walking

    def _catch_up(self, velocity: tuple[float, float, float], remembered: Float32) -> tuple[float, float]:
        """Forward and left velocity added to the request for what the history lacks [m/s]."""
        if not len(remembered):
            return 0.0, 0.0
        start = self._bundle.layout.blocks["root"].start
        lacks = np.array(velocity[:2]) - self._bundle.body.leg * remembered[:, start : start + 2].mean(axis=0)
        limit = self._corrections.catch_up_limit
        ahead, aside = np.clip(self._corrections.catch_up * lacks, -limit, limit)
        return float(ahead), float(aside)

    @staticmethod
    def _slowed(condition: Condition) -> Condition:
        if condition.pace is None or condition.velocity is None:
            return condition
        return replace(condition, velocity=condition.pace.slowed(condition.velocity))

    @staticmethod
    def _turns_on_the_spot(condition: Condition) -> bool:
        if condition.text is not None or condition.velocity is None:
            return False
        forward, left, turning = condition.velocity
        return hypot(forward, left) < SPOT and abs(turning) >= STILL
