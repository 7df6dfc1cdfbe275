"""The objective: upright first, then way, heading, directions, heat."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.streamer.tuning.figures import MeanFigures, RunFigures
from flexmotion.streamer.tuning.objective import cost_of


def run(*, upright: bool = True, **figures: float | None) -> RunFigures:
    own: dict[str, float | None] = {"lasted": 1.0, "way_share": 0.6, "heading_deg": 5.0, "arm_deg": 20.0}
    own |= {"trunk_deg": 4.0, "heat": 0.4} | figures
    return RunFigures.model_validate({"clip": "walk", "kind": "walking", "perturbed": False, "upright": upright, **own})


PERFECT = {"way_share": 1.0, "heading_deg": 0.0, "arm_deg": 0.0, "trunk_deg": 0.0, "heat": 0.0}

some_figures = st.fixed_dictionaries(
    {
        "upright": st.booleans(),
        "lasted": st.floats(0.001, 1.0),
        "way_share": st.none() | st.floats(0.0, 3.0),
        "heading_deg": st.none() | st.floats(0.0, 400.0),
        "arm_deg": st.none() | st.floats(0.0, 180.0),
        "trunk_deg": st.none() | st.floats(0.0, 180.0),
        "heat": st.none() | st.floats(0.0, 2.0),
    }
)


@given(st.lists(st.tuples(some_figures, some_figures), min_size=1, max_size=8))
def test_the_robot_that_stays_upright_more_often_costs_less(pairs) -> None:
    first, second = ([run(**own) for own in side] for side in zip(*pairs, strict=True))
    down = [sum(not one.upright for one in runs) for runs in (first, second)]
    if down[0] < down[1]:
        assert cost_of(first) < cost_of(second)
    assert down[0] <= cost_of(first) <= down[0] + 1.0


@pytest.mark.parametrize(
    "worse",
    [
        {"way_share": 0.5},
        {"way_share": 1.5},
        {"heading_deg": 6.0},
        {"arm_deg": 21.0},
        {"trunk_deg": 5.0},
        {"heat": 0.5},
    ],
)
def test_each_figure_counts(worse: dict[str, float]) -> None:
    assert cost_of([run(**worse)]) > cost_of([run()])


def test_the_parts_count_in_their_order() -> None:
    """Each at its worst, with all others perfect."""
    costs = [
        cost_of([run(**(PERFECT | one))])
        for one in ({"way_share": 0.0}, {"heading_deg": 45.0}, {"arm_deg": 90.0, "trunk_deg": 90.0}, {"heat": 1.0})
    ]
    assert costs == pytest.approx([0.5, 0.25, 0.15, 0.1])
    assert cost_of([run(**PERFECT)]) == 0.0


def test_a_later_fall_costs_less_and_a_run_that_failed_most() -> None:
    late, early = run(upright=False, lasted=0.9), run(upright=False, lasted=0.2)
    assert cost_of([run()]) < cost_of([late]) < cost_of([early])
    assert cost_of([RunFigures.failed("walk", "walking", False, "no swing")]) == 2.0 > cost_of([early])


def test_means_are_those_of_the_upright() -> None:
    mean = MeanFigures.of([run(way_share=0.6), run(way_share=None), run(upright=False, way_share=0.1)])
    assert (mean.runs, mean.upright, mean.way_share, mean.heat) == (3, 2, 0.6, 0.4)
    assert MeanFigures.of([run(upright=False)]).way_share is None
