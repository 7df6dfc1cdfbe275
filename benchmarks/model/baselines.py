"""What does the latent model of few steps gain, and lose, against simpler and slower ways?

Held-out windows are sampled after the clips' histories with their sentences by: the nearest training window, the model
with 1, 2 and 4 steps, its teacher, which is guided by three evaluations, with 10 and 50 steps, and a diffusion of
frames without a latent (MDM's architecture) that is trained here on the same features, words and manners. The shipped
model was trained for longer than that, so a latent diffusion is trained here as well, for as many steps on the same
windows ("latent, same steps").
TRAINING is a run of `flexmotion train` with features, text, diffusion, distillation and evaluator, or a weights file
whose folder has them; `--set` then gives the data, and a training folder is made in OUT. A training that was stopped
continues when it is started again. Times are of the processor, in samples of the model as it is shipped. It only
measures.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table
from torch import Tensor
from torch.nn.attention import SDPBackend, sdpa_kernel
from torch.utils.flop_counter import FlopCounterMode

from benchmarks.shared.linked_run import linked_run
from benchmarks.shared.options import CsvOption
from benchmarks.shared.outcome import Outcome, write_csv
from benchmarks.shared.raw_diffusion import FrameDenoiser, RawSampler, RawTask
from benchmarks.shared.training_folder import training_folder
from flexmotion.evaluation.interval import Interval
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.text.sentence_encoder import SentenceEncoder
from flexmotion.training.autoencoder_task import load_autoencoder
from flexmotion.training.checkpoints import is_trained, load_weights, training_record
from flexmotion.training.diffusion_task import DiffusionTask
from flexmotion.training.evaluate import Judge
from flexmotion.training.export import Decoder, export, load_networks
from flexmotion.training.processes import Processes, use_threads
from flexmotion.training.run import Run
from flexmotion.training.stage import train_stage

SHOWN = (
    "fid",
    "r_precision_top3",
    "diversity",
    "multimodality",
    "skate_ratio",
    "jerk",
    "residual_force",
    "delivered_residual_force",
    "delivered_zmp_outside",
)
TIMED = 20
"""Samples whose time is measured."""

FEW, TEACHER = (1, 2, 4), (10, 50)
"""Steps of the student and of its teacher."""

FRAMES, LATENT = f"frames, {TEACHER[-1]}", f"latent, same steps, {TEACHER[-1]}"
"""Ways that are trained here."""

ROWS = 3
"""Evaluations a step under guidance: with the request, in any manner, without any."""


@dataclass(frozen=True)
class Cost:
    """Of a sample: parameters of its networks, and multiplications and additions of all steps."""

    parameters: int
    operations: int


def main(
    training: Annotated[Path, typer.Argument(metavar="TRAINING", help="Training run with the data and the judge.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for what is trained and exported here.")],
    data: Annotated[Path | None, typer.Option("--set", help="Training set, where TRAINING is a weights file.")] = None,
    frames: Annotated[bool, typer.Option(help="Also what is trained here, for hours.")] = True,
    steps: Annotated[int, typer.Option(min=1, help="Training steps of what is trained here.")] = 5000,
    windows: Annotated[int, typer.Option(min=64, help="Held-out windows.")] = 256,
    threads: Annotated[int, typer.Option(min=1, help="Of the CPU.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Of windows and samples.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Train the diffusion of frames, and of a latent, where they are not, and measure all of them."""
    use_threads(threads)
    stages = ("autoencoder", "diffusion", "distill", "evaluator")
    run, console = training_folder(training, out / "training", data, stages), Console(width=200)
    network = trained_frames(run, out / "frames", steps) if frames else None
    latent = trained_latent(run, out / "latent", steps) if frames else None
    student, teacher = (export(run, out / name, distilled=name == "student") for name in ("student", "teacher"))
    few = sorted({*FEW, student.manifest.steps})
    samplers: dict[str, Sampler] = {f"student, {count}": Sampler(student, count, unjudged=True) for count in few}
    samplers |= {f"teacher, {count}": Sampler(teacher, count, unjudged=True) for count in TEACHER}
    if latent is not None:
        samplers[LATENT] = Sampler(export(latent, out / "same", distilled=False), TEACHER[-1], unjudged=True)
    if network is not None:
        samplers[FRAMES] = RawSampler(student, network, run, TEACHER[-1])
    judge = Judge(run, student.body, windows, seed)
    figures = {"real": judge.measure(judge.real), "nearest": judge.measure(judge.nearest())}
    for name, sampler in track(samplers.items(), "measures", transient=True):
        figures[name] = judge.measure(judge.sampled(sampler), judge.delivered(sampler))
    costs, times = costs_of(run, network, few), times_of(judge, samplers, f"student, {student.manifest.steps}")
    rows = {name: numbers(found, costs.get(name), times.get(name)) for name, found in figures.items()}
    console.print(table(figures, costs, times))
    console.print(f"teacher: {_trained(run.stage('diffusion'))} on a latent")
    if network is not None and latent is not None:
        console.print(f"diffusion of frames: {_trained(out / 'frames')}")
        console.print(f"diffusion of a latent, trained here: {_trained(latent.stage('diffusion'))}")
    if csv_out is not None:
        write_csv(csv_out, [{"way": name, **dict.fromkeys(_names(rows), ""), **row} for name, row in rows.items()])
    return Outcome((), rows)


