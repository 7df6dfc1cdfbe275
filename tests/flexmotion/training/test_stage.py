"""A stage resumes bit for bit, and averages its weights."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.configs.errors import ConfigError  # noqa: E402
from flexmotion.configs.model import Stage  # noqa: E402
from flexmotion.training.checkpoints import BEST, LAST  # noqa: E402
from flexmotion.training.run import Run  # noqa: E402
from flexmotion.training.stage import Progress, train_stage  # noqa: E402


class Line:
    """A task that is quick to train: a linear map to the origin."""

    def __init__(self) -> None:
        torch.manual_seed(0)
        self.network = torch.nn.Linear(3, 2)
        self.trained: list[torch.Tensor] = []

    def losses(self, step: int) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        self.trained.append(self.network.weight.detach().clone())
        inputs = torch.randn(8, 3, generator=torch.Generator().manual_seed(step))
        loss = self.network(inputs).square().mean()
        return loss, {"square": loss}

    def validate(self) -> dict[str, float]:
        return {"loss": float(self.network.weight.square().sum())}


def stage(steps: int, average: float = 0.999) -> Stage:
    rates = {"learning_rate": 0.01, "warm_up": 2, "cool_down": 0.0, "validate_every": 2}
    return Stage(steps=steps, batch=8, average=average, **rates)


def after(task: Line, steps: int) -> Callable[[], bool]:
    """A stop that is asked for when a task has trained for so many steps."""
    return lambda: len(task.trained) >= steps


def same(first: object, second: object) -> bool:
    """Whether two states are equal, tensors bit for bit."""
    if isinstance(first, torch.Tensor) and isinstance(second, torch.Tensor):
        return torch.equal(first, second)
    if isinstance(first, dict) and isinstance(second, dict):
        return list(first) == list(second) and all(same(first[key], second[key]) for key in first)
    if isinstance(first, list) and isinstance(second, list):
        return len(first) == len(second) and all(map(same, first, second))
    return first == second


def test_a_stopped_training_resumes_bit_for_bit(trained: Run, stages, tmp_path: Path) -> None:
    """Weights, moving average and optimiser are those of a training that was not stopped."""

    def state(name: str, steps: list[int]) -> dict[str, object]:
        for count in steps:
            task = stages.autoencoder(trained)
            train_stage(task, stage(count), tmp_path / name, fingerprint="same")
        found: dict[str, object] = torch.load(tmp_path / name / LAST, weights_only=True)
        return found

    whole, parts = state("whole", [5]), state("parts", [2, 5])
    for name in ("network", "average", "optimiser", "step"):
        assert same(whole[name], parts[name]), name


def test_a_stop_saves_at_once_and_is_resumed(tmp_path: Path) -> None:
    """Ctrl-C kept nothing of the last minutes: an interrupted training was as old as its last save."""

    def state(name: str, stops: list[int]) -> dict[str, object]:
        for last in stops:
            task = Line()
            train_stage(task, stage(8), tmp_path / name, fingerprint="", stop=after(task, last))
        found: dict[str, object] = torch.load(tmp_path / name / LAST, weights_only=True)
        return found

    assert state("parts", [1])["step"] == 1 and not (tmp_path / "parts" / BEST).exists()  # nothing was validated
    whole, parts = state("whole", [99]), state("parts", [4, 99])
    assert parts["step"] == 8
    for name in ("network", "average", "optimiser", "least"):
        assert same(whole[name], parts[name]), name


def test_a_stop_in_the_last_step_ends_the_training(tmp_path: Path) -> None:
    task = Line()
    train_stage(task, stage(3), tmp_path, fingerprint="", stop=after(task, 3))
    assert (tmp_path / BEST).is_file()


def test_a_training_killed_while_it_saves_resumes_from_the_save_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    train_stage(Line(), stage(3), tmp_path, fingerprint="")
    whole = torch.save

    def cut(content: object, path: Path) -> None:
        whole(content, path)
        path.write_bytes(path.read_bytes()[:100])
        raise KeyboardInterrupt

    monkeypatch.setattr(torch, "save", cut)
    with pytest.raises(KeyboardInterrupt):
        train_stage(Line(), stage(5), tmp_path, fingerprint="", save_every=0.0)
    monkeypatch.undo()
    steps: list[int] = []
    train_stage(Line(), stage(5), tmp_path, fingerprint="", progress=lambda at: steps.append(at.step))
    assert steps == [4, 5]


def test_the_best_weights_are_the_moving_average(tmp_path: Path) -> None:
    """Of the weights of all steps, recent ones more; the first steps are forgotten sooner than the configured decay."""
    task = Line()
    train_stage(task, stage(4, average=0.2), tmp_path, fingerprint="")
    weights = [*task.trained[1:], task.network.weight.detach()]
    expected = weights[0]
    for seen, weight in enumerate(weights[1:], 1):
        keep = min(0.2, (1 + seen) / (10 + seen))
        expected = keep * expected + (1 - keep) * weight
    torch.testing.assert_close(torch.load(tmp_path / BEST)["network"]["weight"], expected)


def test_time_over_ends_a_stage_with_weights(tmp_path: Path) -> None:
    done: Progress = train_stage(Line(), stage(10**6), tmp_path, fingerprint="", seconds=0.05)
    assert 0 < done.step < 10**6 and (tmp_path / BEST).is_file()
    assert torch.load(tmp_path / LAST)["step"] == done.step


def test_no_time_at_all_leaves_a_stage_to_resume(tmp_path: Path) -> None:
    """Regression: `--minutes 0` ended in a traceback, since there were no best weights."""
    done = train_stage(Line(), stage(2), tmp_path, fingerprint="", seconds=0.0)
    assert done.step == 0 and not done.figures and not (tmp_path / BEST).exists()
    assert train_stage(Line(), stage(2), tmp_path, fingerprint="").step == 2


def test_other_settings_in_the_same_folder_are_refused(trained: Run, paper_config: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="other settings"):
        Run(trained.folder, str(paper_config))
    with pytest.raises(ConfigError, match="name a configuration"):
        Run(tmp_path / "new")
    train_stage(Line(), stage(1), tmp_path / "line", fingerprint="")
    with pytest.raises(ConfigError, match="other settings"):
        train_stage(Line(), stage(1), tmp_path / "line", fingerprint="other")


def test_history_of_a_stage_is_json(trained: Run) -> None:
    rows = [json.loads(line) for line in (trained.stage("diffusion") / "history.jsonl").read_text().splitlines()]
    assert [row["step"] for row in rows] == [3, 6]
    assert rows[-1]["validation"]["loss"] > 0
