"""The bundle of a person: the model before, bit for bit, and a network that the person's manner alone uses."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.card import CARD
from flexmotion.bundles.manifest import equivalent_hashes
from flexmotion.bundles.repertoire import offered_kinds, offered_manners, write_judged
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.judged import Judged
from flexmotion.features.constraints import Constraints
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.streamer.cli import execute
from flexmotion.training import own_samples
from flexmotion.training.checkpoints import BEST, read_checkpoint, write_checkpoint
from flexmotion.training.export import export
from flexmotion.training.listener_training import refit_listener
from flexmotion.training.personal import impersonal, persons
from flexmotion.training.personal_export import export_bundle
from flexmotion.training.release import write_release
from flexmotion.training.run import Run

ADA, BOB = "like Ada", "like Bob"


def personalised(training: Path, data: Path, manner: str, out: Path) -> Run:
    """A training with a person, and its student."""
    assert execute(["personalize", str(training), "--set", str(data), "--manner", manner, "-o", str(out), *STEPS]) == 0
    assert execute(["train", "distill", "-o", str(out), *STEPS]) == 0
    return Run(out)


STEPS = ["--steps", "2"]


@pytest.fixture(scope="module")
def ada(trained: Run, small_set: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The trained run, personalised."""
    return personalised(trained.folder, small_set, ADA, tmp_path_factory.mktemp("personal") / "ada")


