"""A small set, and a model so small that every stage trains in seconds."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from shutil import copyfile, copytree
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml

from flexmotion.configs.model import FOLDER
from flexmotion.dataset.build import build
from flexmotion.dataset.settings import BuildSettings
from flexmotion.human.motion import Motion
from flexmotion.text.sentence_encoder import NETWORK, VOCABULARY, SentenceEncoder

if TYPE_CHECKING:
    from flexmotion.bundles.bundle import Bundle
    from flexmotion.training.autoencoder_task import AutoencoderTask
    from flexmotion.training.control_task import ControlTask
    from flexmotion.training.diffusion_task import DiffusionTask
    from flexmotion.training.run import Run
    from flexmotion.training.stage import Progress, Task


def _digest(network: Any, *others: Any) -> str:
    """A hash of all that a network computes from: kinds and settings of its modules, weights and constants.

    That of its pickle depends on which of its strings are one object: the same network read twice had two.
    """
    from torch import nn

    found = hashlib.sha256(repr(others).encode())
    known = vars(nn.Module())  # weights, constants and parts among them, which are listed below
    for name, module in network.named_modules():
        settings = {key: value for key, value in vars(module).items() if key not in known or key == "training"}
        described = repr((name, type(module), settings))
        assert " at 0x" not in described, f"two objects may have the same address: {described}"
        found.update(described.encode())
    for name, values in (*network.named_parameters(), *network.named_buffers()):
        found.update(repr((name, values.dtype, values.shape)).encode())
        found.update(values.detach().contiguous().numpy().tobytes())
    return found.hexdigest()


TEXT_FILES = (NETWORK, VOCABULARY)
SMALL = {"width": 32, "heads": 2, "layers": 1, "expansion": 2}


@pytest.fixture(scope="session", autouse=True)
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """An export copies networks that were written before, and takes listeners that were fitted before.

    Most exports here are of the same ones, at twenty seconds each. `test_export.py` shows that the same network is
    written as the same bytes. Processes of one run of pytest share the networks. torch reads its table of operators,
    a quarter of an export, once.
    """
    if find_spec("torch") is None:
        yield
        return
    from torch.onnx._internal.exporter._registration import ONNXRegistry

    from flexmotion.training import export

    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "networks"
    folder.mkdir(exist_ok=True)
    write = export.export_network

    def export_network(network: Any, path: Path, inputs: dict[str, Any], *others: Any) -> None:
        before = folder / _digest(network, {name: (value.dtype, value.shape) for name, value in inputs.items()}, others)
        if not before.is_file():
            write(network, path, inputs, *others)
            whole = before.with_name(f"{before.name}-{os.getpid()}")
            copyfile(path, whole)
            whole.replace(before)
        copyfile(before, path)

    def fitted(fit: Callable[..., Any]) -> Callable[..., Any]:
        known: dict[tuple[Any, ...], Any] = {}

        def fit_once(encode: SentenceEncoder, *examples: Any) -> Any:
            files = sorted(encode._path.parent.iterdir())
            key = (*(file.read_bytes() for file in files if file.name in TEXT_FILES), repr(examples))
            if key not in known:
                known[key] = fit(encode, *examples)
            return known[key]

        return fit_once

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export, "export_network", export_network)
        patch.setattr(ONNXRegistry, "from_torchlib", staticmethod(cache(ONNXRegistry.from_torchlib)))
        for name in ("fit_listener", "fit_manner_listener"):
            patch.setattr(export, name, fitted(getattr(export, name)))
        yield


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
    content["window"] |= {"muscles": False, "joint_contact": False, **changes}
    content["autoencoder"] |= {"latent": 16, "encoder": SMALL, "decoder": SMALL}
    content["diffusion"] |= {"denoiser": SMALL, "text": 24, "roll_out_from": 2, "roll_out_grown": 3}
    content["control"] = {"layers": 1}
    content["stages"]["control"] = {"learning_rate": 3.0e-4}
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
    """A sentence encoder without files: the sum of a random direction for each word."""

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


@dataclass(frozen=True)
class Stages:
    """Trains the stages of a run at reduced size; `text` is the folder of a trained sentence encoder."""

    text: Path

    def copy_text(self, run: Run) -> None:
        """Give a run the sentence encoder."""
        copytree(self.text, run.stage("text"))

    def train(self, run: Run, name: str, task: Task, steps: int | None = None) -> Progress:
        """Train a stage, for the configured steps or for these."""
        from flexmotion.training.stage import train_stage

        stage = getattr(run.config.stages, name)
        stage = stage if steps is None else stage.model_copy(update={"steps": steps, "cool_down": 0.0})
        return train_stage(task, stage, run.stage(name), fingerprint=run.fingerprint())

    def autoencoder(self, run: Run) -> AutoencoderTask:
        """A new autoencoder."""
        from flexmotion.training.autoencoder_task import AutoencoderTask
        from flexmotion.training.processes import Processes

        return AutoencoderTask(run.config, run.store(), run.seed, Processes())

    def forces(self, run: Run) -> AutoencoderTask:
        """The forces of the run's autoencoder."""
        from flexmotion.training.autoencoder_task import AutoencoderTask
        from flexmotion.training.processes import Processes

        return AutoencoderTask(run.config, run.store(), run.seed, Processes(), trained=run.stage("autoencoder"))

    def control(self, run: Run) -> ControlTask:
        """A new control branch on the run's distilled model."""
        from flexmotion.training.checkpoints import load_weights
        from flexmotion.training.control_task import ControlTask
        from flexmotion.training.export import load_networks

        teacher = self.diffusion(run)
        load_weights(teacher.network, run.stage("diffusion"))
        return ControlTask(run.config, teacher, load_networks(run, distilled=True)[1], run.seed)

    def diffusion(self, run: Run) -> DiffusionTask:
        """A new diffusion on the run's autoencoder."""
        from flexmotion.training.autoencoder_task import load_autoencoder
        from flexmotion.training.diffusion_task import DiffusionTask
        from flexmotion.training.processes import Processes

        encode = SentenceEncoder(run.stage("text"))
        return DiffusionTask(run.config, run.store(), load_autoencoder(run), encode, run.seed, Processes())


