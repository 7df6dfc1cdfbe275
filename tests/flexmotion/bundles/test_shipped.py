"""Bundles that come with the package, by name."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

import pytest

import flexmotion.bundles.shipped as shipped
from flexmotion.bundles.bundle import Bundle
from flexmotion.configs.errors import ConfigError
from flexmotion.human.kinematics import forward
from flexmotion.sampling.condition import Condition
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.cli import execute


@pytest.fixture
def two(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A second bundle, `free`, beside the default one."""
    if shipped.shipped_bundle() is None:
        pytest.skip("this installation comes without a bundle")
    copytree(shipped.FOLDER, tmp_path / "free")
    monkeypatch.setattr(shipped, "NAMED", tmp_path)
    return tmp_path / "free"


def test_a_bundle_is_chosen_by_name_or_folder(two: Path, tmp_path: Path) -> None:
    assert shipped.shipped_bundles() == {"default": shipped.FOLDER, "free": two}
    assert shipped.bundle_folder("free") == two == shipped.bundle_folder(two)
    assert shipped.bundle_folder("default") == shipped.FOLDER
    assert shipped.shipped_name(two) == "free" and shipped.shipped_name(tmp_path) is None
    with pytest.raises(ConfigError, match=r"nor one of: default, free"):
        shipped.bundle_folder(tmp_path / "none")


def test_bundles_are_listed_with_repertoire_and_licence(two: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["bundles"]) == 0
    listed = " ".join(capsys.readouterr().out.split())
    assert "default:" in listed and "free:" in listed
    assert "walk-turn-left" in listed and "CC BY-NC 4.0" in listed


def test_a_bundle_in_a_folder_is_listed_too(two: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A refusal names six motions and sends to `flexmotion bundles` for the others, which knew shipped ones alone."""
    for name in (str(two), "free"):
        assert execute(["bundles", name]) == 0
        listed = " ".join(capsys.readouterr().out.split())
        assert "walk-turn-left" in listed and "default:" not in listed
    assert execute(["bundles", "nobody"]) == 2


def test_the_free_bundle_allows_products_and_refuses_what_it_lacks_by_name() -> None:
    """Its clips show no wave."""
    if "free" not in shipped.shipped_bundles():
        pytest.skip("this installation comes without it")
    sampler = Sampler(Bundle(shipped.bundle_folder("free")))
    assert "NC" not in sampler.bundle.manifest.licence and "commercial products" in sampler.bundle.manifest.licence
    refused, heard = sampler.prompt("wave with your right hand"), sampler.prompt("give me a salute")
    assert refused.warning is not None and "cannot wave with the right hand" in refused.warning
    assert heard.kind == "salute-right-hand" and heard.warning is None
    sampled = sampler.sample(sampler.standing(), Condition("salute"), 0)
    human = forward(sampled)
    assert human.hand[-1, 1, 2] > human.shoulder[-1, 1, 2] > human.hand[-1, 0, 2]