@pytest.fixture(scope="module")
def hers(ada: Run, tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """Its bundle."""
    return export_bundle(ada, tmp_path_factory.mktemp("bundles") / "ada", distilled=True)


def same(one: Motion, other: Motion) -> bool:
    return np.array_equal(one.joints, other.joints) and np.array_equal(one.root_position, other.root_position)


CONDITIONS = (
    Condition("walk"),
    Condition("turn left"),
    Condition(),
    Condition(velocity=(0.5, 0.0, 0.1)),
    Condition("walk like an old man"),
    Condition("walk like Anna"),
    Condition(velocity=(0.4, 0.0, 0.0), wordless=True, manner=ADA),  # says nothing, in words or manner
)


def test_what_is_not_asked_in_the_persons_manner_is_the_model_before(bundle: Bundle, hers: Bundle) -> None:
    """Regression: one network served both, and its student was distilled anew: the rest moved by 7.5 cm."""
    before, after = bundle.manifest.files, hers.manifest.files
    assert {name for name in after if after[name] != before.get(name)} == {"arrays.npz", "person-1.onnx"}
    for name, values in bundle.arrays.items():
        kept = hers.arrays[name]
        np.testing.assert_array_equal(kept[: len(values)] if name.startswith("manner_") else kept, values)
    old, new = Sampler(bundle), Sampler(hers)
    for seed, condition in enumerate(CONDITIONS):
        assert same(*(own.sample(own.standing(), condition, seed) for own in (old, new))), condition


def test_the_persons_manner_has_its_own_network_in_words_and_velocities(bundle: Bundle, hers: Bundle) -> None:
    assert list(hers.personal) == [ADA] and hers.manners.names[-1] == ADA
    old, new = Sampler(bundle), Sampler(hers)
    walking = new.sample(new.standing(), Condition("walk like Ada"), 1)
    assert not same(old.sample(old.standing(), Condition("walk"), 1), walking)
    assert same(new.sample(new.standing(), Condition("walk", manner=ADA), 1), walking)
    plain, in_manner = (Condition(velocity=(0.5, 0.0, 0.0), manner=manner) for manner in (None, ADA))
    assert not same(*(new.sample(new.standing(), condition, 1) for condition in (plain, in_manner)))


def test_a_manner_can_change_from_window_to_window_and_back(bundle: Bundle, hers: Bundle) -> None:
    """The network follows the request: nothing of the person's stays in the sampler."""
    new = Sampler(hers)
    first = new.sample(new.standing(), Condition("walk"), 1)
    new.sample(first, Condition("walk like Ada"), 2)
    old = Sampler(bundle)
    assert same(new.sample(first, Condition("walk"), 3), old.sample(first, Condition("walk"), 3))


def test_a_persons_network_is_ready_before_it_is_asked_for(hers: Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    """A live planner would pause while it is opened."""
    sampler = Sampler(hers)
    monkeypatch.setattr("flexmotion.sampling.sampler.open_session", lambda path: pytest.fail(f"opened {path}"))
    sampler.sample(sampler.standing(), Condition("walk like Ada"), 1)


def test_the_model_without_a_student_has_the_person_too(undistilled: Bundle, ada: Run, tmp_path: Path) -> None:
    after = export_bundle(ada, tmp_path / "after", distilled=False)
    old, new = Sampler(undistilled, 2), Sampler(after, 2)
    assert same(*(own.sample(own.standing(), Condition("walk"), 1) for own in (old, new)))
    assert not same(
        *(own.sample(own.standing(), Condition(f"walk{how}"), 1) for own, how in ((old, ""), (new, f" {ADA}")))
    )


def test_a_person_is_added_to_a_bundle_that_keeps_what_its_judges_said(
    bundle: Bundle, ada: Run, tmp_path: Path
) -> None:
    copytree(bundle.folder, tmp_path / "judged")
    passed, failed = (Judged(judge="test", samples=9, share=share, least=0.5) for share in (1.0, 0.0))
    kinds = dict.fromkeys(bundle.prompts.kinds, passed) | {"walk": failed}
    judged = write_judged(Bundle(tmp_path / "judged"), kinds=kinds, manners=dict.fromkeys(bundle.manners.names, failed))
    command = ["export", str(ada.folder), "--onto", str(judged.folder), "-o", str(tmp_path / "out")]
    assert execute(command) == 0
    made = Bundle(tmp_path / "out")
    assert made.manifest.repertoire == judged.manifest.repertoire and "walk" not in offered_kinds(made)
    assert offered_manners(made) == ("normal", ADA)  # no judge knows a person's
    assert made.manifest.body == judged.manifest.body
    card = (tmp_path / "out" / CARD).read_text(encoding="utf-8")
    assert "**like Ada**" in card and judged.hash in card
    assert execute([*command[:4], str(made.folder), "-o", str(tmp_path / "twice")]) == 2  # knows her already
    assert execute([*command, "--eight-bits"]) == 2
    assert execute([*command[:-1], str(judged.folder)]) == 2  # which is to stay as it is
    assert Bundle(judged.folder).hash == judged.hash


def test_a_bundle_of_another_model_is_refused(
    bundle: Bundle, undistilled: Bundle, ada: Run, trained: Run, tmp_path: Path
) -> None:
    """The person's latents would be decoded by a decoder that never saw their like."""
    with pytest.raises(ConfigError, match="is of the diffusion; export it anew"):
        export_bundle(ada, tmp_path / "out", distilled=True, onto=undistilled)
    copytree(trained.folder, tmp_path / "other")
    weights = Run(tmp_path / "other")
    for stage in ("autoencoder", "forces"):
        best = read_checkpoint(weights.stage(stage) / BEST)
        best["network"] = {name: 1.5 * value for name, value in best["network"].items()}
        write_checkpoint(best, weights.stage(stage) / BEST)
    other = export(weights, tmp_path / "stretched", distilled=True)
    with pytest.raises(ConfigError, match=r"not of the model that .* began from \(decoders differ\)"):
        export_bundle(ada, tmp_path / "out", distilled=True, onto=other)
    assert not (tmp_path / "out").exists()
    with pytest.raises(ConfigError, match="is not personalised"):
        export_bundle(trained, tmp_path / "out", distilled=True, onto=bundle)


def test_two_persons_live_beside_each_other(
    bundle: Bundle, hers: Bundle, ada: Run, small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second one is fine-tuned on the model before the first: neither changes the other."""
    bob = personalised(ada.folder, small_set, BOB, tmp_path / "bob")
    assert persons(bob) == (ADA, BOB) and impersonal(bob).folder == impersonal(ada).folder
    both = export_bundle(bob, tmp_path / "both", distilled=True)
    assert list(both.personal) == [ADA, BOB] and both.manners.names[-2:] == (ADA, BOB)
    files = both.manifest.files
    assert files["person-1.onnx"] == hers.manifest.files["person-1.onnx"] != files["person-2.onnx"]
    old, new, one = Sampler(bundle), Sampler(both), Sampler(hers)
    assert same(*(own.sample(own.standing(), Condition("walk"), 1) for own in (old, new)))
    assert same(*(own.sample(own.standing(), Condition("walk like Ada"), 1) for own in (one, new)))
    assert not same(*(new.sample(new.standing(), Condition(f"walk {who}"), 1) for who in (ADA, BOB)))
    again = ["personalize", str(ada.folder), "--set", str(small_set), "--manner", "like ada"]
    assert execute([*again, "-o", str(tmp_path / "again")]) == 2
    assert "knows that person already" in capsys.readouterr().err
    # A bundle with one person less, in the same folder, leaves no network behind.
    export_bundle(ada, both.folder, distilled=True)
    assert not (both.folder / "person-2.onnx").exists()


def test_a_persons_bundle_of_a_weights_file_has_the_student_beside_it(
    trained: Run,
    small_set: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The student lies in a file of its own, found by the digest of what it was distilled from."""
    monkeypatch.setattr(own_samples, "ROLL_OUTS", 16)
    base, student = tmp_path / "base.safetensors", tmp_path / "student.safetensors"
    write_release(trained, base, stages=["autoencoder", "diffusion", "text"])
    write_release(trained, student, stages=["distill"])
    personalised(base, small_set, ADA, tmp_path / "ada")
    (tmp_path / "ada").rename(tmp_path / "moved")  # with what it began from, which is in it
    assert execute(["export", str(base), "-o", str(tmp_path / "before")]) == 0
    assert execute(["export", str(tmp_path / "moved"), "-o", str(tmp_path / "after")]) == 0
    before, after = Bundle(tmp_path / "before").manifest.files, Bundle(tmp_path / "after").manifest.files
    assert {name for name in after if after[name] != before.get(name)} == {"arrays.npz", "person-1.onnx"}
    # A weights file of hers lacks the model before, which is found beside it by the hash that hers names.
    file, alone = tmp_path / "ada.safetensors", tmp_path / "alone"
    assert execute(["export", str(tmp_path / "moved"), "--weights", "-o", str(file)]) == 0
    assert execute(["export", str(file), "-o", str(tmp_path / "again")]) == 0
    assert Bundle(tmp_path / "again").manifest.files["person-1.onnx"]
    assert Bundle(tmp_path / "again").manifest.files["denoiser.onnx"] == before["denoiser.onnx"]
    alone.mkdir()
    file.rename(alone / file.name)
    capsys.readouterr()
    assert execute(["export", str(alone / file.name), "-o", str(tmp_path / "none")]) == 2
    assert "ada.safetensors: is personalised, and lacks the model before" in capsys.readouterr().err.replace("\n", " ")
    onto = ["--onto", str(tmp_path / "before"), "-o", str(tmp_path / "onto")]
    assert execute(["export", str(alone / file.name), *onto]) == 0
    assert Bundle(tmp_path / "onto").manifest.personal == {ADA: "person-1.onnx"}


def test_a_training_that_is_gone_is_named(ada: Run, tmp_path: Path) -> None:
    copytree(ada.folder, tmp_path / "deeper" / "ada", symlinks=True)
    with pytest.raises(
        ConfigError, match="is not there; run 'flexmotion personalize' again with it, or export with --onto"
    ):
        export_bundle(Run(tmp_path / "deeper" / "ada"), tmp_path / "out", distilled=True)
    with pytest.raises(ConfigError, match="no bundle without the model before"):
        export(ada, tmp_path / "out", distilled=True)


def test_constraints_in_a_persons_manner_use_the_branch_on_her_own_network(
    controlled: Any, small_set: Path, tmp_path: Path
) -> None:
    """The branch on the network before would answer in a manner that is not hers; without it hands were 4 cm off."""
    run = personalised(controlled[0].folder, small_set, ADA, tmp_path / "ada")
    made = export_bundle(run, tmp_path / "bundle", distilled=True)
    own, usual = made.control(ADA), made.control("normal")
    assert own == made.folder / "person-1-control.onnx" and usual == made.folder / "control.onnx"
    sampler = Sampler(made)
    none = Constraints.none(sampler.layout, sampler.body, sampler.future)
    asked = none.path(slice(None), np.zeros((sampler.future, 2)))
    for manner, network in ((ADA, own), (None, usual)):
        sampler._branches.clear()
        kept = sampler.sample(sampler.standing(), Condition("walk", manner=manner, constraints=asked), 1)
        assert list(sampler._branches) == [network]
        assert not same(kept, sampler.sample(sampler.standing(), Condition("walk", manner=manner), 1))
    # Nor is a branch trained that would not be used.
    assert execute(["train", "control", "-o", str(run.folder)]) == 2
    # A bundle without the branch of a person keeps constraints by corrections, and torques where windows are balanced.
    (run.folder / "before").unlink()
    before = export(controlled[0], tmp_path / "before", distilled=True)
    lacks = export_bundle(run, tmp_path / "lacks", distilled=True, onto=before)
    assert lacks.has_control and lacks.control(ADA) is None
    sampler = Sampler(lacks)
    sampler.sample(sampler.standing(), Condition("walk like Ada", constraints=asked), 1)
    assert not sampler._branches
    plain, limit = Sampler(lacks, balanced=False), none.torque_limit("knee_flexion_r", slice(None), 20.0)
    plain.sample(plain.standing(), Condition("walk", constraints=limit), 1)
    with pytest.raises(ValueError, match="torque_limits: model stream has no control branch in this manner"):
        plain.sample(plain.standing(), Condition("walk like Ada", constraints=limit), 1)


def test_a_listener_that_is_fitted_again_keeps_the_person(hers: Bundle, tmp_path: Path) -> None:
    taught = refit_listener(hers, tmp_path / "taught", [("walk", "mop the floor"), ("walk", "mop the hall")])
    assert list(taught.personal) == [ADA]
    sampler = Sampler(taught)
    assert sampler.prompt("walk like Ada").manner == ADA
    assert same(*(own.sample(own.standing(), Condition("walk", manner=ADA), 1) for own in (Sampler(hers), sampler)))


def test_bundles_lists_the_persons(hers: Bundle, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["bundles", str(hers.folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["persons"] == [ADA]
    assert execute(["bundles", str(hers.folder)]) == 0
    assert "of persons, by networks of their own: like Ada" in capsys.readouterr().out


def test_an_earlier_schema_cannot_describe_a_person(bundle: Bundle, hers: Bundle) -> None:
    """An earlier release would use the one network for all."""
    assert len(equivalent_hashes(hers.manifest)) == 4 < len(equivalent_hashes(bundle.manifest))  # schemas 11 to 8


def test_a_person_without_a_network_is_refused(hers: Bundle, tmp_path: Path) -> None:
    copytree(hers.folder, tmp_path / "copy")
    path = tmp_path / "copy" / "manifest.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(content | {"personal": {ADA: "person-7.onnx"}}), encoding="utf-8")
    with pytest.raises(ConfigError, match="'like Ada': its network 'person-7.onnx' or its embedding is missing"):
        Bundle(tmp_path / "copy")
