"""Are networks in eight bits faster than in single precision, and how far is their motion off?

Samples of one window on one thread, each from the last one, all ways by turns: milliseconds on the wall clock and of
the processor, the ratio of the latter's median to that in single precision, size of the networks on disk, and the
distance of the motion from that in single precision with the same noise. --training is the training run that the bundle
was exported from; with it the same networks are timed in torch. Peak memory is that of a process of its own that
samples, and of one that runs the live system in lockstep. Fails where the bundle takes more than 12 ms (median) or
20 ms (99th percentile) of the processor, or a process more than 400 MB.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.model.sampler_speed import by_turns, condition_of
from benchmarks.shared.model import open_bundle
from benchmarks.shared.options import BundleArgument, CsvOption, StepsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.bundles.bundle import ARRAYS, DECODER, DENOISER, Bundle, write_bundle
from flexmotion.configs.errors import ConfigError
from flexmotion.features.encode import body_points
from flexmotion.human.kinematics import forward
from flexmotion.sampling.sampler import Sampler

Float = NDArray[np.float64]

NETWORKS = (DENOISER, DECODER)
WAYS: dict[str, tuple[str, ...]] = {
    "single precision": (),
    "int8 denoiser": (DENOISER,),
    "int8 decoder": (DECODER,),
    "int8 both": NETWORKS,
}
"""Which networks are quantised."""

MEDIAN_MS, WORST_MS, MEMORY_MB = 12.0, 20.0, 400.0
COMPARED = 40
"""Windows whose motion is compared with that in single precision."""

_SAMPLE = """
import sys
from flexmotion.bundles.bundle import Bundle
from flexmotion.sampling.sampler import Condition, Sampler
sampler = Sampler(Bundle(sys.argv[1]))
history = sampler.standing()
for number in range(50):
    history = sampler.sample(history, Condition("walk forward"), number)
"""
_LIVE = """
import sys
from flexmotion.streamer.cli import execute
options = ["--clock", "lockstep", "--seconds", "5", "--prompt", "walk forward", "--bundle", sys.argv[1]]
if execute(["dry-run", *options]) == 2:
    sys.exit(2)
"""
_PEAK = """
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


@dataclass(frozen=True)
class Row:
    """One way to run the networks.

    Attributes:
        name: of the way.
        took: of every sample, on the wall clock and of the processor, (N, 2) [ms].
        size_mb: of the networks on disk.
        error_mm: mean distance of the body's points from those in single precision; NaN for single precision itself.
    """

    name: str
    took: Float
    size_mb: float
    error_mm: Float

    @property
    def quantiles(self) -> tuple[float, float, float, float]:
        """Median and 99th percentile on the wall clock, then of the processor [ms]."""
        wall, processor = (np.quantile(column, [0.5, 0.99]) for column in self.took.T)
        return float(wall[0]), float(wall[1]), float(processor[0]), float(processor[1])


def quantised(bundle: Bundle, names: Sequence[str], folder: Path) -> Bundle:
    """A copy of a bundle with some of its networks in eight bits."""
    try:
        from flexmotion.training.eight_bits import to_eight_bits
    except ImportError as error:
        raise ConfigError("quantisation needs the extra 'train': in a clone, pip install '.[train]'") from error
    shutil.copytree(bundle.folder, folder)
    for name in names:
        to_eight_bits(folder / name)
    with np.load(bundle.folder / ARRAYS) as arrays:
        return write_bundle(folder, bundle.manifest.model_copy(update={"eight_bits": True}), dict(arrays))


def size_mb(bundle: Bundle) -> float:
    """Size of the networks on disk [MB]."""
    return sum((bundle.folder / network).stat().st_size for network in NETWORKS) / 1e6


def distances(sampler: Sampler, reference: Sampler) -> Float:
    """Mean distance of the body's points from a reference's after the same history and noise, by window, (N,) [mm]."""
    history, found = reference.standing(), []
    for number in range(COMPARED):
        one, two = (way.sample(history, condition_of(number), number) for way in (sampler, reference))
        apart = body_points(forward(one)) - body_points(forward(two))
        found.append(1e3 * np.linalg.norm(apart, axis=-1).mean())
        history = two
    return np.array(found)