def trained_frames(run: Run, folder: Path, steps: int) -> FrameDenoiser:
    """The diffusion of frames, trained where it is not."""
    if not is_trained(folder) or training_record(folder).steps < steps:
        task = RawTask(run, SentenceEncoder(run.stage("text")))
        stage = run.config.stages.diffusion.model_copy(update={"steps": steps})
        train_stage(task, stage, folder, fingerprint=f"{run.fingerprint()} frames")
    config, layout = run.config, run.layout
    network = FrameDenoiser(config.diffusion, config.window, layout, config.window.future * layout.size)
    load_weights(network, folder)
    return network.eval()


def trained_latent(run: Run, folder: Path, steps: int) -> Run:
    """A run of the same autoencoder with a diffusion that was trained anew."""
    parts = ("features", "text", "autoencoder")
    own = linked_run(run, folder, run.config, run.seed, parts)
    stage = own.stage("diffusion")
    if not is_trained(stage) or training_record(stage).steps < steps:
        encode, autoencoder = SentenceEncoder(own.stage("text")), load_autoencoder(own)
        task = DiffusionTask(own.config, own.store(), autoencoder, encode, own.seed, Processes())
        settings = own.config.stages.diffusion.model_copy(update={"steps": steps})
        train_stage(task, settings, stage, fingerprint=f"{own.fingerprint()} anew")
    return own


def costs_of(run: Run, frames: FrameDenoiser | None, few: Sequence[int]) -> dict[str, Cost]:
    """Parameters and operations of a sample, by way; `few`: steps of the student."""
    found = {f"student, {count}": latent_cost(run, count, distilled=True) for count in few}
    found |= {f"teacher, {count}": latent_cost(run, count, distilled=False) for count in TEACHER}
    if frames is None:
        return found
    found[LATENT] = found[f"teacher, {TEACHER[-1]}"]
    size = sum(value.numel() for value in frames.parameters())
    denoising = _operations(lambda: frames(*_inputs(run, ROWS, run.config.window.future * run.layout.size)))
    found[FRAMES] = Cost(size, TEACHER[-1] * denoising)
    return found


def latent_cost(run: Run, steps: int, *, distilled: bool) -> Cost:
    """Of a sample of the latent model."""
    autoencoder, denoiser = load_networks(run, distilled=distilled)
    decoder, rows = Decoder(autoencoder, denoiser), 1 if distilled else ROWS
    history = torch.zeros(1, run.config.window.history, run.layout.size)
    decoding = _operations(lambda: decoder(torch.zeros(1, autoencoder.latent), history))
    inputs = _inputs(run, rows, autoencoder.latent) + ((torch.ones(rows, 2),) if distilled else ())
    denoising = _operations(lambda: denoiser(*inputs))
    size = sum(value.numel() for value in denoiser.parameters()) + _decoding_parameters(decoder)
    return Cost(size, decoding + steps * denoising)


def _inputs(run: Run, rows: int, latent: int) -> tuple[Tensor, ...]:
    text, window = run.config.diffusion.text, run.config.window
    history = torch.zeros(rows, window.history, run.layout.size)
    words = (torch.zeros(rows, text), torch.zeros(rows, 3), torch.zeros(rows, text), torch.ones(rows, 3))
    return (torch.zeros(rows, latent), torch.zeros(rows, dtype=torch.long), history, *words)


def _operations(run: Callable[[], object]) -> int:
    # Other kernels of attention are not counted.
    with torch.no_grad(), sdpa_kernel(SDPBackend.MATH), FlopCounterMode(display=False) as counter:
        run()
    return int(counter.get_total_flops())


def _decoding_parameters(decoder: Decoder) -> int:
    """Parameters that decoding a latent uses: those of the encoder are not."""
    unused = ("read", "encoder", "summary", "distribution", "read_straight")
    named = decoder.autoencoder.named_parameters()
    return sum(value.numel() for name, value in named if name.split(".")[0].split("_place")[0] not in unused)


def times_of(judge: Judge, samplers: dict[str, Sampler], reference: str) -> dict[str, float]:
    """Processor time of a sample by each sampler over that by the reference, by turns: medians of the ratios."""
    spent: dict[str, list[float]] = {name: [] for name in samplers}
    for case in range(TIMED):
        past, condition = judge.past(case), Condition(judge.cases.texts[case])
        for name, sampler in samplers.items():
            begin = time.process_time()
            sampler.sample(past, condition, case)
            spent[name].append(time.process_time() - begin)
    return {name: float(np.median(np.array(own) / np.array(spent[reference]))) for name, own in spent.items()}


def numbers(found: dict[str, Interval], cost: Cost | None, times: float | None) -> dict[str, float]:
    """Figures of one way."""
    row = {name: found[name].mean for name in SHOWN if name in found}
    if cost is not None and times is not None:
        row |= {"parameters_million": cost.parameters / 1e6, "gflop": cost.operations / 1e9, "times": times}
    return row


def table(figures: dict[str, dict[str, Interval]], costs: dict[str, Cost], times: dict[str, float]) -> Table:
    """One way a line."""
    made = Table("way", *SHOWN, "M parameters", "GFLOP", "times")
    for name, found in figures.items():
        cells = [str(found[one]) if one in found else "" for one in SHOWN]
        if name in costs:
            cost = costs[name]
            cells += [f"{cost.parameters / 1e6:.1f}", f"{cost.operations / 1e9:.3g}", f"{times[name]:.3g}"]
        made.add_row(name, *cells)
    return made


def _trained(stage: Path) -> str:
    record = training_record(stage)
    return f"{record.steps} steps of {record.batch} windows"


def _names(rows: dict[str, dict[str, float]]) -> list[str]:
    return list(dict.fromkeys(name for row in rows.values() for name in row))
