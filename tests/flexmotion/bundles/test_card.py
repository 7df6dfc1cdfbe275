"""Content of model cards."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexmotion.bundles.card import CARD, Making, Trained, add_figures, write_card
from flexmotion.bundles.manifest import MANIFEST, SCHEMA, BodySize, Manifest, read_manifest
from flexmotion.bundles.shipped import FOLDER
from flexmotion.configs.corrections import Corrections


@pytest.fixture
def card(tmp_path: Path) -> Path:
    manifest = Manifest(
        schema_=SCHEMA,
        name="stream",
        layout="0",
        fps=30.0,
        muscles=0,
        history=8,
        future=32,
        latent=16,
        steps=2,
        times=1000,
        guided=True,
        guidance=2.5,
        velocity=True,
        body=BodySize(height=1.75, mass=70.0, sex="male", segments={}),
        licence="CC BY-NC 4.0",
    )
    stages = {
        "autoencoder": Trained(2100, 1, 64, 2000, {"loss": 0.96}),
        "diffusion": Trained(9000, 2, 64, 9000, {"loss": 0.25}),
        "distill": Trained(1500, 2, 64, 1500, {"loss": 0.01}),
        "forces": Trained(7000, 1, 64, 7000, {"loss": 0.9}),
    }
    write_card(tmp_path, manifest, Making("stream", 6.6, 4992, 3, stages))
    return tmp_path / CARD


def test_the_card_has_the_commands_that_reproduce_the_bundle(card: Path) -> None:
    text = card.read_text(encoding="utf-8")
    assert text.split("```")[1].strip().splitlines() == [
        "flexmotion train autoencoder --set SET --config stream --seed 3 --steps 2100 -o TRAINING",
        "flexmotion train text -o TRAINING",
        "torchrun --nproc-per-node 2 -m flexmotion.streamer train diffusion --steps 9000 -o TRAINING",
        "torchrun --nproc-per-node 2 -m flexmotion.streamer train distill --steps 1500 -o TRAINING",
        "flexmotion train forces --steps 7000 -o TRAINING",
        "flexmotion export TRAINING -o BUNDLE",
    ]
    assert "CC BY-NC 4.0" in text and "| diffusion | 9000 | 2 x 64 | 9000 | loss 0.25 |" in text


def test_figures_replace_earlier_ones(card: Path) -> None:
    before = card.read_text(encoding="utf-8")
    for distance in (0.5, 0.3):
        add_figures(card.parent, f"| metric | real | bundle |\n|---|---|---|\n| fid | 0.1 | {distance} |\n")
    text = card.read_text(encoding="utf-8")
    assert text.startswith(before.rstrip())
    assert text.count("| metric | real | bundle |") == 1
    assert "| fid | 0.1 | 0.3 |" in text and "0.5" not in text.removeprefix(before.rstrip())


def test_corrections_are_listed_where_there_are_any(card: Path) -> None:
    assert "## Corrections" not in card.read_text(encoding="utf-8")
    corrections = Corrections(aside=1.5, speeds={"walk": (1.3, 0.0, 0.0)})
    changes = {"corrections": corrections, "eight_bits": False}
    manifest = read_manifest(FOLDER / MANIFEST).model_copy(update=changes)
    write_card(card.parent, manifest, Making("stream", 6.6, 4992, 3, {}))
    text = card.read_text(encoding="utf-8")
    assert "flexmotion export TRAINING -o BUNDLE --diffusion --corrections CORRECTIONS\n" in text
    assert text.index("| stage |") < text.index("Versions:") < text.index("## Corrections")
    assert "- `aside`: 1.5\n" in text and "'walk': (1.3, 0.0, 0.0)" in text
