"""Exported networks compute what torch computes, and the sampler takes the bundle."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.bundles.bundle import DECODER, DENOISER, Bundle  # noqa: E402
from flexmotion.bundles.card import CARD  # noqa: E402
from flexmotion.bundles.manifest import read_corrections  # noqa: E402
from flexmotion.bundles.shipped import FOLDER  # noqa: E402
from flexmotion.configs.corrections import Corrections  # noqa: E402
from flexmotion.configs.errors import ConfigError  # noqa: E402
from flexmotion.human.kinematics import forward  # noqa: E402
from flexmotion.sampling.sampler import Condition, Sampler  # noqa: E402
from flexmotion.streamer.cli import execute  # noqa: E402
from flexmotion.training.export import Decoder, denoiser_inputs, load_networks  # noqa: E402
from flexmotion.training.export_onnx import export_network  # noqa: E402
from flexmotion.training.half_weights import halve_weights  # noqa: E402
from flexmotion.training.run import Run  # noqa: E402


def test_exported_networks_compute_what_torch_computes(trained: Run, bundle: Bundle) -> None:
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
        "manner": draw(1, trained.config.diffusion.text),
        "present": np.ones((1, 3), np.float32),
        "guidance": np.array([[2.0, 1.5]], np.float32),
    }
    with torch.no_grad():
        clean = denoiser(*map(torch.from_numpy, inputs.values())).numpy()
        frames = Decoder(autoencoder, denoiser)(torch.from_numpy(clean), torch.from_numpy(inputs["history"])).numpy()
    (found,) = onnxruntime.InferenceSession(str(bundle.folder / DENOISER)).run(None, inputs)
    assert found == pytest.approx(clean, abs=1e-3)
    decoding = {"latent": clean, "history": inputs["history"]}
    (found,) = onnxruntime.InferenceSession(str(bundle.folder / DECODER)).run(None, decoding)
    assert found == pytest.approx(frames, abs=1e-3)


def test_the_same_network_is_written_as_the_same_bytes(trained: Run, bundle: Bundle, tmp_path: Path) -> None:
    """Bundles are compared by the hashes of their files."""
    autoencoder, denoiser = load_networks(trained, distilled=True)
    inputs = denoiser_inputs(trained, autoencoder.latent, distilled=True)
    export_network(denoiser, tmp_path / DENOISER, inputs, ["clean"])
    halve_weights(tmp_path / DENOISER)
    assert (tmp_path / DENOISER).read_bytes() == (bundle.folder / DENOISER).read_bytes()


def test_the_sampler_takes_the_bundle(bundle: Bundle) -> None:
    sampler = Sampler(bundle)
    history = sampler.standing()
    first = sampler.sample(history, Condition("walk forward"), seed=1)
    assert len(first) == sampler.future and first.fps == sampler.fps and first.body == sampler.body
    again = sampler.sample(history, Condition("walk forward"), seed=1)
    np.testing.assert_array_equal(first.joints, again.joints)
    other = sampler.sample(history, Condition("walk forward"), seed=2)
    assert np.abs(other.joints - first.joints).max() > 1e-6
    assert first.torques is not None and first.wrenches is not None and first.contacts is not None
    # The second motion continues the first.
    second = sampler.sample(first, Condition(velocity=(0.5, 0.0, 0.2)), seed=1)
    assert np.abs(second.joints[0] - first.joints[-1]).max() < np.pi
    assert forward(second).com.shape == (sampler.future, 3)


def test_a_manner_changes_the_sample_and_its_absence_is_the_normal_one(bundle: Bundle) -> None:
    """Regression: the styles of all clips leaked into every prompt, since the normal manner could not be asked for."""
    sampler = Sampler(bundle)
    assert set(sampler.requests.manners) == {
        "normal",
        "energetic",
    }  # `happy` is held out: no clip of the training shows it
    history, turn = sampler.standing(), "turn left"
    plain, normal, energetic = (
        sampler.features(history, condition, seed=1)
        for condition in (Condition(turn), Condition(turn, manner="normal"), Condition(turn, manner="energetic"))
    )
    np.testing.assert_array_equal(plain, normal)
    assert np.abs(energetic - normal).max() > 1e-6
    said = sampler.features(history, Condition(f"{turn} energetically"), seed=1)
    assert np.abs(said - normal).max() > 1e-6
    stronger = sampler.features(history, Condition(turn, manner="energetic", manner_guidance=3.0), seed=1)
    assert np.abs(stronger - energetic).max() > 1e-6
    with pytest.raises(ConfigError, match="manner 'happy': model stream knows energetic, normal"):
        sampler.sample(history, Condition(turn, manner="happy"), seed=1)


def test_manners_and_kinds_that_no_clip_shows_are_named(bundle: Bundle) -> None:
    sampler = Sampler(bundle)
    prompt = sampler.prompt("turn left happily")
    assert prompt.manner == "normal" and prompt.dropped == ("happily",)
    assert "bow" not in sampler.requests.reader.offered and "walk-turn-right" in sampler.requests.reader.offered
    assert {"bow", "salute-left-hand"} < set(bundle.listener.kinds)  # heard, and refused by name


def test_the_sampler_refuses_unusable_histories(bundle: Bundle, make_standing) -> None:
    sampler = Sampler(bundle)
    with pytest.raises(ValueError, match="no frames"):
        sampler.sample(sampler.standing()[:0], Condition(), 0)
    with pytest.raises(ValueError, match="fps"):
        sampler.sample(make_standing(8, sampler.body, fps=25.0), Condition(), 0)
    with pytest.raises(ConfigError, match="steps is 0"):
        Sampler(bundle, steps=0)


def test_a_bundle_that_does_not_match_is_refused(bundle: Bundle, tmp_path: Path) -> None:
    from shutil import copytree

    copy = copytree(bundle.folder, tmp_path / "copy")
    with (copy / DENOISER).open("ab") as file:
        file.write(b"x")
    with pytest.raises(ConfigError, match="differs from the manifest"):
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


def test_corrections_are_named_at_the_export(trained: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Regression: a model that was exported again lost its corrections, without a word."""
    missing = "no corrections: words are not slowed to a robot's pace"
    export = ["export", str(trained.folder), "-o", str(tmp_path / "bundle")]
    assert execute(export) == 0
    assert missing in capsys.readouterr().err
    assert read_corrections(tmp_path / "bundle") == Corrections()
    unknown = tmp_path / "unknown.yaml"
    unknown.write_text("speeds: {runn: [2, 0, 0]}\n", encoding="utf-8")
    assert execute([*export, "--corrections", str(unknown)]) == 2
    assert "speeds.runn: unknown kind" in capsys.readouterr().err
    assert execute([*export, "--corrections", str(FOLDER)]) == 0
    assert missing not in capsys.readouterr().err
    # Speeds of manners that the model does not know are left out.
    given, made = read_corrections(FOLDER), Bundle(tmp_path / "bundle")
    speeds = {manner: own for manner, own in given.manner_speeds.items() if manner in made.manners.names}
    expected = given.model_copy(update={"manner_speeds": speeds})
    assert made.manifest.corrections == expected != Corrections() and len(speeds) < len(given.manner_speeds)
    assert "--corrections CORRECTIONS" in (tmp_path / "bundle" / CARD).read_text(encoding="utf-8")
