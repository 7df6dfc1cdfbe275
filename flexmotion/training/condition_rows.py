"""`ConditionRows`: metrics of a model's delivered motion when more than words is asked of it, condition by condition.

The conditions are those of the paper's table: joints, actuations, ground forces and muscles of held-out clips, asked of
windows after the clips' histories. Every figure is of the motion that a user of `Sampler.sample` gets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.evaluation.interval import Interval
from flexmotion.features.constraint_layout import (
    CENTRES,
    FORCES,
    PLACES,
    TORQUE_LIMITS,
    TORQUES,
    ConstraintLayout,
    window_values,
)
from flexmotion.features.constraints import Constraints
from flexmotion.features.encode import encode
from flexmotion.features.layout import ACTIVATIONS, POINTS
from flexmotion.human.concatenate import concatenate
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.constraint_solver import check
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.training.constraint_draws import DENSE, FEW, MANY, SPARSE
from flexmotion.training.evaluate import Features, Generator, Judge

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]
Draw = Callable[[np.random.Generator, ConstraintLayout, Mask], None]

NONE = "none"
"""The row in which words alone are asked."""

FAR_M, VERY_FAR_M = 0.2, 0.5
"""Distances of `keyframe_error` and of `trajectory_error` (OmniControl, ICLR 2024) [m]."""

CHANGING = 0.01
"""Standard deviation over a window from which on a muscle's activation changes: what is constant has no correlation."""


