"""A release: weights in half precision in one file, from which a training, a personalisation and a bundle begin."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest
import yaml

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from safetensors.torch import save_file  # noqa: E402

from flexmotion.bundles.bundle import Bundle  # noqa: E402
from flexmotion.bundles.card import CARD  # noqa: E402
from flexmotion.configs.errors import ConfigError  # noqa: E402
from flexmotion.sampling.sampler import Condition, Sampler  # noqa: E402
from flexmotion.streamer.cli import execute  # noqa: E402
from flexmotion.text.sentence_encoder import SentenceEncoder  # noqa: E402
from flexmotion.training import own_samples  # noqa: E402
from flexmotion.training.autoencoder_task import load_autoencoder  # noqa: E402
from flexmotion.training.checkpoints import (  # noqa: E402
    BEST,
    LAST,
    is_trained,
    load_weights,
    read_checkpoint,
    write_checkpoint,
)
from flexmotion.training.evaluator_task import EvaluatorTask  # noqa: E402
from flexmotion.training.export import export, load_networks  # noqa: E402
from flexmotion.training.half_weights import LEAST  # noqa: E402
from flexmotion.training.personal import personal_run, personal_task, personal_teacher  # noqa: E402
from flexmotion.training.personal_export import export_bundle  # noqa: E402
from flexmotion.training.processes import Processes  # noqa: E402
from flexmotion.training.release import begin_run, write_release  # noqa: E402
from flexmotion.training.release_file import METADATA, ReleaseFile, write_release_file  # noqa: E402
from flexmotion.training.run import Run  # noqa: E402
from flexmotion.training.store_index import INDEX  # noqa: E402


@pytest.fixture(scope="module")
def released(trained: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The release of all stages of the trained run."""
    path = tmp_path_factory.mktemp("release") / "small.safetensors"
    write_release(trained, path, description="for tests")
    return path


def test_others_may_read_a_release_as_they_may_read_other_files(released: Path, tmp_path: Path) -> None:
    """Regression: only its owner could."""
    (tmp_path / "other").touch()
    assert released.stat().st_mode == (tmp_path / "other").stat().st_mode


def test_a_release_says_what_it_is(trained: Run, released: Path) -> None:
    header = ReleaseFile(released).header
    assert list(header.stages) == ["autoencoder", "diffusion", "distill"]
    assert {record.step for record in header.stages.values()} <= {3, 6} and header.seed == trained.seed
    assert (
        header.config == trained.config and header.description == "for tests" and header.layout == trained.layout.hash
    )
    summary = trained.summary()
    assert header.set_.licences == list(summary.licences) and header.set_.clips == summary.clips > 0
    assert header.stages["diffusion"].figures["loss"] > 0


def test_the_weights_of_a_new_folder_are_those_of_the_training_to_half_precision(
    trained: Run, released: Path, tmp_path: Path
) -> None:
    """The forces of the stage `forces` are a part of the autoencoder."""
    run = begin_run(released, tmp_path / "new", ["distill"])
    for before, after in zip(load_networks(trained, distilled=True), load_networks(run, distilled=True), strict=True):
        for name, expected in before.state_dict().items():
            found = after.state_dict()[name]
            large = expected.numel() >= LEAST
            torch.testing.assert_close(found, expected.half().float() if large else expected, rtol=0, atol=0)
    assert not run.stage("forces").exists() and run.origin is not None and run.origin.hash == ReleaseFile(released).hash


