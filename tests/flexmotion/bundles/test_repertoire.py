"""A bundle offers what its judges passed, and refuses the rest by name."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.manifest import MANIFEST, write_manifest
from flexmotion.bundles.repertoire import offered_kinds, offered_manners, write_judged
from flexmotion.bundles.shipped import FOLDER
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.judged import Judged
from flexmotion.sampling.sampler import Sampler


def judged(share: float) -> Judged:
    return Judged(judge="model/prompts", samples=60, share=share, least=0.85)


@pytest.fixture
def copy(tmp_path: Path) -> Bundle:
    """The shipped bundle before it was judged."""
    bundle = Bundle(copytree(FOLDER, tmp_path / "bundle"))
    write_manifest(bundle.manifest.model_copy(update={"repertoire": None}), bundle.folder / MANIFEST)
    return Bundle(bundle.folder)


def test_a_bundle_that_was_not_judged_offers_all_of_its_training(copy: Bundle) -> None:
    assert set(offered_kinds(copy)) == set(copy.prompts.kinds)
    assert offered_manners(copy) == copy.manners.names


def test_what_did_not_pass_is_refused_by_name(copy: Bundle) -> None:
    """Regression: kicks and slashes were offered, and no judge had ever seen them."""
    before = copy.hash
    found = write_judged(copy, kinds={"walk": judged(0.98), "bow": judged(0.4)})
    assert offered_kinds(found) == ("stand", "walk") and found.hash != before
    refused = Sampler(found).prompt("bow")
    assert not refused.known and refused.refused == "bow"
    assert "this model cannot bow yet, it stands still; try: " in str(refused.warning)
    assert str(refused.warning).endswith("; it can: stand, walk")
    assert Sampler(found, unjudged=True).prompt("bow").kind == "bow"
    later = write_judged(found, kinds={"bow": judged(0.9)})
    assert offered_kinds(later) == ("stand", "walk", "bow")
    assert later.manifest.repertoire is not None and later.manifest.repertoire.manners is None


def test_figures_of_what_the_bundle_does_not_know_are_refused(copy: Bundle) -> None:
    with pytest.raises(ConfigError, match="kind 'swim' was judged, but the bundle knows "):
        write_judged(copy, kinds={"swim": judged(1.0)})
    with pytest.raises(ConfigError, match="manner 'icy' was judged, but the bundle knows "):
        write_judged(copy, manners={"icy": judged(1.0)})