def _groups(block: str, size: int, count: int) -> Draw:
    """`count` groups of `size` columns of a block, in all frames; all of them where it has fewer."""

    def draw(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
        if block not in layout.blocks:
            raise ValueError(f"the model's motion has no {block}")
        columns = layout.blocks[block]
        groups = (columns.stop - columns.start) // size
        for group in rng.choice(groups, min(count, groups), replace=False):
            first = columns.start + size * int(group)
            mask[:, first : first + size] = True

    return draw


def _force(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    for block in (FORCES, CENTRES):
        mask[:, layout.blocks[block]] = True


def _frames(share: float) -> Draw:
    """Everything, of a share of the frames, of one at least."""

    def draw(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
        mask[rng.choice(len(mask), max(1, round(share * len(mask))), replace=False)] = True
        mask[:, layout.blocks[TORQUE_LIMITS]] = False  # with the torques asked, their limits say nothing

    return draw


CONDITIONS: dict[str, Draw] = {
    "1 muscle": _groups(ACTIVATIONS, 1, FEW),
    "20 muscles": _groups(ACTIVATIONS, 1, MANY),
    "1 joint": _groups(PLACES, 3, FEW),
    f"{min(MANY, len(POINTS))} joints": _groups(PLACES, 3, MANY),
    "1 actuation": _groups(TORQUES, 1, FEW),
    f"{min(MANY, len(JOINTS))} actuations": _groups(TORQUES, 1, MANY),
    "contact force with place": _force,
    "1 % of frames, all": _frames(SPARSE),
    "20 % of frames, all": _frames(DENSE),
}
"""What is asked beside the sentence, by the name of its row. Places of all 16 points stand for those of 20 joints."""


class ConditionRows:
    """Rows of the table for one model.

    Args:
        judge: with the held-out windows and their metrics.
        sampler: of the model, on the judge's human.
        seed: of what is asked.
    """

    def __init__(self, judge: Judge, sampler: Sampler, seed: int = 0) -> None:
        self._judge, self._sampler, self._seed = judge, sampler, seed
        self._layout = ConstraintLayout(judge.layout)
        self._untold: list[Features] = []

    def rows(self, names: Iterable[str]) -> Iterator[tuple[str, dict[str, Interval] | str]]:
        """A row for each name of `CONDITIONS`, after the row `NONE`.

        Yields:
            Name, and metric -> value, or the reason for which the model cannot follow the condition. Metrics beyond
            those of `Judge.measure`, of what was asked, each with `_untold`, the same of windows that were not told:
            `place_cm`, `torque` [N·m/kg], `force` [% of body weight], `activation`, mean errors; `keyframe_error` and
            `trajectory_error`, shares of asked places off by more than `FAR_M` and of windows with one off by more than
            `VERY_FAR_M`; `activation_r`, mean correlation over the frames of a window of every asked muscle that
            changes.
        """
        self._untold = [self._delivered(NONE)(case, case) for case in range(len(self._judge.cases))]
        yield NONE, self._judge.measure(self._delivered(NONE))
        for name in names:
            try:
                bundle = self._sampler.bundle
                check(self.asked(name, 0), bundle, self._sampler.balanced, branch=bundle.has_control)
            except ValueError as error:
                yield name, str(error)
                continue
            yield name, self._row(name)

    def asked(self, name: str, case: int) -> Constraints:
        """What a condition asks of a window: values of the clip itself.

        Raises:
            ValueError: the model's motion has no such values.
        """
        values = window_values(self._judge.real(case, 0).astype(np.float64), self._judge.layout, np)
        none = Constraints.none(self._judge.layout, self._sampler.body, len(values))
        mask = none.mask.copy()
        rng = np.random.default_rng((self._seed, list(CONDITIONS).index(name), case))
        CONDITIONS[name](rng, self._layout, mask)
        return replace(none, values=values, mask=mask)

    def _row(self, name: str) -> dict[str, Interval]:
        made: dict[int, Features] = {}
        deliver = self._delivered(name)

        def generate(case: int, seed: int) -> Features:
            found = deliver(case, seed)
            if seed == case:  # the samples of single metrics; those of multimodality have other seeds
                made.setdefault(case, found)
            return found

        figures = self._judge.measure(generate)
        errors: dict[str, list[float]] = {}
        for case, untold in enumerate(self._untold):
            asked = self.asked(name, case)
            for end, features in (("", made[case]), ("_untold", untold)):
                for metric, value in self._errors(asked, features).items():
                    errors.setdefault(metric + end, []).append(value)
        return {metric: Interval.of(values) for metric, values in errors.items()} | figures

    def _delivered(self, name: str) -> Generator:
        """Features of samples as they leave the sampler."""
        judge, sampler = self._judge, self._sampler

        def generate(case: int, seed: int) -> Features:
            past = judge.past(case)
            constraints = None if name == NONE else self.asked(name, case)
            window = sampler.sample(past, Condition(judge.cases.texts[case], constraints=constraints), seed)
            whole = concatenate([past, window])
            return encode(whole, judge.layout, whole.pressure_centres)[-len(window) :]

        return generate

    def _errors(self, asked: Constraints, features: Features) -> dict[str, float]:
        """How far a window is from what was asked of it."""
        found = window_values(features.astype(np.float64), self._judge.layout, np)
        away, blocks, leg = found - asked.values, self._layout.blocks, self._sampler.body.leg

        def of(block: str, size: int) -> Float:
            columns = blocks[block]
            groups: Float = away[:, columns].reshape(len(away), -1, size)
            chosen = asked.mask[:, columns].reshape(len(away), -1, size).all(axis=-1)
            return np.asarray(np.linalg.norm(groups[chosen], axis=-1))

        made: dict[str, float] = {}
        if len(places := leg * of(PLACES, 3)):
            made["place_cm"] = 100 * float(places.mean())
            made["keyframe_error"] = float(np.mean(places > FAR_M))
            made["trajectory_error"] = float(np.any(places > VERY_FAR_M))
        if len(torques := of(TORQUES, 1)):
            made["torque"] = GRAVITY * leg * float(torques.mean())
        if len(forces := of(FORCES, 3)):
            made["force"] = 100 * float(forces.mean())
        if ACTIVATIONS in blocks and len(activations := of(ACTIVATIONS, 1)):
            made["activation"] = float(activations.mean())
            made |= self._correlation(asked, found)
        return made

    def _correlation(self, asked: Constraints, found: Float) -> dict[str, float]:
        columns = self._layout.blocks[ACTIVATIONS]
        whole = asked.mask[:, columns].all(axis=0)
        told, made = asked.values[:, columns][:, whole], found[:, columns][:, whole]
        changing = told.std(axis=0) > CHANGING
        if not changing.any():
            return {}
        told, made = (values[:, changing] - values[:, changing].mean(axis=0) for values in (told, made))
        size = np.linalg.norm(told, axis=0) * np.linalg.norm(made, axis=0)
        return {"activation_r": float(np.mean((told * made).sum(axis=0) / np.maximum(size, 1e-9)))}
