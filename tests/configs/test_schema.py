from pathlib import Path

import pytest
import yaml

from flexmotion.configs import schema
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import Strict, load, parse


class Engine(Strict):
    power: float
    name: str = "none"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("power: [1", "not valid YAML"),
        # Regression: it ended the program with a RecursionError.
        ("power: " + 5000 * "[", "not valid YAML"),
        ("- power", "expected a mapping of fields, found list"),
        ("", "expected a mapping of fields, found NoneType"),
        # Regression: the last one was taken, without a word.
        ("power: 1\nname: a\npower: 2", "line 3: not valid YAML: key 'power' is given twice, first in line 1"),
        ("power: fast", "field power: Input should be a valid number"),
        ("name: a", "field power: missing"),
        ("{power: 1, torque: 2}", "field torque: unknown field, expected one of: power, name"),
        # Regression: it named only the field that was missing because of the misspelling.
        ("powre: 1", "field powre: unknown field, expected one of: power, name (and 1 more: power)"),
        ("power: .nan", "field power: Input should be a finite number"),
        ("power: .inf", "field power: Input should be a finite number"),
        ("{power: a, name: 3}", "(and 1 more: name)"),
    ],
)
def test_a_bad_file_is_refused_in_one_line_with_file_and_field(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "engine.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError) as error:
        load(Engine, file)
    assert says in str(error.value)
    assert str(file) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_or_binary_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.yaml: cannot be read: No such file"):
        load(Engine, tmp_path / "none.yaml")
    (tmp_path / "b.yaml").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ConfigError, match="not valid YAML"):
        load(Engine, tmp_path / "b.yaml")


def test_what_was_parsed_is_read_only() -> None:
    engine = parse(Engine, {"power": 3}, "here")
    with pytest.raises(ValueError, match="frozen"):
        engine.power = 4  # type: ignore[misc]


def test_a_model_without_fields_lists_none() -> None:
    with pytest.raises(ConfigError, match="options: field speed: unknown field, there are none"):
        parse(Strict, {"speed": 1}, "options")


@pytest.mark.parametrize("loader", [yaml.SafeLoader, getattr(yaml, "CSafeLoader", yaml.SafeLoader)])
@pytest.mark.parametrize("depth", [500, 5000])
def test_a_file_that_is_nested_too_deeply_is_refused_with_any_reader(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, loader: type, depth: int
) -> None:
    """PyYAML without libyaml ended the program with a RecursionError."""
    monkeypatch.setattr(schema, "_LOADER", loader)
    file = tmp_path / "engine.yaml"
    file.write_text("power: " + depth * "[" + depth * "]")
    with pytest.raises(ConfigError, match=r"not valid YAML|field power"):
        load(Engine, file)
