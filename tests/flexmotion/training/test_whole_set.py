"""A set with muscles and variants: joint contact forces, loads and error estimates, through every stage."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
import yaml

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.configs.errors import MotionFormatError  # noqa: E402
from flexmotion.dataset.build import build  # noqa: E402
from flexmotion.dataset.fields import FIELDS  # noqa: E402
from flexmotion.dataset.settings import BuildSettings  # noqa: E402
from flexmotion.dataset.training_set import TrainingSet  # noqa: E402
from flexmotion.features.layout import JOINT_CONTACT  # noqa: E402
from flexmotion.human.motion import Motion  # noqa: E402
from flexmotion.sampling.sampler import Condition, Sampler  # noqa: E402
from flexmotion.training.checkpoints import LAST, load_weights  # noqa: E402
from flexmotion.training.distillation_task import DistillationTask  # noqa: E402
from flexmotion.training.export import export  # noqa: E402
from flexmotion.training.feature_store import FeatureStore, build_store  # noqa: E402
from flexmotion.training.format import FORMAT  # noqa: E402
from flexmotion.training.run import Run, _fixed  # noqa: E402
from flexmotion.training.stage import train_stage  # noqa: E402
from flexmotion.training.store_index import INDEX  # noqa: E402
from flexmotion.training.window_set import WindowSet  # noqa: E402

KNEE = 3 * 1 + 2
"""Column of the left knee's compression in the block of joint contact forces."""


@pytest.fixture(scope="module")
def whole_set(tmp_path_factory: pytest.TempPathFactory, clip: Motion, write_bvh: Callable[..., Path]) -> Path:
    """One clip for training and one for validation, each with a variant, with muscles."""
    pytest.importorskip("myo_sim", reason="extra 'biomech' is not installed")
    folder = tmp_path_factory.mktemp("motions") / "bandai"
    folder.mkdir()
    write_bvh(folder / "walk_normal_001.bvh", clip[240:330])
    write_bvh(folder / "walk_happy_001.bvh", clip[240:300])
    rows = ["walk_normal_001.bvh,walk,normal", "walk_happy_001.bvh,walk,happy"]
    (folder / "bandai_index.csv").write_text("\n".join(["file,content,style", *rows]) + "\n")
    out = folder.parent / "set"
    build([folder], out, BuildSettings(mirrored=False, variants=1))
    return out


@pytest.fixture(scope="module")
def run(whole_set: Path, stream_config: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A new run with the features of the set."""
    folder = tmp_path_factory.mktemp("run")
    content = yaml.safe_load(stream_config.read_text())
    content["window"] |= {"muscles": True, "joint_contact": True}
    content["losses"]["muscle_torques"] = 0.0
    content["losses"]["physics_share"] = 1.0
    path = folder / "whole.yaml"
    path.write_text(yaml.safe_dump(content))
    found = Run(folder / "whole", str(path), seed=1)
    found.store(whole_set)
    return found


def test_the_store_has_loads_and_error_estimates(run: Run, whole_set: Path) -> None:
    store, source = run.store(), TrainingSet(whole_set)
    assert [clip.variant for clip in store.clips] == ["original", "varied"] * 2
    for clip, given in zip(store.clips, source.clips, strict=True):
        rows = slice(clip.start, clip.start + clip.frames)
        weight = clip.body.mass * 9.81
        assert bool(store.loads[rows].any()) != clip.recorded
        assert store.loads[rows][:, :3, 2] == pytest.approx(source.loads(given)[..., 2] / weight, abs=1e-3)
        expected = np.linalg.norm(source.force_error(given), axis=1)
        assert store.force_error[rows] == pytest.approx(expected, rel=1e-2, abs=1e-3)
        assert bool(expected.any()) == ("force_error" in FIELDS)
        knee = source["joint_contact"][given.rows][:, 1, 2] / weight
        assert store.features[rows][:, store.layout.blocks[JOINT_CONTACT]][:, KNEE] == pytest.approx(knee, abs=2e-2)


def test_held_out_windows_are_of_recorded_clips(run: Run) -> None:
    """Figures of sets with and without variants are of the same windows."""
    store = run.store()
    for split, variants in (("train", True), ("validation", False)):
        drawn = WindowSet(store, run.config.window, split).draw((0,), 32)
        assert any(not store.clips[number].recorded for number in drawn.clip) == variants
        assert bool(drawn.loads.any()) == variants and drawn.future_loads.shape[1] == run.config.window.future
    assert WindowSet(store, run.config.window, "validation", variants=True).draw((0,), 32).loads.any()


def test_a_store_of_an_earlier_format_has_neither(run: Run, tmp_path: Path) -> None:
    folder = copytree(run.folder / "features", tmp_path / "features")
    for name in ("loads", "force_error"):
        (folder / f"{name}.npy").unlink()
    index = json.loads((folder / INDEX).read_text())
    (folder / INDEX).write_text(json.dumps(index | {"format": FORMAT - 1}))
    drawn = WindowSet(FeatureStore(folder), run.config.window, "train").draw((0,), 4)
    assert not drawn.loads.any() and not drawn.force_error.any()


def test_a_set_without_joint_contact_is_refused_where_it_is_learnt(run: Run, small_set: Path, tmp_path: Path) -> None:
    layout = replace(run.layout, muscles=0)
    with pytest.raises(MotionFormatError, match="no joint contact forces; build it with muscles, or set window.joint_"):
        build_store(TrainingSet(small_set), layout, tmp_path / "features")


def test_trainings_from_before_joint_contact_resume(trained: Run, run: Run) -> None:
    """Regression: a new setting entered the fingerprint, and every training begun before was refused."""
    kept = _fixed(trained.config)
    assert "joint_contact" not in kept["window"]
    assert _fixed(run.config)["window"]["joint_contact"]
    plain = trained.config.autoencoder.model_copy(update={"loads": False})
    assert "loads" not in _fixed(trained.config.model_copy(update={"autoencoder": plain}))["autoencoder"]


def test_every_stage_and_the_exported_model(run: Run, stages, tmp_path: Path) -> None:
    stages.copy_text(run)
    figures = stages.train(run, "autoencoder", stages.autoencoder(run)).figures
    assert figures["joint_contact"] > 0 and figures["joint_contact_bw"] > 0 and figures["euler_root"] > 0
    diffusion = stages.diffusion(run)
    stages.train(run, "diffusion", diffusion)
    load_weights(diffusion.network, run.stage("diffusion"))
    stages.train(run, "distill", DistillationTask(run.config, diffusion, run.seed))
    stages.train(run, "forces", stages.forces(run))
    bundle = export(run, tmp_path / "bundle", distilled=True)
    assert bundle.layout == run.layout and bundle.layout.joint_contact
    sampler = Sampler(bundle)
    motion = sampler.sample(sampler.standing(), Condition("walk forward"), 0)
    assert motion.joint_contact is not None and np.isfinite(motion.joint_contact).all()


def test_a_stopped_training_resumes_bit_for_bit(run: Run, stages, tmp_path: Path) -> None:
    states = []
    for name, parts in (("whole", [4]), ("parts", [2, 4])):
        for steps in parts:
            stage = run.config.stages.autoencoder.model_copy(update={"steps": steps, "cool_down": 0.0})
            train_stage(stages.autoencoder(run), stage, tmp_path / name, fingerprint="")
        states.append(torch.load(tmp_path / name / LAST, weights_only=True))
    whole, resumed = (state["network"] for state in states)
    assert list(whole) == list(resumed) and all(torch.equal(value, resumed[name]) for name, value in whole.items())
    assert whole["dynamics.carry.weight"].abs().max() > 0
