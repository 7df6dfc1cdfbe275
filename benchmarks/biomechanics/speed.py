"""How many frames per second does the whole pipeline process, and with how much memory?

Import, fit, ground forces, torques and 290 muscles of clips taken evenly from a folder of motion data. Fails below 350
frames/s on two workers. Other work on the machine slows it down.
"""

from __future__ import annotations

import os
import resource
import tempfile
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.shared.clips import data_folder
from benchmarks.shared.outcome import Outcome, Verdict
from benchmarks.shared.processes import ONE_THREAD
from flexmotion.biomechanics.muscle_geometry import muscle_models
from flexmotion.dataset.clips import Clip, find_clips
from flexmotion.dataset.enrich import enrich
from flexmotion.dataset.settings import BuildSettings

TARGET, JUDGED_WORKERS = 350.0, 2


def main(
    folder: Annotated[Path | None, typer.Argument(help="Motion data; default: those beside the project.")] = None,
    clips: Annotated[int, typer.Option(min=1, help="Number of clips.")] = 60,
    workers: Annotated[list[int] | None, typer.Option(min=1, help="Processes; may be given again [1 and 2].")] = None,
) -> Outcome:
    """Process the clips with each number of workers."""
    with tempfile.TemporaryDirectory() as work:
        found = find_clips([folder or data_folder()], Path(work))
        chosen = [found[number * len(found) // clips] for number in range(clips)]
        figures = {f"workers_{count}": measure(chosen, count) for count in workers or (1, 2)}
    verdicts = []
    if judged := figures.get(f"workers_{JUDGED_WORKERS}"):
        rate = judged["frames_per_s"]
        verdicts.append(Verdict(f"{JUDGED_WORKERS} workers: {rate:.0f} frames/s (>= {TARGET:.0f})", rate >= TARGET))
    return Outcome(verdicts, figures)


def measure(clips: list[Clip], workers: int) -> dict[str, float]:
    """Frames per second, without the start of the processes; memory of all of them [GB]."""
    # Spawned children read the environment before they import NumPy.
    os.environ |= ONE_THREAD
    with ProcessPoolExecutor(workers, get_context("spawn"), initializer=warm_up) as pool:
        list(pool.map(wait, [0.2] * 4 * workers))
        start = time.perf_counter()
        results = list(pool.map(process, clips, chunksize=2))
        seconds = time.perf_counter() - start
        memory = sum(pool.map(peak_mb, range(workers))) / 1000
    frames, cpu = sum(frames for frames, _ in results), sum(cpu for _, cpu in results)
    print(
        f"{workers} worker(s): {frames} frames in {seconds:.1f} s: {frames / seconds:.0f} frames/s"
        f" ({frames / cpu:.0f} per second of a core's work); memory about {memory:.2f} GB"
    )
    return {"frames_per_s": frames / seconds, "frames_per_core_s": frames / cpu, "memory_gb": memory}


def warm_up() -> None:
    """Compile the muscle models in a worker."""
    warnings.simplefilter("ignore")
    muscle_models()


def wait(seconds: float) -> None:
    """Keep a worker busy until the others have started."""
    time.sleep(seconds)


def process(clip: Clip) -> tuple[int, float]:
    """Frames of a clip and the processor time that they took [s]."""
    start = time.process_time()
    entries = enrich(clip, BuildSettings())
    return sum(len(entry.arrays.get("joints", ())) for entry in entries), time.process_time() - start


def peak_mb(_: int) -> float:
    """Peak memory of a worker [MB]; it pauses so that each worker answers once."""
    time.sleep(0.1)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
