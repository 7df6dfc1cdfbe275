"""Curves of a training: what was resumed counts once, damaged histories are refused by line."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib.image
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.cli import execute
from flexmotion.streamer.plots.training_curves import least, plot_training, read_curve


def history(folder: Path, *losses: tuple[int, float]) -> Path:
    """A stage's history with these losses by step."""
    folder.mkdir(parents=True)
    rows = [{"step": step, "losses": {}, "validation": {"loss": loss, "latent": loss / 2}} for step, loss in losses]
    path = folder / "history.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    return path


def test_a_step_that_was_repeated_after_a_stop_counts_once_by_its_later_validation(tmp_path: Path) -> None:
    curve = read_curve(history(tmp_path / "diffusion", (500, 2.0), (1000, 0.1), (1000, 1.0), (1500, 0.5), (2000, 0.7)))
    assert list(curve) == [500, 1000, 1500, 2000]
    assert curve[1000] == {"loss": 1.0, "latent": 0.5}
    assert least(curve) == 1500


@pytest.mark.parametrize("line", ["{", "[]", '{"step": 3}', '{"step": 3, "validation": {"loss": "much"}}'])
def test_a_damaged_line_is_named(line: str, tmp_path: Path) -> None:
    path = history(tmp_path / "diffusion", (500, 2.0))
    path.write_text(path.read_text() + line + "\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"history\.jsonl:2: not a validation"):
        read_curve(path)


def test_a_picture_has_a_panel_for_each_stage(tmp_path: Path) -> None:
    sizes = []
    for count in (1, 2):
        curves = {
            f"stage{number}": read_curve(history(tmp_path / f"{count}/stage{number}", (500, 2.0), (1000, 1.0)))
            for number in range(count)
        }
        picture = matplotlib.image.imread(plot_training(curves, tmp_path / f"{count}.png", "a training"))
        sizes.append(picture.shape[0])
        assert picture[..., :3].std() > 0.01
    assert sizes[1] > 1.5 * sizes[0]


def test_the_command_names_the_best_step_of_each_stage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    history(tmp_path / "run" / "diffusion", (500, 2.0), (1000, 0.5), (1500, 0.7))
    assert (
        execute(["train", "curves", "-o", str(tmp_path / "run"), "--picture", str(tmp_path / "p.png"), "--json"]) == 0
    )
    assert json.loads(capsys.readouterr().out)["diffusion"] == {
        "steps": 1500,
        "best": 1000,
        "loss": 0.5,
        "latent": 0.25,
    }
    assert (tmp_path / "p.png").is_file()


def test_a_folder_without_a_training_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["train", "curves", "-o", str(tmp_path), "--picture", str(tmp_path / "p.png")]) == 2
    assert "no stage of a training" in capsys.readouterr().err
    assert not (tmp_path / "p.png").exists()
