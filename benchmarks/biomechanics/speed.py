"""Frames per second of the whole pipeline (import, fit, ground forces, torques, 290 muscles), and its memory.

    python benchmarks/biomech_speed.py [FOLDER] [--clips 60] [--workers 1 2]

FOLDER holds motion data; clips are taken evenly from all of it. Exits with 1 below 350 frames/s on two workers.
"""

from __future__ import annotations

import argparse
import os

# Before NumPy is imported, which reads them once.
# ruff: noqa: E402
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

import resource
import sys
import tempfile
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from gait_trial import default_path

from flexmotion.biomechanics.muscle_geometry import muscle_models
from flexmotion.dataset.clips import Clip, find_clips
from flexmotion.dataset.enrich import enrich
from flexmotion.dataset.settings import BuildSettings

TARGET = 350.0
MEMORY_GB = 4.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=default_path().parent)
    parser.add_argument("--clips", type=int, default=60)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        found = find_clips([options.folder], Path(work))
        clips = [found[number * len(found) // options.clips] for number in range(options.clips)]
        rates = {workers: measure(clips, workers) for workers in options.workers}
    load = os.getloadavg()[0]
    print(f"load of the machine at the end: {load:.1f} (other work on it slows these figures)")
    return 0 if rates.get(2, TARGET) >= TARGET else 1


def measure(clips: list[Clip], workers: int) -> float:
    """Frames per second, start of the processes left out."""
    with ProcessPoolExecutor(workers, initializer=warm_up) as pool:
        list(pool.map(wait, [0.2] * 4 * workers))
        start = time.perf_counter()
        results = list(pool.map(one, clips, chunksize=2))
        seconds = time.perf_counter() - start
        memory = sum(pool.map(peak_mb, range(workers))) / 1000
    frames = sum(frames for frames, _ in results)
    cpu = sum(cpu for _, cpu in results)
    print(
        f"{workers} worker(s): {frames} frames in {seconds:.1f} s: {frames / seconds:.0f} frames/s"
        f" ({frames / cpu:.0f} per second of a core's work); memory about {memory:.2f} of {MEMORY_GB:g} GB"
    )
    return frames / seconds


def warm_up() -> None:
    warnings.simplefilter("ignore")
    muscle_models()


def wait(seconds: float) -> None:
    time.sleep(seconds)


def one(clip: Clip) -> tuple[int, float]:
    start = time.process_time()
    entries = enrich(clip, BuildSettings())
    return sum(len(entry.arrays.get("joints", ())) for entry in entries), time.process_time() - start


def peak_mb(_: int) -> float:
    time.sleep(0.1)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000


if __name__ == "__main__":
    sys.exit(main())