def test_a_bundle_of_a_release_moves_like_that_of_the_training(bundle: Bundle, released: Path, tmp_path: Path) -> None:
    """Without the training set: size, rest pose, statistics and licence are those of the release."""
    again = export(begin_run(released, tmp_path / "new", ["distill"]), tmp_path / "bundle", distilled=True)
    ours, theirs = Sampler(again), Sampler(bundle)
    assert again.body == bundle.body and again.manifest.licence == bundle.manifest.licence
    motions = [each.sample(each.standing(), Condition("walk forward"), seed=3) for each in (ours, theirs)]
    # A bundle is in half precision too, but rounds what the export has folded together; torques follow accelerations.
    np.testing.assert_allclose(motions[0].joints, motions[1].joints, atol=2e-3)
    np.testing.assert_allclose(motions[0].root_position, motions[1].root_position, atol=2e-3)
    assert motions[0].torques is not None and motions[1].torques is not None
    assert np.abs(motions[0].torques - motions[1].torques).mean() < 0.05
    assert "--from RELEASE" in (tmp_path / "bundle" / CARD).read_text(encoding="utf-8")


def test_a_training_from_a_release_keeps_its_set_once_it_is_trained_further(
    released: Path, small_set: Path, tmp_path: Path
) -> None:
    """Its statistics are the release's, whatever its set: only a training on a set ties it to that set."""
    run = begin_run(released, tmp_path / "new", ["autoencoder"])
    before = run.store(small_set).statistics
    index = run.folder / "features" / INDEX
    content = json.loads(index.read_text())
    index.write_text(json.dumps(content | {"key": "of another motion", "set": "another"}))
    np.testing.assert_array_equal(run.store(small_set).statistics.mean, before.mean)
    assert json.loads(index.read_text()) == content
    (run.stage("autoencoder") / LAST).touch()
    index.write_text(json.dumps(content | {"key": "of another motion", "set": "another"}))
    with pytest.raises(ConfigError, match=r"the training there is on another \("):
        run.store(small_set)


