"""Engines that compute the parts: this process, processes on all cores, or a Ray cluster."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed

from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.clips import Clip
from flexmotion.dataset.parts import compute
from flexmotion.dataset.settings import BuildSettings
from flexmotion.worker_process import begin_worker, limit_threads

Result = tuple[int, bytes]
"""Index of a clip in the request, and its part."""

Engine = Callable[[Sequence[Clip], BuildSettings, int], Iterator[Result]]


def here(clips: Sequence[Clip], settings: BuildSettings, workers: int) -> Iterator[Result]:
    """Compute in this process, one after the other."""
    for number, clip in enumerate(clips):
        yield number, compute(clip, settings)


def processes(clips: Sequence[Clip], settings: BuildSettings, workers: int) -> Iterator[Result]:
    """Compute on the cores of this machine; yields parts as they finish."""
    if workers <= 1:
        yield from here(clips, settings, workers)
        return
    limit_threads()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=begin_worker) as pool:
        futures = {pool.submit(compute, clip, settings): number for number, clip in enumerate(clips)}
        try:
            for future in as_completed(futures):
                yield futures.pop(future), future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def ray(clips: Sequence[Clip], settings: BuildSettings, workers: int) -> Iterator[Result]:
    """Compute on a Ray cluster (`RAY_ADDRESS`), or a local one of so many workers.

    Every worker reads the clips from the same paths (a shared folder); Ray returns the parts.

    Raises:
        ConfigError: Ray is not installed.
    """
    try:
        import ray as cluster
    except ImportError as error:
        raise ConfigError("--engine ray needs the extra 'ray': in a clone, pip install '.[ray]'") from error
    started = not cluster.is_initialized()
    if started:
        local = None if os.environ.get("RAY_ADDRESS") else workers
        cluster.init(num_cpus=local, include_dashboard=False, log_to_driver=False)
    try:
        remote = cluster.remote(num_cpus=1)(compute)
        shared = cluster.put(settings)
        pending = {remote.remote(clip, shared): number for number, clip in enumerate(clips)}
        while pending:
            (ready, *_), _ = cluster.wait(list(pending), num_returns=1)
            yield pending.pop(ready), cluster.get(ready)
    finally:
        if started:
            cluster.shutdown()


ENGINES: dict[str, Engine] = {"process": processes, "ray": ray}
