"""How long does a sample of one window take on one thread?

Prints milliseconds per sample, on the wall clock and of the processor alone (which other processes hardly change), for
several numbers of diffusion steps, over the processor time with the first bundle's own number; for that number also
those of windows that a robot follows, which are not balanced (docs/model.md); and the peak memory of this process.
--diffusion adds a bundle that is not distilled.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from benchmarks.shared.model import open_bundle
from benchmarks.shared.options import BundleArgument
from benchmarks.shared.outcome import Outcome
from flexmotion.sampling.sampler import Condition, Sampler

Float = NDArray[np.float64]

PROMPTS = ("walk forward", "wave with the right hand", "turn left", "stand still")
WARM_UP = 5
"""Samples that do not count."""
STEPS = (1, 2, 4)


def condition_of(number: int) -> Condition:
    """Condition of the sample of a number: each prompt for ten samples in turn."""
    return Condition(PROMPTS[number // 10 % len(PROMPTS)])


def measure(sampler: Sampler, repeats: int) -> Float:
    """Milliseconds of every sample, each from the last one: wall clock, processor, (N, 2)."""
    return by_turns([sampler], repeats)[0]


def by_turns(samplers: Sequence[Sampler], repeats: int) -> list[Float]:
    """`measure` of several samplers that take turns, so that what else the machine does slows all of them.

    One thread for linear algebra outside the networks too, as in the planner (`drivers/realtime/priority.py`): a second
    BLAS thread spins while it waits, and counts as processor time.
    """
    histories = [sampler.standing() for sampler in samplers]
    took: list[list[tuple[float, float]]] = [[] for _ in samplers]
    with threadpool_limits(limits=1, user_api="blas"):
        for number in range(repeats + WARM_UP):
            for place, sampler in enumerate(samplers):
                begin = time.perf_counter(), time.process_time()
                histories[place] = sampler.sample(histories[place], condition_of(number), number)
                took[place].append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
    return [1e3 * np.array(own[WARM_UP:]) for own in took]


def main(
    bundle: BundleArgument = None,
    diffusion: Annotated[Path | None, typer.Option(help="Bundle of the model before distillation.")] = None,
    repeats: Annotated[int, typer.Option(min=20, help="Samples of each number of steps, fewer of many.")] = 200,
) -> Outcome:
    """Measure each bundle with several numbers of steps."""
    table = Table(title="One window, one thread")
    for name in ("bundle", "steps", "p50 ms", "p99 ms", "cpu p50", "cpu p99", "ratio"):
        table.add_column(name, justify="left" if name == "bundle" else "right")
    own, figures = 0.0, {}
    first, *others = [open_bundle(bundle), *([] if diffusion is None else [open_bundle(diffusion)])]
    for opened in (first, *others):
        # The bundle's own number first: all others are compared with it.
        usual = opened.manifest.steps
        rows = [(steps, True) for steps in dict.fromkeys((usual, *STEPS))]
        for steps, balanced in (*rows, (usual, False)):
            took = measure(Sampler(opened, steps, balanced=balanced), max(20, repeats // (1 + steps // 10)))
            wall, processor = (np.quantile(column, (0.5, 0.99)) for column in took.T)
            own = own or float(processor[0])
            cells = [f"{value:.2f}" for value in (*wall, *processor, processor[0] / own)]
            table.add_row(opened.folder.name, f"{steps}{'' if balanced else ', for a robot'}", *cells)
            names = ("p50_ms", "p99_ms", "cpu_p50_ms", "cpu_p99_ms")
            label = f"{opened.folder.name}, {steps} {'step' if steps == 1 else 'steps'}"
            label += "" if balanced else ", not balanced"
            figures[label] = dict(zip(names, map(float, (*wall, *processor)), strict=True))
    Console(width=120).print(table)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak memory {peak:.0f} MB")
    return Outcome(figures=figures | {"peak_mb": peak})
