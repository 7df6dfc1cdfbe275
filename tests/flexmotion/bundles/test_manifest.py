"""Manifests: versions of the schema, corrections, and hashes of equivalent bundles."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest

from flexmotion.bundles.bundle import HASH_LENGTH, Bundle, sha256
from flexmotion.bundles.manifest import (
    CORRECTIONS_OF_3,
    MANIFEST,
    SCHEMA,
    equivalent_hashes,
    read_corrections,
    read_manifest,
    write_manifest,
)
from flexmotion.bundles.shipped import FOLDER
from flexmotion.configs.corrections import Corrections
from flexmotion.configs.errors import ConfigError
from flexmotion.features.layout import Layout
from flexmotion.sampling.pace import Pace
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.streamer.log.source import pack, unpack
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item

OF_0_1_0 = Path(__file__).parent / "data" / "manifest_4.json"
"""Manifest of the bundle that FlexMotion 0.1.0 shipped, in schema 4."""

HASH_OF_0_1_0 = "363bd437c93721c6"
"""Hash of that bundle in logs recorded before schema 4."""


def of_schema_7(folder: Path) -> tuple[Bundle, Bundle]:
    """Two copies of the shipped bundle, with corrections that schema 7 has: in the newest schema, and in schema 7."""
    corrections = {"aside": 1.5, "speeds": {"run": [2.3, 0.0, 0.0]}}
    rest = Corrections.model_validate(corrections).model_dump(
        exclude={"pose_noise", "guidance", "normal_guidance", "manner_speeds"}
    )
    write_manifest(changed(folder / "new", corrections=corrections).manifest, folder / "new" / MANIFEST)
    return Bundle(folder / "new"), changed(folder / "7", corrections=rest, schema_="flexmotion.bundle/7", personal=None)


def changed(folder: Path, **fields: Any) -> Bundle:
    """A copy of the shipped bundle with other fields in its manifest; a field that is None is left out."""
    copytree(FOLDER, folder)
    content = json.loads((folder / MANIFEST).read_text(encoding="utf-8")) | fields
    content = {name: value for name, value in content.items() if value is not None}
    text = json.dumps(content, indent=1, sort_keys=True, ensure_ascii=False) + "\n"
    (folder / MANIFEST).write_text(text, encoding="utf-8")
    return Bundle(folder)


def test_a_log_of_schema_3_names_the_bundle_in_the_newest_schema_too(tmp_path: Path) -> None:
    manifest = read_manifest(OF_0_1_0)
    assert manifest.schema_ == SCHEMA and manifest.corrections == CORRECTIONS_OF_3
    hashes = [found[:HASH_LENGTH] for found in equivalent_hashes(manifest)]
    assert hashes[-1] == HASH_OF_0_1_0 and len(set(hashes)) == 9  # in the schemas 11 to 3
    assert hashes[7] == sha256(OF_0_1_0)[:HASH_LENGTH]
    write_manifest(manifest, tmp_path / MANIFEST)
    assert read_manifest(tmp_path / MANIFEST) == manifest
    assert hashes[0] == sha256(tmp_path / MANIFEST)[:HASH_LENGTH]


def test_a_bundle_keeps_its_hashes_in_another_schema(tmp_path: Path) -> None:
    newest, former = of_schema_7(tmp_path)
    assert former.hash != newest.hash
    assert former.manifest == newest.manifest
    assert former.hash in newest.hashes and set(former.hashes) == set(newest.hashes)


def test_joint_contact_is_part_of_the_layout(tmp_path: Path) -> None:
    """Regression: a new field of the layout entered the hash of layouts without it, and a bundle was refused."""
    assert Layout(30.0, muscles=290).hash == "156da119297434f2" != Bundle(FOLDER).layout.hash
    with pytest.raises(ConfigError, match="made for layout"):
        changed(tmp_path / "other", joint_contact=False)


def test_former_schemas_describe_only_what_they_had() -> None:
    """An older release would sample another layout, or move otherwise, with such a bundle."""
    manifest = read_manifest(OF_0_1_0)
    assert len(equivalent_hashes(manifest)) == 9
    assert len(equivalent_hashes(manifest.model_copy(update={"joint_contact": True}))) == 7
    assert len(equivalent_hashes(manifest.model_copy(update={"manner": True}))) == 6
    assert len(equivalent_hashes(manifest.model_copy(update={"eight_bits": True}))) == 5
    assert len(equivalent_hashes(manifest.model_copy(update={"personal": {"like Ada": "person-1.onnx"}}))) == 4
    for new in (Corrections(turning=1.2), Corrections(travelling_noise=0.5), Corrections(ahead=((0.0, 0.1),))):
        assert len(equivalent_hashes(manifest.model_copy(update={"corrections": new}))) == 5
    held = {"corrections": Corrections(pose_noise=0.3)}
    assert len(equivalent_hashes(manifest.model_copy(update=held))) == 3
    for new in (Corrections(guidance={"bow": 2.0}), Corrections(normal_guidance=1.0)):
        assert len(equivalent_hashes(manifest.model_copy(update={"corrections": new}))) == 2
    speeds = {"corrections": Corrections(manner_speeds={"old": {"walk": (0.8, 0.0, 0.0)}})}
    assert len(equivalent_hashes(manifest.model_copy(update=speeds))) == 1


def test_another_correction_is_another_bundle(tmp_path: Path) -> None:
    other = changed(tmp_path / "other", corrections=CORRECTIONS_OF_3.model_dump() | {"aside": 1.4})
    assert not set(other.hashes) & set(Bundle(FOLDER).hashes)


def test_a_log_opens_with_the_bundle_of_its_run_only(tmp_path: Path) -> None:
    newest, former = of_schema_7(tmp_path)
    parts, _ = pack(ModelSource(Sampler(former), [Item(0.0, Text("walk"))], "walk"))
    assert parts["hash"] == former.hash != newest.hash
    reopened = unpack(parts | {"bundle": str(newest.folder)}, {}, Path("run.mcap"))
    assert isinstance(reopened, ModelSource) and reopened.sampler.bundle.folder == newest.folder
    changed(tmp_path / "other", corrections=None)
    with pytest.raises(ConfigError, match="not the bundle of the run"):
        unpack(parts | {"bundle": str(tmp_path / "other")}, {}, Path("run.mcap"))


@pytest.mark.parametrize(
    ("schema", "message"),
    [
        ("flexmotion.bundle/2", "of version 2, this release reads 3 to 11: the file is too old: export the bundle"),
        ("flexmotion.bundle/12", "bundle of version 12, this release reads 3 to 11: the file is too new: install"),
        ("flexmotion.motion/1", "no bundle: schema is 'flexmotion.motion/1', expected 'flexmotion.bundle/11'"),
        (7, "no bundle: schema is 7"),
    ],
)
def test_refusal_of_other_schemas_tells_what_to_do(tmp_path: Path, schema: object, message: str) -> None:
    path = tmp_path / MANIFEST
    path.write_text(json.dumps({"schema_": schema}), encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        read_manifest(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "damaged"),
        ("[]", "damaged .expected an object, found list"),
        (json.dumps({"schema_": SCHEMA, "corrections": {"aside": -1}}), "field"),
    ],
)
def test_damaged_manifests_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / MANIFEST
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        read_manifest(path)


def test_corrections_are_read_from_a_bundle_or_a_file(tmp_path: Path) -> None:
    assert read_corrections(FOLDER) == Bundle(FOLDER).manifest.corrections != Corrections()
    path = tmp_path / "corrections.yaml"
    path.write_text("aside: 1.5\nspeeds: {run: [2.3, 0, 0]}\n", encoding="utf-8")
    assert read_corrections(path) == Corrections(aside=1.5, speeds={"run": (2.3, 0.0, 0.0)})
    path.write_text("asides: 1.5\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"corrections\.yaml: field asides: unknown field, expected one of: standing"):
        read_corrections(path)
    path.write_text("catch_up: 0.3\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="catch_up 0.3 has no effect with catch_up_limit 0, expected a limit > 0"):
        read_corrections(path)
    with pytest.raises(ConfigError, match="no bundle there"):
        read_corrections(tmp_path)


def test_speeds_of_unknown_kinds_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"speeds\.runn: unknown kind, expected one of: .*bow, .*run, .*walk-turn-right, "
    ):
        changed(tmp_path / "other", corrections={"speeds": {"runn": [2.3, 0, 0]}})


def test_a_bundle_without_corrections_is_sampled_without_them(tmp_path: Path) -> None:
    plain, shipped = (Sampler(one) for one in (changed(tmp_path / "plain", corrections=None), Bundle(FOLDER)))
    assert plain.bundle.manifest.corrections == Corrections()
    history, slow = plain.standing(), Pace(ahead=0.5, back=0.4, aside=0.2, turning=1.0)
    # Words are not slowed where their speed is unknown; velocities are.
    assert plain.meant(Condition("walk forward", pace=slow)).velocity is None
    assert shipped.meant(Condition("walk forward", pace=slow)).velocity == (0.5, 0.0, 0.0)
    assert plain.meant(Condition(velocity=(1.0, 0.0, 0.0), pace=slow)).velocity == (0.5, 0.0, 0.0)
    # A motion without corrections is the same as decoded (its feet stay where words are known to be done on the spot).
    raised = Condition("raise your right hand", manner_guidance=1.0)
    for condition, same in ((raised, True), (Condition(), False), (Condition(velocity=(0, 0.2, 0)), False)):
        one, other = (sampler.features(history, condition, seed=1) for sampler in (plain, shipped))
        assert np.array_equal(one, other) == same
    velocity = plain._inputs["velocity"][0] * [plain.body.leg, plain.body.leg, 1.0]
    np.testing.assert_allclose(velocity, [0.0, 0.2, 0.0], atol=1e-6)


def test_forward_velocities_are_asked_for_by_the_bundles_table(tmp_path: Path) -> None:
    """A model that its words pull to one speed went .5 m/s where .3 were asked for."""
    table = ((-0.3, 0.1), (0.0, -0.1), (0.5, 0.2), (1.0, 0.9))
    corrected = Sampler(changed(tmp_path / "own", corrections={"ahead": table, "turning": 1.25}))
    for wanted, asked in ((0.0, -0.1), (0.25, 0.05), (0.75, 0.55), (1.2, 1.1), (-0.5, -0.1)):
        corrected.sample(corrected.standing(), Condition(velocity=(wanted, 0.0, 0.2 if wanted == 0.0 else 0.0)), seed=1)
        assert corrected._inputs["velocity"][0, 0] * corrected.body.leg == pytest.approx(asked, abs=0.01)
        assert corrected._inputs["velocity"][0, 2] == pytest.approx(0.25 if wanted == 0.0 else 0.0)


def test_a_table_of_forward_velocities_grows() -> None:
    with pytest.raises(ValueError, match=r"\[0\.5, 0\.2\], expected growing"):
        Corrections(ahead=((0.5, 0.4), (0.2, 0.1)))
