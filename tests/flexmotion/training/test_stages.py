"""Every stage at reduced size: it trains, resumes bit for bit, exports, and the sampler takes what comes out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.bundles.bundle import DECODER, DENOISER, Bundle  # noqa: E402
from flexmotion.configs.errors import ConfigError, MotionFormatError  # noqa: E402
from flexmotion.dataset.training_set import TrainingSet  # noqa: E402
from flexmotion.human.kinematics import forward  # noqa: E402
from flexmotion.sampling.sampler import Condition, Sampler  # noqa: E402
from flexmotion.text.sentence_encoder import SentenceEncoder  # noqa: E402
from flexmotion.training import evaluate  # noqa: E402
from flexmotion.training.autoencoder import Autoencoder  # noqa: E402
from flexmotion.training.autoencoder_task import AutoencoderTask, load_autoencoder  # noqa: E402
from flexmotion.training.checkpoints import BEST, LAST, load_weights  # noqa: E402
from flexmotion.training.diffusion_task import DiffusionTask  # noqa: E402
from flexmotion.training.distillation_task import DistillationTask  # noqa: E402
from flexmotion.training.evaluator_task import EvaluatorTask  # noqa: E402
from flexmotion.training.export import Decoder, export, load_networks  # noqa: E402
from flexmotion.training.personal import personal_run, personal_task  # noqa: E402
from flexmotion.training.processes import Processes  # noqa: E402
from flexmotion.training.run import Run  # noqa: E402
from flexmotion.training.stage import Progress, train_stage  # noqa: E402
from flexmotion.training.text_student import Corpus, distil  # noqa: E402
from flexmotion.training.window_set import WindowSet  # noqa: E402


def _text(run: Run, teacher, vocabulary: list[str]) -> None:
    said = ("walk forward", "turn left", "turn right", "wave with the right hand", "stand still") * 4
    words = tuple(word for word in vocabulary if len(word) > 1 and word.isalpha())
    distil(teacher, vocabulary, Corpus(said, words, said), run.stage("text"), steps=3, seed=0)


def _train(run: Run, name: str, task, steps: int | None = None) -> Progress:
    stage = getattr(run.config.stages, name)
    stage = stage if steps is None else stage.model_copy(update={"steps": steps, "cool_down": 0.0})
    return train_stage(task, stage, run.stage(name), fingerprint=run.fingerprint())


def _diffusion(run: Run) -> DiffusionTask:
    autoencoder = Autoencoder(run.config.autoencoder, run.config.window, run.layout)
    load_weights(autoencoder, run.stage("autoencoder"))
    encode = SentenceEncoder(run.stage("text"))
    return DiffusionTask(run.config, run.store(), autoencoder, encode, run.seed, Processes())


def _forces(run: Run) -> AutoencoderTask:
    return AutoencoderTask(run.config, run.store(), run.seed, Processes(), trained=run.stage("autoencoder"))


@pytest.fixture(scope="module")
def trained(small_set: Path, stream_config: Path, teacher, vocabulary, tmp_path_factory) -> Run:
    """A run through all stages of `stream`."""
    run = Run(tmp_path_factory.mktemp("run") / "stream", str(stream_config), seed=3)
    store = run.store(small_set)
    _train(run, "autoencoder", AutoencoderTask(run.config, store, run.seed, Processes()))
    _text(run, teacher, vocabulary)
    _train(run, "diffusion", _diffusion(run))
    task = _diffusion(run)
    load_weights(task.network, run.stage("diffusion"))
    _train(run, "distill", DistillationTask(run.config, task, run.seed))
    _train(run, "forces", _forces(run))
    return run


@pytest.fixture(scope="module")
def bundle(trained: Run, tmp_path_factory) -> Bundle:
    return export(trained, tmp_path_factory.mktemp("bundle") / "stream", distilled=True)


def test_store_is_computed_once(trained: Run, small_set: Path) -> None:
    store = trained.store()
    written = (store.folder / "features.npy").stat().st_mtime_ns
    again = trained.store(small_set)
    assert (again.folder / "features.npy").stat().st_mtime_ns == written
    assert len(store.features) == len(TrainingSet(small_set))


def test_windows_are_the_clips_frames(trained: Run) -> None:
    store = trained.store()
    windows = WindowSet(store, trained.config.window, "train").draw((0,), 5, following=True)
    assert windows.following is not None
    for row in range(5):
        clip = store.clips[windows.clip[row]]
        assert clip.split == "train"
        start = clip.start + windows.first[row]
        expected = store.statistics.normalise(store.features[start : start + trained.config.window.future])
        np.testing.assert_allclose(windows.future[row], expected, atol=1e-3)


def test_losses_fall(trained: Run, tmp_path: Path) -> None:
    task = AutoencoderTask(trained.config, trained.store(), trained.seed, Processes())
    before = task.validate()["loss"]
    stage = trained.config.stages.autoencoder.model_copy(update={"steps": 60, "learning_rate": 3e-3})
    done = train_stage(task, stage, tmp_path / "autoencoder", fingerprint="")
    assert done.figures["loss"] < 0.9 * before


def test_an_untrained_autoencoder_is_the_principal_components(trained: Run) -> None:
    """Went wrong: in 2,000 steps the networks alone learnt less than linear maps give for nothing."""
    alone = trained.config.autoencoder.model_copy(update={"shortcut": False})
    with_components, without = (
        AutoencoderTask(
            trained.config.model_copy(update={"autoencoder": config}), trained.store(), trained.seed, Processes()
        ).validate()
        for config in (trained.config.autoencoder, alone)
    )
    for block in ("root", "rotations", "positions"):
        assert with_components[block] < 0.5 * without[block]


def test_windows_that_go_over_to_another_clip(trained: Run) -> None:
    windows = WindowSet(trained.store(), trained.config.window, "train")
    before, after = windows.draw((1,), 6), windows.draw((2,), 6)
    both = before.blended_into(after, 8)
    torch.testing.assert_close(both.future[:, 8:], after.future[:, 8:])
    assert (both.future[:, 0] - before.future[:, 0]).norm() < 0.1 * (after.future[:, 0] - before.future[:, 0]).norm()
    assert torch.equal(both.history, before.history) and np.array_equal(both.clip, after.clip)


def test_windows_with_what_follows_lie_within_their_clips(trained: Run) -> None:
    """Went wrong: what followed a clip's last window was its last pose, and the model learnt to freeze."""
    windows = WindowSet(trained.store(), trained.config.window, "train")
    drawn = windows.draw((4,), 64, following=True)
    for row in range(64):
        clip = trained.store().clips[drawn.clip[row]]
        assert drawn.first[row] + 2 * trained.config.window.future <= clip.frames
    moved = drawn.next(drawn.history)
    assert drawn.following is not None and torch.equal(moved.future, drawn.following)
    with pytest.raises(ValueError, match="windows that follow"):
        moved.next(drawn.history)


