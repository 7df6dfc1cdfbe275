"""The listener of a finished model is fitted again, with sentences of one's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sklearn")

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.card import CARD
from flexmotion.bundles.shipped import FOLDER
from flexmotion.configs.errors import ConfigError
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.cli import execute
from flexmotion.training.listener_training import refit_listener

NEAR, FAR_SHARE = 0.02, 0.005
"""Another processor rounds otherwise, and the fit ends elsewhere: .13 % of the weights were off by up to .12."""

OURS = "walk: [mop the floor, mop the hall, mop the kitchen, start mopping]\n"


def are_alike(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether two fits have the same weights but for the rounding of processors; other values have to be equal."""
    if before.dtype.kind != "f" or before.shape != after.shape:
        return np.array_equal(before, after)
    return float(np.mean(np.abs(before.astype(np.float64) - after) > NEAR)) < FAR_SHARE


def test_own_sentences_are_understood_and_nothing_else_changes(tmp_path: Path) -> None:
    ours, out = tmp_path / "ours.yaml", tmp_path / "taught"
    ours.write_text(OURS)
    assert execute(["train", "listener", str(FOLDER), "--sayings", str(ours), "-o", str(out)]) == 0
    before, after = Bundle(FOLDER), Bundle(out)
    files = before.manifest.files, after.manifest.files
    assert {name for name in files[0] if files[0][name] != files[1][name]} == {"arrays.npz"}
    others = {name for name in before.arrays if not name.startswith("listener_")}
    assert all(are_alike(before.arrays[name], after.arrays[name]) for name in others)
    assert not Sampler(before).prompt("please mop the bathroom").known
    assert Sampler(after).prompt("please mop the bathroom").kind == "walk"
    assert "Listener fitted again with 4 more sentences" in (out / CARD).read_text(encoding="utf-8")
    assert Sampler(after).prompt("would you step over to your left").kind == "walk-left"


def test_the_shipped_listener_is_that_of_the_shipped_sayings(tmp_path: Path) -> None:
    assert execute(["train", "listener", str(FOLDER), "-o", str(tmp_path / "again")]) == 0
    before, after = Bundle(FOLDER).arrays, Bundle(tmp_path / "again").arrays
    assert before["listener_kinds"].tolist() == after["listener_kinds"].tolist()
    assert before["listener_pieces"].tolist() == after["listener_pieces"].tolist()
    assert are_alike(before["listener_weights"], after["listener_weights"])


def test_a_copy_is_complete_or_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("flexmotion.training.listener_training.fit_listener", lambda *_: {})  # takes seconds
    monkeypatch.setattr("flexmotion.bundles.bundle.np.savez_compressed", full)
    assert execute(["train", "listener", str(FOLDER), "-o", str(tmp_path / "taught")]) == 2
    assert not list(tmp_path.iterdir())


def test_a_bundle_with_a_personal_manner_is_refused(tmp_path: Path) -> None:
    """A bundle has no sentences: fitted again, its listener would no longer know "like Ada"."""
    bundle = Bundle(FOLDER)
    bundle.arrays["listener_kinds"] = np.array([*bundle.listener.kinds[:-1], "personal"])
    with pytest.raises(ConfigError, match="personal"):
        refit_listener(bundle, tmp_path / "taught")


def test_sentences_that_cannot_be_learnt_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ours, full = tmp_path / "ours.yaml", tmp_path / "full"
    ours.write_text("sit: [take a seat]\n")
    assert execute(["train", "listener", str(FOLDER), "--sayings", str(ours), "-o", str(tmp_path / "out")]) == 2
    assert "'take a seat' is of kind 'sit'; the model knows arms-forward, " in capsys.readouterr().err
    ours.write_text("walk: [go to the bus stop]\n")
    assert execute(["train", "listener", str(FOLDER), "--sayings", str(ours), "-o", str(tmp_path / "out")]) == 2
    assert "forbids a motion" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    full.mkdir()
    (full / "diary.txt").write_text("mine")
    assert execute(["train", "listener", str(FOLDER), "-o", str(full)]) == 2
    assert "not empty" in capsys.readouterr().err
    assert execute(["train", "listener", str(FOLDER), "-o", str(FOLDER / "taught")]) == 2
    assert "lies in the bundle itself" in capsys.readouterr().err
    assert execute(["train", "listener", str(tmp_path / "none"), "-o", str(tmp_path / "out")]) == 2
    assert "no bundle there" in capsys.readouterr().err
