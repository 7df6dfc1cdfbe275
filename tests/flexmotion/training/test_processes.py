"""A training over two processes against the same training in one."""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from shutil import copytree

import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.streamer.cli import execute  # noqa: E402
from flexmotion.training.checkpoints import BEST, digest, load_weights  # noqa: E402
from flexmotion.training.processes import Losses, Processes  # noqa: E402
from flexmotion.training.run import Run  # noqa: E402
from flexmotion.training.stage import HISTORY, Task  # noqa: E402

PROGRAM = Path(__file__).with_name("one_of_two.py")
STAGES = ("autoencoder", "forces", "diffusion", "distill", "personalize", "evaluator")


@pytest.fixture(scope="module")
def two(trained: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that two processes wrote into, which exchange gradients by gloo."""
    out = tmp_path_factory.mktemp("two")
    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command = [*launch, str(PROGRAM), str(trained.folder), str(out)]
    done = subprocess.run(
        command, env=os.environ | {"OMP_NUM_THREADS": "1", "CUDA_VISIBLE_DEVICES": ""}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return out


def joined(task: Task, processes: Processes) -> Losses:
    """Losses of the batches of both ranks in one process."""

    def losses(step: int) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        found = []
        for processes.rank in range(2):
            found.append(task.losses(step)[0])
        return (found[0] + found[1]) / 2, {}

    return losses


@pytest.fixture(scope="module")
def expected(trained: Run) -> dict[str, dict[str, torch.Tensor]]:
    """Gradients of every stage, of one process with the joined batch."""
    program, processes = runpy.run_path(str(PROGRAM)), Processes()
    tasks: dict[str, Task] = program["all_tasks"](trained, processes)
    return {name: program["gradients"](task, joined(task, processes)) for name, task in tasks.items()}


@pytest.mark.parametrize("stage", STAGES)
def test_two_processes_have_the_gradient_of_one_with_the_joined_batch(
    stage: str, two: Path, expected: dict[str, dict[str, torch.Tensor]]
) -> None:
    ranks = [torch.load(two / f"rank{rank}.pt")["gradients"][stage] for rank in range(2)]
    assert set(ranks[0]) == set(ranks[1]) == set(expected[stage])
    scale = max(float(value.abs().max()) for value in expected[stage].values())
    assert scale > 0
    for name, value in expected[stage].items():
        assert torch.equal(ranks[0][name], ranks[1][name])
        torch.testing.assert_close(ranks[0][name], value, rtol=1e-4, atol=1e-5 * scale)


def test_both_end_with_the_same_weights_and_the_first_writes_them(trained: Run, two: Path) -> None:
    first, second = (torch.load(two / f"rank{rank}.pt")["weights"] for rank in range(2))
    assert first == second
    assert torch.load(two / "stage" / BEST)["processes"] == 2
    rows = [json.loads(line) for line in (two / "stage" / HISTORY).read_text().splitlines()]
    assert [row["step"] for row in rows] == [3, 6]
    program = runpy.run_path(str(PROGRAM))
    task = program["all_tasks"](trained, Processes())["autoencoder"]
    before = digest(dict(task.network.named_parameters()))
    load_weights(task.network, two / "stage")
    assert before not in (first, digest(dict(task.network.named_parameters())))


def test_a_command_leaves_the_process_group_at_its_end(trained: Run, tmp_path: Path) -> None:
    """Regression: torch warned of a leak at the exit of every process."""
    run = copytree(trained.folder, tmp_path / "run")
    torch.distributed.init_process_group("gloo", store=torch.distributed.HashStore(), rank=0, world_size=1)
    assert execute(["train", "autoencoder", "-o", str(run), "--steps", "7"]) == 0
    assert not torch.distributed.is_initialized()


@pytest.mark.parametrize(("rank", "prints"), [("0", True), ("1", False)])
def test_only_the_first_process_prints(
    rank: str,
    prints: bool,
    trained: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Regression: two processes wrote two JSON documents one after the other."""
    run = copytree(trained.folder, tmp_path / "run")
    monkeypatch.setenv("RANK", rank)
    assert execute(["train", "autoencoder", "-o", str(run), "--steps", "7", "--json"]) == 0
    printed = capfd.readouterr()
    assert bool(printed.out) == prints and ("step 7" in printed.err) == prints
    assert not prints or json.loads(printed.out)["step"] == 7


@pytest.mark.skipif(not torch.cpu._is_avx512_bf16_supported(), reason="this CPU has no instructions for bfloat16")
def test_bfloat16_on_a_cpu_changes_a_loss_by_less_than_a_hundredth(
    trained: Run, stages, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = stages.diffusion(trained)
    mixed = [float(task.losses(step)[0].detach()) for step in range(4)]
    monkeypatch.setattr(Processes, "mixed_precision", lambda self: nullcontext())
    full = [float(task.losses(step)[0].detach()) for step in range(4)]
    assert mixed == pytest.approx(full, rel=1e-2)
    assert mixed != full