def test_a_killed_training_goes_on_bit_for_bit(trained: Run, tmp_path: Path) -> None:
    def weights(name: str, steps: list[int]) -> dict[str, torch.Tensor]:
        for count in steps:
            task = AutoencoderTask(trained.config, trained.store(), trained.seed, Processes())
            stage = trained.config.stages.autoencoder.model_copy(update={"steps": count, "cool_down": 0.0})
            train_stage(task, stage, tmp_path / name, fingerprint="same")
        return torch.load(tmp_path / name / LAST, weights_only=True)["network"]

    whole, parts = weights("whole", [5]), weights("parts", [2, 5])
    assert all(torch.equal(whole[name], parts[name]) for name in whole)


def test_other_settings_in_the_same_folder_are_refused(trained: Run, paper_config: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="other settings"):
        Run(trained.folder, str(paper_config))
    with pytest.raises(ConfigError, match="name a configuration"):
        Run(tmp_path / "new")
    task = AutoencoderTask(trained.config, trained.store(), trained.seed, Processes())
    with pytest.raises(ConfigError, match="other settings"):
        train_stage(task, trained.config.stages.autoencoder, trained.stage("autoencoder"), fingerprint="other")


def test_too_short_clips_are_named(trained: Run) -> None:
    window = trained.config.window.model_copy(update={"future": 4000})
    with pytest.raises(MotionFormatError, match="no clip of split 'train'"):
        WindowSet(trained.store(), window, "train")


def test_history_of_a_stage_is_json(trained: Run) -> None:
    rows = [json.loads(line) for line in (trained.stage("diffusion") / "history.jsonl").read_text().splitlines()]
    assert [row["step"] for row in rows] == [3, 6]
    assert rows[-1]["validation"]["loss"] > 0


def test_forces_trained_on_leave_the_motion_as_it_is(trained: Run) -> None:
    """Whatever was trained on latents or judged by motion stays valid, bit for bit."""
    before = Autoencoder(trained.config.autoencoder, trained.config.window, trained.layout)
    load_weights(before, trained.stage("autoencoder"))
    after = load_autoencoder(trained)
    windows = WindowSet(trained.store(), trained.config.window, "validation").draw((7,), 4)
    with torch.no_grad():
        latents = [network.encode(windows.history, windows.future) for network in (before, after)]
        assert all(torch.equal(*pair) for pair in zip(*latents, strict=True))
        decoded = [network.decode(windows.history, latents[0][0]) for network in (before, after)]
    blocks = trained.layout.blocks
    changed = {name for name, cut in blocks.items() if not torch.equal(*(frames[..., cut] for frames in decoded))}
    assert changed == {"accelerations", "torques", "wrenches", "contacts"}


