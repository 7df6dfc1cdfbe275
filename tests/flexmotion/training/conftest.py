"""A small set and a model so small that every stage trains in seconds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml

from flexmotion.configs.model import FOLDER
from flexmotion.dataset.build import build
from flexmotion.dataset.settings import BuildSettings
from flexmotion.human.motion import Motion

SMALL = {"width": 32, "heads": 2, "layers": 1, "expansion": 2}


@pytest.fixture(scope="session")
def small_set(tmp_path_factory: pytest.TempPathFactory, clip: Motion, write_bvh: Callable[..., Path]) -> Path:
    """A set of two clips for training and one for validation, with mirror images, without muscles."""
    folder = tmp_path_factory.mktemp("motions") / "bandai"
    folder.mkdir()
    write_bvh(folder / "walk_normal_001.bvh", clip[240:360])
    write_bvh(folder / "wave_normal_001.bvh", clip[:90])
    write_bvh(folder / "walk_happy_001.bvh", clip[240:330])
    rows = ["walk_normal_001.bvh,walk-turn-left,normal", "wave_normal_001.bvh,wave-right-hand,active"]
    rows.append("walk_happy_001.bvh,walk,happy")
    (folder / "bandai_index.csv").write_text("\n".join(["file,content,style", *rows]) + "\n")
    out = folder.parent / "set"
    build([folder], out, BuildSettings(muscles=False))
    return out


def _small(name: str, changes: dict[str, object], path: Path) -> Path:
    content = yaml.safe_load((FOLDER / f"{name}.yaml").read_text())
    content["window"] |= {"muscles": False, **changes}
    content["autoencoder"] |= {"latent": 16, "encoder": SMALL, "decoder": SMALL}
    content["diffusion"] |= {"denoiser": SMALL, "text": 24, "roll_out_from": 2, "roll_out_grown": 3}
    content["distillation"]["grid"] = 10
    content["evaluator"] = {"motion": SMALL, "width": 16}
    for stage in content["stages"].values():
        stage |= {"steps": 6, "batch": 8, "warm_up": 2, "validate_every": 3}
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.fixture(scope="session")
def stream_config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The configuration `stream`, reduced."""
    return _small("stream", {}, tmp_path_factory.mktemp("config") / "stream.yaml")


@pytest.fixture(scope="session")
def paper_config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The configuration `paper`, reduced; clips of two seconds."""
    return _small("paper", {"future": 40}, tmp_path_factory.mktemp("config") / "paper.yaml")


@dataclass(frozen=True)
class Teacher:
    """A sentence encoder that any machine has: words hashed to directions."""

    size: int = 24

    def __call__(self, sentences: list[str]) -> np.ndarray:
        return np.stack([self._sentence(sentence) for sentence in sentences])

    def _sentence(self, sentence: str) -> np.ndarray:
        total = np.zeros(self.size)
        for word in sentence.split():
            seed = sum(ord(letter) * 31**at for at, letter in enumerate(word)) % 2**32
            total += np.random.default_rng(seed).normal(size=self.size)
        return (total / np.linalg.norm(total)).astype(np.float32)


@pytest.fixture(scope="session")
def teacher() -> Teacher:
    return Teacher()


WORDS = "walk turn left right wave with the hand stand still both hands person forward a"


@pytest.fixture(scope="session")
def vocabulary() -> list[str]:
    """Whole words, letters, and letters within words."""
    letters = [chr(code) for code in range(ord("a"), ord("z") + 1)]
    return list(dict.fromkeys(["[UNK]", *WORDS.split(), *letters, *(f"##{letter}" for letter in letters)]))