def torch_times(bundle: Bundle, training: Path, steps: int, repeats: int) -> dict[str, Float]:
    """Milliseconds of denoising and decoding alone, in torch and in onnxruntime by turns, (N,) each."""
    import torch

    from flexmotion.onnx_session import open_session
    from flexmotion.training.export import Decoder, load_networks
    from flexmotion.training.run import Run

    torch.set_num_threads(1)
    manifest = bundle.manifest
    autoencoder, denoiser = load_networks(Run(training), distilled=manifest.guided)
    decoder = Decoder(autoencoder, denoiser).eval()
    conditions, rng = 3 if manifest.manner else 2, np.random.default_rng(0)
    rows, width = 1 if manifest.guided else conditions, bundle.prompts.embeddings.shape[1]
    inputs = {
        "noisy": rng.standard_normal((rows, manifest.latent), np.float32),
        "time": np.full(rows, manifest.times // 2),
        "history": rng.standard_normal((rows, manifest.history, bundle.layout.size), np.float32),
        "sentence": rng.standard_normal((rows, width), np.float32),
        "velocity": np.zeros((rows, 3), np.float32),
    }
    if manifest.manner:
        inputs["manner"] = rng.standard_normal((rows, width), np.float32)
    inputs["present"] = np.ones((rows, conditions), np.float32)
    if manifest.guided:
        inputs["guidance"] = np.full((rows, 2) if manifest.manner else rows, manifest.guidance, np.float32)
    tensors = [torch.from_numpy(value) for value in inputs.values()]
    sessions = [open_session(bundle.folder / name) for name in NETWORKS]

    def by_torch() -> np.ndarray:
        with torch.inference_mode():
            for _ in range(steps):
                clean = denoiser(*tensors)
            frames: np.ndarray = decoder(clean[:1], tensors[2][:1]).numpy()
            return frames

    def by_onnx() -> np.ndarray:
        for _ in range(steps):
            (clean,) = sessions[0].run(None, inputs)
        (frames,) = sessions[1].run(None, {"latent": clean[:1], "history": inputs["history"][:1]})
        return np.asarray(frames)

    if not np.allclose(by_torch(), by_onnx(), atol=1e-2):
        raise ConfigError(f"{training}: these networks are not the bundle's")
    ways: dict[str, Callable[[], np.ndarray]] = {"torch": by_torch, "onnxruntime": by_onnx}
    took: dict[str, list[float]] = {name: [] for name in ways}
    for number in range(repeats + 5):
        for name, way in ways.items():
            begin = time.perf_counter()
            way()
            if number >= 5:
                took[name].append(1e3 * (time.perf_counter() - begin))
    return {name: np.array(values) for name, values in took.items()}


def peak_mb(program: str, bundle: Path) -> float:
    """Peak memory of a Python process that runs a program [MB].

    Raises:
        ConfigError: the program failed.
    """
    command = [sys.executable, "-c", program + _PEAK, str(bundle)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ConfigError(done.stderr.strip().splitlines()[-1])
    return int(done.stdout.split()[-1]) / 1024


def table(rows: Sequence[Row]) -> Table:
    """One row a way."""
    out = Table(title="One window, one thread")
    times = ("p50 ms", "p99 ms", "cpu p50", "cpu p99", "ratio")
    for name in ("networks", *times, "MB", "mm from single precision, median (p95)"):
        out.add_column(name, justify="left" if name == "networks" else "right")
    for own in rows:
        figures = [f"{value:.2f}" for value in (*own.quantiles, rows[0].quantiles[2] / own.quantiles[2])]
        error = f"{np.median(own.error_mm):.2f} ({np.quantile(own.error_mm, 0.95):.2f})"
        out.add_row(own.name, *figures, f"{own.size_mb:.1f}", error)
    return out


def main(
    bundle: BundleArgument = None,
    training: Annotated[Path | None, typer.Option(help="Training run of the bundle, to time torch.")] = None,
    repeats: Annotated[int, typer.Option(min=20, help="Samples of each way.")] = 300,
    steps: StepsOption = None,
    csv_out: CsvOption = None,
) -> Outcome:
    """Measure single precision, eight bits and torch."""
    opened, console = open_bundle(bundle), Console(width=160)
    peaks = {"sampler": peak_mb(_SAMPLE, opened.folder), "live system in lockstep": peak_mb(_LIVE, opened.folder)}
    reference = Sampler(opened, steps)
    with tempfile.TemporaryDirectory() as work:
        bundles = [
            quantised(opened, networks, Path(work) / str(place)) if networks else opened
            for place, networks in enumerate(WAYS.values())
        ]
        samplers = [Sampler(copy, steps) for copy in bundles]
        rows = [
            Row(name, took, size_mb(copy), distances(sampler, reference))
            for name, took, copy, sampler in zip(WAYS, by_turns(samplers, repeats), bundles, samplers, strict=True)
        ]
    console.print(table(rows))
    if training is not None:
        took = torch_times(opened, training, reference.steps, repeats)
        medians = {name: float(np.median(values)) for name, values in took.items()}
        ratio = medians["torch"] / medians["onnxruntime"]
        figures = ", ".join(f"{name} {value:.2f} ms" for name, value in medians.items())
        console.print(f"networks alone, {reference.steps} steps: {figures}, ratio {ratio:.2f}")
    if csv_out is not None:
        names = ("p50_ms", "p99_ms", "cpu_p50_ms", "cpu_p99_ms")
        write_csv(csv_out, [{"networks": own.name, **dict(zip(names, own.quantiles, strict=True))} for own in rows])
    _, _, median, worst = rows[0].quantiles
    verdicts = [
        Verdict(f"processor time of a sample, median: {median:.1f} ms (<= {MEDIAN_MS:g})", median <= MEDIAN_MS),
        Verdict(f"processor time of a sample, 99th percentile: {worst:.1f} ms (<= {WORST_MS:g})", worst <= WORST_MS),
        *(
            Verdict(f"peak memory, {name}: {value:.0f} MB (<= {MEMORY_MB:g})", value <= MEMORY_MB)
            for name, value in peaks.items()
        ),
    ]
    return Outcome(verdicts, {own.name: figures_of(own) for own in rows} | {"peak_mb": peaks})


def figures_of(own: Row) -> dict[str, float]:
    """Figures of a way."""
    names = ("p50_ms", "p99_ms", "cpu_p50_ms", "cpu_p99_ms")
    error = float(np.median(own.error_mm))
    return dict(zip(names, own.quantiles, strict=True)) | {"size_mb": own.size_mb, "error_mm": error}