def test_only_better_forces_are_kept(trained: Run, tmp_path: Path) -> None:
    """Went wrong: a minute of training, which had only stirred the weights up, was exported."""
    task = _forces(trained)
    before = {name: value.clone() for name, value in task.network.state_dict().items()}
    stage = trained.config.stages.forces.model_copy(update={"learning_rate": 1.0, "warm_up": 0})
    train_stage(task, stage, tmp_path / "forces", fingerprint="", pretrained=True)
    kept = torch.load(tmp_path / "forces" / BEST, weights_only=True)["network"]
    assert all(torch.equal(kept[name], before[name]) for name in before)


def test_weights_from_before_there_was_a_dynamics_head(trained: Run, tmp_path: Path) -> None:
    weights = torch.load(trained.stage("autoencoder") / BEST, weights_only=True)
    weights["network"] = {name: value for name, value in weights["network"].items() if "dynamics" not in name}
    torch.save(weights, tmp_path / BEST)
    network = Autoencoder(trained.config.autoencoder, trained.config.window, trained.layout)
    load_weights(network, tmp_path)
    assert not network.dynamics.write.weight.any()
    del weights["network"]["persistence"]
    torch.save(weights, tmp_path / BEST)
    with pytest.raises(ConfigError, match="another network"):
        load_weights(network, tmp_path)


def test_a_training_of_another_version_is_refused_in_one_line(trained: Run, tmp_path: Path) -> None:
    state = torch.load(trained.stage("autoencoder") / LAST, weights_only=True)
    del state["network"]["persistence"]
    torch.save(state, tmp_path / LAST)
    task = AutoencoderTask(trained.config, trained.store(), trained.seed, Processes())
    with pytest.raises(ConfigError, match="of another version"):
        train_stage(task, trained.config.stages.autoencoder, tmp_path, fingerprint=trained.fingerprint())


def test_forces_of_another_motion_are_refused(trained: Run, tmp_path: Path) -> None:
    """Went wrong: an autoencoder trained on after its forces was exported with those."""
    run = personal_run(trained, tmp_path / "other", "like Ada")
    weights = torch.load(run.stage("autoencoder") / BEST, weights_only=True)
    weights["network"]["read.maps.root.weight"] += 0.1
    torch.save(weights, run.stage("autoencoder") / BEST)
    with pytest.raises(ConfigError, match="another autoencoder's motion"):
        load_networks(run, distilled=False)


def test_exported_networks_are_torchs(trained: Run, bundle: Bundle) -> None:
    autoencoder, denoiser = load_networks(trained, distilled=True)
    rng = np.random.default_rng(0)

    def draw(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape, np.float32)

    window, latent = trained.config.window, autoencoder.latent
    inputs = {
        "noisy": draw(1, latent),
        "time": np.array([700]),
        "history": draw(1, window.history, trained.layout.size),
        "sentence": draw(1, trained.config.diffusion.text),
        "velocity": draw(1, 3),
        "present": np.ones((1, 2), np.float32),
        "guidance": np.array([2.0], np.float32),
    }
    with torch.no_grad():
        clean = denoiser(*map(torch.from_numpy, inputs.values())).numpy()
        frames = Decoder(autoencoder, denoiser)(torch.from_numpy(clean), torch.from_numpy(inputs["history"])).numpy()
    (found,) = onnxruntime.InferenceSession(str(bundle.folder / DENOISER)).run(None, inputs)
    assert found == pytest.approx(clean, abs=1e-3)
    decoding = {"latent": clean, "history": inputs["history"]}
    (found,) = onnxruntime.InferenceSession(str(bundle.folder / DECODER)).run(None, decoding)
    assert found == pytest.approx(frames, abs=1e-3)


def test_sampler(bundle: Bundle) -> None:
    sampler = Sampler(bundle)
    history = sampler.standing()
    first = sampler.sample(history, Condition("walk forward"), seed=1)
    assert len(first) == sampler.future and first.fps == sampler.fps and first.body == sampler.body
    again = sampler.sample(history, Condition("walk forward"), seed=1)
    np.testing.assert_array_equal(first.joints, again.joints)
    other = sampler.sample(history, Condition("walk forward"), seed=2)
    assert np.abs(other.joints - first.joints).max() > 1e-6
    assert first.torques is not None and first.wrenches is not None and first.contacts is not None
    # One motion runs on from the other.
    second = sampler.sample(first, Condition(velocity=(0.5, 0.0, 0.2)), seed=1)
    assert np.abs(second.joints[0] - first.joints[-1]).max() < np.pi
    assert forward(second).com.shape == (sampler.future, 3)


