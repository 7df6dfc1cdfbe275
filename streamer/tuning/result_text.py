"""`markdown`: the result of a campaign as a page of tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from flexmotion.streamer.tuning.figures import MeanFigures, RunFigures
from flexmotion.streamer.tuning.result import BeforeAfter, TuningResult

_MEANS = ("upright", "way share", "heading deg", "arms deg", "trunk deg", "greatest RMS torque / stall")


def markdown(result: TuningResult) -> str:
    """The page, with a final newline."""
    campaign = result.campaign
    parts = [
        f"# Tuned numbers of {campaign.robot}",
        verdict(result),
        f"{result.candidates} candidates in {result.generations} generations, {result.failed} of them could not run; "
        f"seed {campaign.seed}, FlexMotion {campaign.flexmotion}, cma {campaign.cma}.",
        result.objective[0].upper() + result.objective[1:],
        _table(
            ("number", "unit", "before", "after", "bounds"),
            (
                (name, one.unit, f"{one.before:g}", f"{one.after:g}", f"{one.low:g} to {one.high:g}")
                for name, one in result.numbers.items()
            ),
        ),
        "## The list that was tuned on",
        _figures(result.tuning),
    ]
    if result.reporting is not None:
        parts += ["## The reporting list, no clip of which was tuned on", _figures(result.reporting)]
    return "\n\n".join(parts) + "\n"


def verdict(result: TuningResult) -> str:
    """In a line, what the numbers found are worth on motion that was not tuned on."""
    if not result.finished:
        return "Not finished: start the same command again to go on."
    better, other = result.better_elsewhere, result.reporting
    if better is None or other is None:
        return "No candidate costs less than the numbers of the robot file: they are kept."
    costs = f"cost {other.before.cost:.4f} before, {other.after.cost:.4f} after"
    if better:
        return f"Also better on the reporting list: {costs}."
    return f"Not better on the reporting list ({costs}): keep the numbers of the robot file."


def _figures(own: BeforeAfter) -> str:
    means = _table(
        ("", "cost", *_MEANS),
        (
            (name, f"{one.cost:.4f}", *_mean_cells(one.mean))
            for name, one in (("before", own.before), ("after", own.after))
        ),
    )
    runs = _table(
        ("kind", "clip", "", "upright", "way share", "heading deg", "arms deg", "trunk deg"),
        (_run_cells(before, after) for before, after in zip(own.before.runs, own.after.runs, strict=True)),
    )
    return f"{means}\n\nBefore and after, clip by clip:\n\n{runs}"


def _mean_cells(mean: MeanFigures) -> tuple[str, ...]:
    figures = (mean.way_share, mean.heading_deg, mean.arm_deg, mean.trunk_deg, mean.heat)
    return (f"{mean.upright} of {mean.runs}", *(_cell(figure) for figure in figures))


def _run_cells(before: RunFigures, after: RunFigures) -> tuple[str, ...]:
    pairs = (
        (before.way_share, after.way_share),
        (before.heading_deg, after.heading_deg),
        (before.arm_deg, after.arm_deg),
        (before.trunk_deg, after.trunk_deg),
    )
    return (
        before.kind,
        before.clip,
        "perturbed" if before.perturbed else "",
        f"{_yes(before)}, {_yes(after)}",
        *("" if one is None and other is None else f"{_cell(one)}, {_cell(other)}" for one, other in pairs),
    )


def _yes(run: RunFigures) -> str:
    return "yes" if run.upright else "no"


def _cell(figure: float | None) -> str:
    return "-" if figure is None else f"{figure:.3g}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