@pytest.fixture(scope="session")
def stages(teacher: Teacher, vocabulary: list[str], tmp_path_factory: pytest.TempPathFactory) -> Stages:
    """The stages, with a sentence encoder trained once."""
    from flexmotion.training.text_student import Corpus, distil

    said = ("walk forward", "turn left", "turn right", "wave with the right hand", "stand still") * 4
    words = tuple(word for word in vocabulary if len(word) > 1 and word.isalpha())
    folder = tmp_path_factory.mktemp("text") / "text"
    distil(teacher, vocabulary, Corpus(said, words, said), folder, steps=3, seed=0)
    return Stages(folder)


@pytest.fixture(scope="session")
def trained(small_set: Path, stream_config: Path, stages: Stages, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run through all stages of `stream` but the evaluator."""
    from flexmotion.training.checkpoints import load_weights
    from flexmotion.training.distillation_task import DistillationTask
    from flexmotion.training.run import Run

    run = Run(tmp_path_factory.mktemp("run") / "stream", str(stream_config), seed=3)
    run.store(small_set)
    stages.copy_text(run)
    stages.train(run, "autoencoder", stages.autoencoder(run))
    diffusion = stages.diffusion(run)
    stages.train(run, "diffusion", diffusion)
    load_weights(diffusion.network, run.stage("diffusion"))
    stages.train(run, "distill", DistillationTask(run.config, diffusion, run.seed))
    stages.train(run, "forces", stages.forces(run))
    return run


@pytest.fixture(scope="session")
def controlled(
    trained: Run, small_set: Path, stages: Stages, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Run, ControlTask]:
    """A copy of the run with a control branch, and the branch's task."""
    from flexmotion.training.run import Run

    folder = tmp_path_factory.mktemp("controlled") / "stream"
    copytree(trained.folder, folder)
    run = Run(folder)
    task = stages.control(run)
    stages.train(run, "control", task)
    return run, task


@pytest.fixture(scope="session")
def bundle(trained: Run, tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """The distilled model, exported."""
    from flexmotion.training.export import export

    return export(trained, tmp_path_factory.mktemp("bundle") / "stream", distilled=True)


@pytest.fixture(scope="session")
def undistilled(trained: Run, tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """The diffusion model without a student, exported."""
    from flexmotion.training.export import export

    return export(trained, tmp_path_factory.mktemp("undistilled") / "stream", distilled=False)