def test_sampler_refuses_strange_histories(bundle: Bundle, make_standing) -> None:
    sampler = Sampler(bundle)
    with pytest.raises(ValueError, match="no frames"):
        sampler.sample(sampler.standing()[:0], Condition(), 0)
    with pytest.raises(ValueError, match="fps"):
        sampler.sample(make_standing(8, sampler.body, fps=25.0), Condition(), 0)
    with pytest.raises(ConfigError, match="steps is 0"):
        Sampler(bundle, steps=0)


def test_bundle_refuses_what_does_not_match(bundle: Bundle, tmp_path: Path) -> None:
    from shutil import copytree

    copy = copytree(bundle.folder, tmp_path / "copy")
    with (copy / DENOISER).open("ab") as file:
        file.write(b"x")
    with pytest.raises(ConfigError, match="not what the manifest says"):
        Bundle(copy)
    manifest = json.loads((bundle.folder / "manifest.json").read_text())
    (copy / "manifest.json").write_text(json.dumps(manifest | {"layout": "0" * 16}))
    with pytest.raises(ConfigError, match="made for layout"):
        Bundle(copy)
    (copy / "manifest.json").write_text(json.dumps(manifest | {"schema_": "flexmotion.bundle/0"}))
    with pytest.raises(ConfigError, match="schema"):
        Bundle(copy)
    with pytest.raises(ConfigError, match="no bundle there"):
        Bundle(tmp_path / "none")


@pytest.fixture(scope="module")
def judged(trained: Run) -> Run:
    encode = SentenceEncoder(trained.stage("text"))
    task = EvaluatorTask(trained.config, trained.store(), encode, trained.seed, Processes())
    _train(trained, "evaluator", task)
    return trained


def test_evaluation(judged: Run, bundle: Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluate, "PHYSICAL", 1)
    monkeypatch.setattr(evaluate, "TEXTS", 2)
    monkeypatch.setattr(evaluate, "NEIGHBOURS", 64)
    judge = evaluate.Judge(judged, bundle.body, 64)
    real, model, still = (
        judge.measure(generator) for generator in (judge.real, judge.sampled(Sampler(bundle)), judge.motionless)
    )
    assert set(real) == set(model) and {"fid", "contact_force", "jerk_join", "skate_ratio"} <= set(real)
    assert still["fid"].mean > real["fid"].mean > 0.0 and real["fid"].half_width > 0.0
    assert still["multimodality"].mean == pytest.approx(0.0, abs=1e-6)
    assert model["jerk_join"].half_width > 0.0
    assert judge.nearest()(0, 0).shape == judge.real(0, 0).shape


def test_personalisation(trained: Run, small_set: Path, tmp_path: Path) -> None:
    run = personal_run(trained, tmp_path / "ada", "like Ada")
    task = personal_task(run, trained, small_set, "like Ada")
    before = {name: value.clone() for name, value in task.network.state_dict().items()}
    done = _train(run, "diffusion", task, 2)
    assert set(done.parts) == {"kept", "learnt"}
    after = task.network.state_dict()
    assert any(not torch.equal(before[name], after[name]) for name in before)
    assert torch.equal(before["latent_mean"], after["latent_mean"])
    sampler = Sampler(export(run, tmp_path / "bundle", distilled=False), steps=2)
    assert sampler.prompt("walk like Ada").kind == "personal"
    with pytest.raises(ConfigError, match="not trained"):
        personal_run(Run(tmp_path / "empty", "stream"), tmp_path / "none", "like Ada")


def test_paper_configuration_goes_through_the_same_stages(
    small_set: Path, paper_config: Path, teacher, vocabulary: list[str], tmp_path: Path
) -> None:
    run = Run(tmp_path / "paper", str(paper_config))
    store = run.store(small_set)
    assert store.layout.fps == 20.0
    _train(run, "autoencoder", AutoencoderTask(run.config, store, 0, Processes()), 2)
    _text(run, teacher, vocabulary)
    _train(run, "diffusion", _diffusion(run), 2)
    sampler = Sampler(export(run, tmp_path / "bundle", distilled=False), steps=3)
    clip = sampler.sample(sampler.standing(), Condition("walk forward"), 0)
    assert len(clip) == run.config.window.future
