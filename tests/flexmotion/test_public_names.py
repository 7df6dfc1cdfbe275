"""`import flexmotion as fm`: the names, and what importing them costs."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import flexmotion as fm
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.motion.intents import WORDS
from flexmotion.streamer.motion.sources import ClipSource

PACKAGE = Path(fm.__file__).parent


def loaded(code: str) -> set[str]:
    """Modules in a new interpreter after `code`."""
    listing = f"{code}\nimport sys; print(*sys.modules)"
    return set(
        subprocess.run([sys.executable, "-c", listing], capture_output=True, text=True, check=True).stdout.split()
    )


def test_importing_the_package_imports_nothing() -> None:
    found = loaded("import flexmotion as fm; dir(fm)")
    assert {name for name in found if name.startswith("flexmotion")} == {"flexmotion"}
    assert not found & {"numpy", "mujoco"}


def test_a_subpackage_loads_alone() -> None:
    found = loaded("import flexmotion.drivers")
    assert {name for name in found if name.startswith("flexmotion")} == {"flexmotion", "flexmotion.drivers"}


def test_an_intent_loads_no_simulator() -> None:
    assert not loaded("import flexmotion as fm; fm.Velocity(0.1, 0.0, 0.0)") & {"mujoco", "scipy", "onnxruntime"}


@pytest.mark.parametrize("name", fm.__all__)
def test_every_name_is_there(name: str) -> None:
    assert getattr(fm, name).__name__ == name
    assert name in dir(fm)


def test_every_intent_that_a_session_takes_is_there() -> None:
    """The error of `session.send("wave")` named Hand, Look, TorqueCap and others that the library did not offer."""
    document = (Path(__file__).parents[2] / "docs" / "library.md").read_text(encoding="utf-8")
    for kind in WORDS.values():
        assert getattr(fm, kind.__name__) is kind
        assert f"`{kind.__name__}" in document
    with fm.open_session("op3", source=ClipSource(default_clip()[:120])) as session:
        session.advance(2.0)
        session.send(fm.JointAngle("head_pan", 0.4))
        session.advance(1.0)
        assert session.state.q[session.robot.joint_names.index("head_pan")] == pytest.approx(0.4, abs=0.05)
        session.finish()


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'flexmotion' has no attribute 'dance'"):
        _ = fm.dance


def test_what_a_type_checker_sees_is_what_is_loaded() -> None:
    tree = ast.parse((PACKAGE / "__init__.py").read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    imported = {
        alias.name: node.module.removeprefix("flexmotion.")
        for node in block.body
        if isinstance(node, ast.ImportFrom) and node.module is not None
        for alias in node.names
    }
    assert imported == fm._WHERE
    assert sorted(imported) == sorted(fm.__all__)


def test_no_name_is_that_of_a_subpackage() -> None:
    """Importing the subpackage would put it in the name's place."""
    assert not set(fm.__all__) & {path.stem for path in PACKAGE.iterdir()}
