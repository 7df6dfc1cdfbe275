"""Files of a training that are too old, too new, damaged, or of another network."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
import yaml

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.bundles.manifest import CORRECTIONS_OF_3  # noqa: E402
from flexmotion.configs.corrections import Corrections  # noqa: E402
from flexmotion.configs.errors import ConfigError  # noqa: E402
from flexmotion.streamer.cli import execute  # noqa: E402
from flexmotion.training.autoencoder import Autoencoder  # noqa: E402
from flexmotion.training.checkpoints import BEST, LAST, load_weights, training_record  # noqa: E402
from flexmotion.training.feature_store import FeatureStore  # noqa: E402
from flexmotion.training.format import FORMAT  # noqa: E402
from flexmotion.training.muscle_torques import load_muscle_torques  # noqa: E402
from flexmotion.training.run import CONFIG, Run  # noqa: E402
from flexmotion.training.stage import train_stage  # noqa: E402
from flexmotion.training.store_index import INDEX  # noqa: E402

TOO_NEW = rf"of version {FORMAT + 1}, this release reads 1 to {FORMAT}: the file is too new: install"


@pytest.fixture
def network(trained: Run) -> Autoencoder:
    return Autoencoder(trained.config.autoencoder, trained.config.window, trained.layout)


def checkpoint(trained: Run, name: str, **changes: object) -> dict[str, object]:
    """Content of a checkpoint of the autoencoder; a change to None removes an entry."""
    content = torch.load(trained.stage("autoencoder") / name, weights_only=True) | changes
    return {key: value for key, value in content.items() if value is not None}


def test_every_file_carries_the_format(trained: Run) -> None:
    assert yaml.safe_load((trained.folder / CONFIG).read_text())["format"] == FORMAT
    assert json.loads((trained.folder / "features" / INDEX).read_text())["format"] == FORMAT
    assert all(checkpoint(trained, name)["format"] == FORMAT for name in (LAST, BEST))


def test_newer_files_are_refused(trained: Run, network: Autoencoder, tmp_path: Path) -> None:
    new = {"format": FORMAT + 1}
    torch.save(checkpoint(trained, BEST, **new), tmp_path / BEST)
    with pytest.raises(ConfigError, match=TOO_NEW):
        load_weights(network, tmp_path)
    with pytest.raises(ConfigError, match=TOO_NEW):
        training_record(tmp_path)
    (tmp_path / CONFIG).write_text(yaml.safe_dump(yaml.safe_load((trained.folder / CONFIG).read_text()) | new))
    with pytest.raises(ConfigError, match=TOO_NEW):
        Run(tmp_path)
    store = copytree(trained.folder / "features", tmp_path / "features")
    (store / INDEX).write_text(json.dumps(json.loads((store / INDEX).read_text()) | new))
    with pytest.raises(ConfigError, match=TOO_NEW):
        FeatureStore(store)
    np.savez(tmp_path / "muscles.npz", format=np.array(FORMAT + 1))
    with pytest.raises(ConfigError, match=TOO_NEW):
        load_muscle_torques(tmp_path / "muscles.npz")


def test_a_state_without_format_resumes_bit_for_bit(trained: Run, stages, tmp_path: Path) -> None:
    """Its average has neither the prefix nor the number of weights averaged."""
    average = checkpoint(trained, LAST)["average"]
    assert isinstance(average, dict)
    old = {name.removeprefix("module."): value for name, value in average.items() if name != "n_averaged"}
    longer = trained.config.stages.autoencoder.model_copy(update={"steps": 8})
    states = []
    for name, changes in (("present", {}), ("old", {"format": None, "average": old})):
        folder = tmp_path / name
        folder.mkdir()
        torch.save(checkpoint(trained, LAST, **changes), folder / LAST)
        train_stage(stages.autoencoder(trained), longer, folder, fingerprint=trained.fingerprint())
        states.append(torch.load(folder / LAST, weights_only=True))
    present, resumed = (state["average"] for state in states)
    assert list(present) == list(resumed) and resumed["n_averaged"] == states[1]["step"] == 8
    assert all(torch.equal(value, resumed[name]) for name, value in present.items())


def test_weights_and_settings_without_format_are_read(trained: Run, network: Autoencoder, tmp_path: Path) -> None:
    torch.save(checkpoint(trained, BEST, format=None), tmp_path / BEST)
    assert load_weights(network, tmp_path) == training_record(tmp_path).best
    content = yaml.safe_load((trained.folder / CONFIG).read_text())
    del content["format"], content["model"]["corrections"]
    (tmp_path / CONFIG).write_text(yaml.safe_dump(content))
    assert Run(tmp_path).fingerprint() == trained.fingerprint()


def test_a_training_without_format_has_the_corrections_of_its_program(
    trained: Run, stream_config: Path, tmp_path: Path
) -> None:
    content = yaml.safe_load((trained.folder / CONFIG).read_text())
    del content["format"], content["model"]["corrections"]
    (tmp_path / CONFIG).write_text(yaml.safe_dump(content))
    assert Run(tmp_path).config.corrections == CORRECTIONS_OF_3
    # They stay in the folder, and a configuration without corrections leaves them as they are.
    assert Run(tmp_path, str(stream_config)).config.corrections == CORRECTIONS_OF_3
    assert Run(tmp_path).config.corrections == CORRECTIONS_OF_3
    assert trained.config.corrections == Corrections()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("seed: 1\nmodel: {}\nformat: two\n", "field format: 'two', expected a whole number"),
        ("seed: 1\n", "field model: missing"),
        ("", "expected a mapping"),
    ],
)
def test_a_damaged_configuration_is_one_line(
    content: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / CONFIG).write_text(content)
    assert execute(["export", str(tmp_path), "-o", str(tmp_path / "bundle")]) == 2
    error = capsys.readouterr().err
    assert message in error and "Traceback" not in error


def test_damaged_weights_are_reported(network: Autoencoder, tmp_path: Path) -> None:
    for content in (b"", b"not a checkpoint", b"PK\x03\x04 cut off"):
        (tmp_path / BEST).write_bytes(content)
        with pytest.raises(ConfigError, match="damaged"):
            load_weights(network, tmp_path)


def test_weights_from_before_the_dynamics_head_are_read(trained: Run, network: Autoencoder, tmp_path: Path) -> None:
    weights = torch.load(trained.stage("autoencoder") / BEST, weights_only=True)
    weights["network"] = {name: value for name, value in weights["network"].items() if "dynamics" not in name}
    torch.save(weights, tmp_path / BEST)
    load_weights(network, tmp_path)
    assert not network.dynamics.write.weight.any()
    del weights["network"]["persistence"]
    torch.save(weights, tmp_path / BEST)
    with pytest.raises(ConfigError, match="another network"):
        load_weights(network, tmp_path)


def test_a_state_of_another_network_is_refused_in_one_line(trained: Run, stages, tmp_path: Path) -> None:
    state = torch.load(trained.stage("autoencoder") / LAST, weights_only=True)
    del state["network"]["persistence"]
    torch.save(state, tmp_path / LAST)
    with pytest.raises(ConfigError, match="of another version"):
        train_stage(
            stages.autoencoder(trained),
            trained.config.stages.autoencoder,
            tmp_path,
            fingerprint=trained.fingerprint(),
        )