def test_a_training_goes_on_at_the_step_of_the_weights(
    released: Path, small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It says that the state of the optimiser is not there; resumed, it is a training like any other."""
    begin = ["train", "diffusion", "--from", str(released), "--set", str(small_set), "-o", str(tmp_path / "new")]
    at = ReleaseFile(released).header.stages["diffusion"].step
    assert execute([*begin, "--steps", str(at), "--json"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["step"] == at
    assert f"begins at step {at}" in output.err and "the state of the optimiser is not in them" in output.err
    assert f"nothing to train: --steps is {at}; give more than {at}" in output.err
    assert execute([*begin, "--steps", str(at + 2), "--json"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["step"] == at + 2 and "begins at step" not in output.err
    folder = tmp_path / "new" / "diffusion"
    rows = [json.loads(line) for line in (folder / "history.jsonl").read_text().splitlines()]
    assert rows[0]["step"] == at and "begun" not in read_checkpoint(folder / BEST)
    last = read_checkpoint(folder / LAST)
    assert (last["first"], last["step"]) == (at, at + 2)
    # The learning rate has risen again within two steps, and cools down over the last fifth of eight.
    rates = [entry["lr"] for entry in last["optimiser"]["param_groups"]]
    assert rates == [pytest.approx(Run(tmp_path / "new").config.stages.diffusion.learning_rate / 1.6)]


def test_a_training_killed_before_its_first_step_keeps_the_weights(
    released: Path, small_set: Path, stages, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first validation writes `best.pt` anew: without a state to resume from, step 0 would follow."""
    run = begin_run(released, tmp_path / "new", ["autoencoder"])
    run.store(small_set)
    at = read_checkpoint(run.stage("autoencoder") / BEST)["step"]
    task = stages.autoencoder(run)

    def killed(step: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(task, "losses", killed)
    with pytest.raises(KeyboardInterrupt):
        stages.train(run, "autoencoder", task, at + 1)
    assert stages.train(run, "autoencoder", stages.autoencoder(run), at + 1).step == at + 1


def test_features_are_normalised_as_the_weights_expect(
    trained: Run, released: Path, small_set: Path, tmp_path: Path
) -> None:
    """Another set has other means; networks that saw features normalised by them would see another motion."""
    other = begin_run(released, tmp_path / "new", ["autoencoder"])
    features = trained.store().folder
    copytree(features, other.folder / "features")
    with np.load(features / "statistics.npz") as found:
        np.savez(other.folder / "features" / "statistics.npz", mean=found["mean"] + 1, spread=2 * found["spread"])
    np.testing.assert_array_equal(other.store().statistics.mean, trained.store().statistics.mean)
    np.testing.assert_array_equal(other.store().statistics.spread, trained.store().statistics.spread)


def test_held_out_latents_of_a_person_are_normalised_as_the_model_expects(
    trained: Run, small_set: Path, tmp_path: Path
) -> None:
    """Regression: the validation of a personalisation compared samples with latents in units of the person's clips."""
    task = personal_task(personal_run(trained, tmp_path / "ada", "like Ada"), trained, small_set, "like Ada")
    person = task.person
    windows = person.held_out.draw((person.seed, 21), len(person._held_out.latent))
    raw = person.training.encode(windows.history, windows.future)
    expected = (raw - task.network.latent_mean) / task.network.latent_spread
    torch.testing.assert_close(person._held_out.latent, expected)


def test_a_release_is_personalised_with_the_set_that_keeps_the_rest(
    released: Path, small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    personalize = ["personalize", str(released), "--set", str(small_set), "--prior", str(small_set)]
    out = ["--manner", "like Ada", "-o", str(tmp_path / "ada"), "--steps", "2", "--json"]
    assert execute([*personalize, *out]) == 0
    figures = json.loads(capsys.readouterr().out)["validation"]
    assert figures["kept"] > 0 and figures["learnt"] > 0
    sampler = Sampler(export_bundle(Run(tmp_path / "ada"), tmp_path / "bundle", distilled=False), steps=2)
    assert sampler.prompt("walk like Ada").manner == "like Ada"


def test_a_release_is_personalised_without_any_other_set(
    released: Path, small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is to stay is what the model sampled before; at first nothing has to change there."""
    monkeypatch.setattr(own_samples, "ROLL_OUTS", 16)
    personalize = ["personalize", str(released), "--set", str(small_set), "--manner", "like Ada"]
    assert execute([*personalize, "-o", str(tmp_path / "ada"), "--steps", "2", "--json"]) == 0
    assert 0 < json.loads(capsys.readouterr().out)["validation"]["kept"] < 0.05
    run = Run(tmp_path / "ada")
    assert not run.has_features and (run.folder / "person" / "index.json").is_file()
    sampler = Sampler(export_bundle(run, tmp_path / "bundle", distilled=False), steps=2)
    assert sampler.prompt("walk like Ada").manner == "like Ada"
    task = personal_task(run, Run(run.folder / "released"), small_set, "like Ada")
    loss, parts = task.losses(0)
    assert float(parts["kept"]) == 0.0 and float(parts["learnt"]) > 0.0
    again, _ = task.losses(0)
    assert float(again) == float(loss)
    # Guidance needs what is done without a request, too: that was not kept, and drifted.
    asked = task._base.draw((1,), 256).conditions.present
    assert 0.0 < float((asked[:, 0] == 0.0).float().mean()) < 0.5


def test_a_personalised_release_is_distilled_on_the_person_and_on_its_own_samples(
    released: Path, small_set: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It asked for the features of a set: a bundle for a robot could not be made of the shipped weights."""
    monkeypatch.setattr(own_samples, "ROLL_OUTS", 16)
    folder = str(tmp_path / "ada")
    personalize = ["personalize", str(released), "--set", str(small_set), "--manner", "like Ada"]
    assert execute([*personalize, "-o", folder, "--steps", "2"]) == 0
    assert execute(["train", "distill", "-o", folder, "--steps", "2"]) == 0
    run = Run(tmp_path / "ada")
    sampler = Sampler(export_bundle(run, tmp_path / "bundle", distilled=True))
    assert sampler.bundle.manifest.guided and sampler.prompt("walk like Ada").manner == "like Ada"
    person, examples = personal_teacher(run)
    asked = examples.draw((3,), 64).conditions
    ada = person.training.describe(person.training.draw((1,), 1), (2,)).manner[0]
    hers = (asked.manner == ada).all(dim=1)
    assert bool(hers[32:].all()) and not bool(hers[:32].any())
    assert bool(asked.present[32:, 2].all())


def test_a_personalised_training_is_distilled_on_its_set_and_the_person(
    trained: Run, small_set: Path, stages: Any, tmp_path: Path
) -> None:
    """The person's manner was never asked for in its distillation: the student did not know it."""
    run = personal_run(trained, tmp_path / "ada", "like Ada")
    with pytest.raises(ConfigError, match="flexmotion personalize"):
        personal_teacher(run)
    stages.train(run, "diffusion", personal_task(run, trained, small_set, "like Ada"), 2)
    assert execute(["train", "distill", "-o", str(run.folder), "--steps", "2"]) == 0
    _, examples = personal_teacher(run)
    asked = examples.draw((3,), 64).conditions
    assert not torch.equal(asked.manner[0], asked.manner[-1]) and bool(asked.present[32:, 2].all())


def test_stages_that_a_release_lacks_are_found_in_the_files_of_the_same_training_beside_it(
    trained: Run, tmp_path: Path
) -> None:
    """The student and the control branch lie in files of their own, and no command could begin from them."""
    write_release(trained, tmp_path / "main.safetensors", stages=["autoencoder", "diffusion", "text"])
    with pytest.raises(ConfigError, match="has no stage 'distill', expected one of: autoencoder, diffusion"):
        begin_run(tmp_path / "main.safetensors", tmp_path / "none", ["distill"])
    save_file({"foreign": torch.zeros(2)}, tmp_path / "foreign.safetensors")
    write_release(trained, tmp_path / "student.safetensors", stages=["distill"])
    run = begin_run(tmp_path / "main.safetensors", tmp_path / "new", ["distill"])
    found, expected = load_networks(run, distilled=True)[1], load_networks(trained, distilled=True)[1]
    for name, value in expected.state_dict().items():
        torch.testing.assert_close(found.state_dict()[name], value, atol=2e-3, rtol=2e-3)
    # Of another training, on the same set: its latents would not fit.
    other = ReleaseFile(tmp_path / "student.safetensors")
    header = other.header.model_copy(update={"built_on": {"distill": "0" * 64}})
    write_release_file(header, other.tensors, tmp_path / "student.safetensors")
    with pytest.raises(ConfigError, match="has no stage 'distill'"):
        begin_run(tmp_path / "main.safetensors", tmp_path / "other", ["distill"])


def test_an_evaluator_is_found_beside_a_release_of_the_same_words(trained: Run, stages: Any, tmp_path: Path) -> None:
    """`evaluate` did not work with the repository's weights: they had no evaluator."""
    run = Run(Path(copytree(trained.folder, tmp_path / "trained")))
    encode = SentenceEncoder(run.stage("text"))
    stages.train(run, "evaluator", EvaluatorTask(run.config, run.store(), encode, run.seed, Processes()))
    main, judge = tmp_path / "main.safetensors", tmp_path / "evaluator.safetensors"
    write_release(trained, main, stages=["autoencoder", "text"])
    with pytest.raises(ConfigError, match="has no stage 'evaluator'"):
        begin_run(main, tmp_path / "none", ["evaluator"])
    write_release(run, judge, stages=["evaluator"])
    assert is_trained(begin_run(main, tmp_path / "new", ["evaluator"]).stage("evaluator"))
    other = ReleaseFile(judge)
    for header, tensors in (
        (other.header.model_copy(update={"text": {}}), other.tensors),
        (other.header, other.tensors | {"mean": other.tensors["mean"] + 1}),
    ):
        write_release_file(header, tensors, judge)
        with pytest.raises(ConfigError, match="has no stage 'evaluator'"):
            begin_run(main, tmp_path / "other", ["evaluator"])


def test_no_student_is_added_to_a_diffusion_that_was_trained_further(
    trained: Run, small_set: Path, stages: Any, tmp_path: Path
) -> None:
    """Control was then trained on a student of other weights."""
    write_release(trained, tmp_path / "main.safetensors")
    run = begin_run(tmp_path / "main.safetensors", tmp_path / "new", ["diffusion"])
    write_checkpoint({"step": 7}, run.stage("diffusion") / LAST)
    begin_run(tmp_path / "main.safetensors", tmp_path / "new", ["distill"])
    assert not (run.stage("distill") / BEST).is_file()


def test_a_personalised_release_knows_its_manner(
    trained: Run, undistilled: Bundle, small_set: Path, stages: Any, tmp_path: Path
) -> None:
    """The bundle of the weights file did not know "like Ada"."""
    run = personal_run(trained, tmp_path / "ada", "like Ada")
    stages.train(run, "diffusion", personal_task(run, trained, small_set, "like Ada"), 2)
    path, made = tmp_path / "ada.safetensors", tmp_path / "bundle"
    assert execute(["export", str(run.folder), "--weights", "-o", str(path)]) == 0
    onto = ["--onto", str(undistilled.folder), "-o", str(made)]
    assert execute(["export", str(path), "--diffusion", *onto]) == 0
    assert Sampler(Bundle(made), steps=2).prompt("walk like Ada").manner == "like Ada"


def test_a_bundle_of_a_release_without_a_student_names_the_file(
    trained: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The message named a folder that was gone."""
    path = tmp_path / "main.safetensors"
    write_release(trained, path, stages=["autoencoder", "diffusion", "text"])
    assert execute(["export", str(path), "-o", str(tmp_path / "bundle")]) == 2
    assert "main.safetensors: has no stage 'distill'" in "".join(capsys.readouterr().err.split("\n"))
    assert not (tmp_path / "bundle").exists()
    assert execute(["export", str(path), "--weights", "-o", str(tmp_path / "again.safetensors")]) == 2


def test_a_release_without_its_sentence_encoder_finds_it_beside_it_or_in_a_bundle(
    trained: Run, released: Path, bundle: Bundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import flexmotion.training.release as module

    path = tmp_path / "smaller.safetensors"
    write_release(trained, path, stages=["autoencoder", "diffusion"])
    assert {file.name for file in (tmp_path / "text").iterdir()} == {"text.onnx", "vocabulary.txt"}
    assert path.stat().st_size < released.stat().st_size
    run = begin_run(path, tmp_path / "first", ["diffusion"])
    assert (run.stage("text") / "text.onnx").read_bytes() == (bundle.folder / "text.onnx").read_bytes()
    (tmp_path / "text" / "text.onnx").write_bytes(b"another one")
    with pytest.raises(ConfigError, match="without its sentence encoder; expected it in .*text, or in a bundle"):
        begin_run(path, tmp_path / "none", ["diffusion"])
    monkeypatch.setattr(module, "shipped_bundles", lambda: {"ours": bundle.folder})
    run = begin_run(path, tmp_path / "new", ["diffusion"])
    assert (run.stage("text") / "text.onnx").read_bytes() == (bundle.folder / "text.onnx").read_bytes()


def test_what_does_not_fit_is_refused_by_name(released: Path, trained: Run, tmp_path: Path) -> None:
    changed = trained.config.model_dump()
    changed["window"]["future"] = 40
    config = tmp_path / "other.yaml"
    config.write_text(yaml.safe_dump(changed))
    with pytest.raises(ConfigError, match=r"window.future is 32, asked for 40"):
        begin_run(released, tmp_path / "new", ["autoencoder"], str(config))
    with pytest.raises(ConfigError, match=r"no stage 'evaluator', expected one of: autoencoder, diffusion, distill"):
        begin_run(released, tmp_path / "new", ["evaluator"])
    with pytest.raises(ConfigError, match="did not begin from this file"):
        begin_run(released, trained.folder, ["autoencoder"])
    file = ReleaseFile(released)

    def written(**changes: object) -> Path:
        path = tmp_path / "changed.safetensors"
        tensors = {**file.tensors, **changes.pop("tensors", {})}
        write_release_file(file.header.model_copy(update=changes), tensors, path)
        return path

    with pytest.raises(ConfigError, match="field layout: 0000"):
        begin_run(written(layout="0000"), tmp_path / "new", ["autoencoder"])
    with pytest.raises(ConfigError, match=r"stage autoencoder: weights .* \(unfold.bias: \(7,\), expected"):
        begin_run(written(tensors={"autoencoder.unfold.bias": torch.zeros(7)}), tmp_path / "new", ["autoencoder"])
    assert not (tmp_path / "new").exists()


def test_files_that_are_no_release_are_refused(released: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no weights file there"):
        ReleaseFile(tmp_path / "none.safetensors")
    content = bytearray(released.read_bytes())
    content[-5] ^= 1
    (tmp_path / "changed.safetensors").write_bytes(content)
    with pytest.raises(ConfigError, match="changed: its content has SHA-256"):
        ReleaseFile(tmp_path / "changed.safetensors")
    (tmp_path / "cut.safetensors").write_bytes(content[:-100])
    with pytest.raises(ConfigError, match="damaged"):
        ReleaseFile(tmp_path / "cut.safetensors")
    save_file({"weight": torch.zeros(2)}, tmp_path / "other.safetensors")
    with pytest.raises(ConfigError, match="of another program"):
        ReleaseFile(tmp_path / "other.safetensors")
    newer = {METADATA: json.dumps({"schema_": "flexmotion.weights/2"})}
    save_file({"weight": torch.zeros(2)}, tmp_path / "newer.safetensors", metadata=newer)
    with pytest.raises(ConfigError, match="the file is too new"):
        ReleaseFile(tmp_path / "newer.safetensors")


def test_weights_that_are_not_finite_are_not_released(trained: Run, tmp_path: Path) -> None:
    copy = copytree(trained.folder, tmp_path / "copy")
    best = read_checkpoint(copy / "diffusion" / BEST)
    best["network"]["leave.bias"][0] = float("nan")
    write_checkpoint(best, copy / "diffusion" / BEST)
    with pytest.raises(ConfigError, match=r"leave\.bias: holds numbers that are not finite"):
        write_release(Run(copy), tmp_path / "bad.safetensors")


def test_a_release_of_a_training_that_is_still_running(
    trained: Run, stages, small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the autoencoder alone, before there is a sentence encoder."""
    copy = tmp_path / "copy"
    copytree(trained.folder, copy, ignore=lambda _, names: [name for name in names if name in ("text", "diffusion")])
    path = tmp_path / "now.safetensors"
    assert execute(["export", str(copy), "--weights", "-o", str(path), "--stages", "autoencoder"]) == 0
    assert "autoencoder at step" in " ".join(capsys.readouterr().out.split())  # lines are as wide as the terminal
    run = begin_run(path, tmp_path / "new", ["autoencoder"])
    assert not run.stage("text").exists() and ReleaseFile(path).header.text == {}
    expected = load_autoencoder(trained)
    load_weights(expected, run.stage("autoencoder"))
    assert execute(["export", str(copy), "--weights", "-o", str(path), "--stages", "diffusion"]) == 2
    assert "run 'flexmotion train diffusion' first" in capsys.readouterr().err
    assert execute(["export", str(copy), "--weights", "-o", str(path), "--stages", "decoder"]) == 2
    assert "expected one of: autoencoder, diffusion, distill, control, evaluator, text" in capsys.readouterr().err
