"""What a sample costs: one window from history and text on one thread, few steps against fifty.

    python benchmarks/sampler_speed.py BUNDLE [--diffusion BUNDLE] [--repeats 200]

Prints milliseconds per sample, on the wall clock and of the processor alone (which a busy machine does not change
much), against the first bundle's own number of steps, and this process's peak memory.
"""

from __future__ import annotations

import argparse
import resource
import time
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from flexmotion.bundles.bundle import Bundle
from flexmotion.sampling.sampler import Condition, Sampler

PROMPTS = ("walk forward", "wave with the right hand", "turn left", "stand still")


def measure(sampler: Sampler, repeats: int) -> np.ndarray:
    """Milliseconds of every sample, each on from the last: wall clock, processor, (N, 2).

    On one thread, linear algebra outside the networks too, as in the planner (`drivers/realtime/priority.py`): a second
    thread of BLAS spins while it waits, and counts as processor time.
    """
    history = sampler.standing()
    took = []
    with threadpool_limits(limits=1, user_api="blas"):
        for number in range(repeats + 5):
            condition = Condition(PROMPTS[number // 10 % len(PROMPTS)])
            begin = time.perf_counter(), time.process_time()
            history = sampler.sample(history, condition, number)
            took.append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
    return 1e3 * np.array(took[5:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bundle", type=Path)
    parser.add_argument("--diffusion", type=Path)
    parser.add_argument("--repeats", type=int, default=200)
    arguments = parser.parse_args()
    print(f"{'bundle':24} {'steps':>5} {'p50 ms':>8} {'p99 ms':>8} {'cpu p50':>8} {'cpu p99':>8} {'ratio':>6}")
    own = 0.0
    for path in filter(None, (arguments.bundle, arguments.diffusion)):
        bundle = Bundle(path)
        # The bundle's own number first: all else is compared with it.
        for steps in dict.fromkeys((bundle.manifest.steps, 1, 2, 4)):
            took = measure(Sampler(bundle, steps), max(20, arguments.repeats // (1 + steps // 10)))
            figures = [np.quantile(column, share) for column in took.T for share in (0.5, 0.99)]
            own = own or figures[2]
            times = " ".join(f"{value:8.2f}" for value in figures)
            print(f"{path.name:24} {steps:5d} {times} {figures[2] / own:6.2f}", flush=True)
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
