from __future__ import annotations

import importlib.util
import logging
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from flexmotion import compiled
from flexmotion.streamer.doctor.doctor import compiled_loops

SOURCE = """
import numpy as np

from flexmotion.compiled import FLOATS, compiled, part


@part
def square(x):
    return x * x


@compiled(FLOATS[1])
def squares(values):
    out = np.empty_like(values)
    for k in range(len(values)):
        out[k] = square(values[k])
    return out
"""


@pytest.fixture(autouse=True)
def untold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "_told", set())
    monkeypatch.setattr(compiled, "_unkept", set())
    monkeypatch.setattr(compiled.numba.config, "CACHE_DIR", "")


def loaded(folder: Path, **constants: float) -> ModuleType:
    """The module of `SOURCE`, with constants of other modules, as a process would load it that begins now."""
    file = folder / "loops.py"
    if not file.exists():
        file.write_text(SOURCE)
    spec = importlib.util.spec_from_file_location("loops", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    vars(module).update(constants)
    spec.loader.exec_module(module)
    return module


def test_code_is_compiled_once_and_kept(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        first = loaded(tmp_path)
    assert "once after an installation" in caplog.text
    caplog.clear()
    again = loaded(tmp_path)
    assert not caplog.text and compiled_loops().level == "ok"
    assert sum(again.squares.stats.cache_hits.values()) == 1 and not again.squares.stats.cache_misses
    for module in (first, again):
        np.testing.assert_array_equal(module.squares(np.arange(4.0)), [0.0, 1.0, 4.0, 9.0])


@pytest.mark.parametrize("kind", ["nbi", "nbc", "seal"])
@pytest.mark.parametrize("damage", ["empty", "cut off", "zeroed"])
def test_damaged_code_is_compiled_again(tmp_path: Path, kind: str, damage: str) -> None:
    """A page of zeros, as a loss of power leaves it, ended every later start with a segmentation fault."""
    loaded(tmp_path)
    (file,) = (tmp_path / "__pycache__").glob(f"loops.squares-*.{kind}")
    whole = file.read_bytes()
    zeroed = whole[: len(whole) // 2] + bytes(len(whole) - len(whole) // 2)
    file.write_bytes({"empty": b"", "cut off": whole[:40], "zeroed": zeroed}[damage])
    np.testing.assert_array_equal(loaded(tmp_path).squares(np.arange(3.0)), [0.0, 1.0, 4.0])
    assert not loaded(tmp_path).squares.stats.cache_misses


def test_code_is_made_again_for_another_constant(tmp_path: Path) -> None:
    """Torques were those of the old gravity after the constant had changed in another file."""
    (tmp_path / "loops.py").write_text(SOURCE.replace("x * x", "x * FACTOR"))
    for factor in (2.0, 5.0):
        module = loaded(tmp_path, FACTOR=factor)
        np.testing.assert_array_equal(module.squares(np.array([1.0])), [factor])


@pytest.mark.parametrize("refusal", [RuntimeError("no locator available"), OSError(28, "No space left on device")])
def test_code_that_cannot_be_kept_is_compiled_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, refusal: Exception
) -> None:
    """A full disk after an installation ended every command with "No space left on device"."""

    def refused(*_: object, **options: object) -> object:
        if options.get("cache"):
            raise refusal
        return plain(**options)

    plain = compiled.numba.njit
    monkeypatch.setattr(compiled.numba, "njit", refused)
    with caplog.at_level(logging.WARNING):
        module = loaded(tmp_path)
    assert "at every start" in caplog.text and "NUMBA_CACHE_DIR" in caplog.text
    assert compiled.unkept() == {"squares"}
    assert compiled_loops().level == "warning" and "NUMBA_CACHE_DIR" in str(compiled_loops().mend)
    np.testing.assert_array_equal(module.squares(np.arange(3.0)), [0.0, 1.0, 4.0])


def test_loops_can_be_run_as_plain_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """NUMBA_DISABLE_JIT ended every command that plans in an AttributeError."""
    monkeypatch.setattr(compiled.numba.config, "DISABLE_JIT", 1)
    np.testing.assert_array_equal(loaded(tmp_path).squares(np.arange(3)), [0, 1, 4])


def test_other_types_are_refused_instead_of_compiled_while_a_robot_moves(tmp_path: Path) -> None:
    squares = loaded(tmp_path).squares
    for values in (np.arange(3), np.arange(3, dtype=np.float32), np.zeros((2, 2)), np.zeros(6)[::2], [1.0]):
        with pytest.raises(TypeError):
            squares(values)
    assert len(squares.signatures) == 1


def test_arrays_that_may_not_be_written_are_read(tmp_path: Path) -> None:
    values = np.arange(3.0)
    values.setflags(write=False)
    np.testing.assert_array_equal(loaded(tmp_path).squares(values), [0.0, 1.0, 4.0])
