"""What the documents name is there: files, modules, names in them, and what they link to."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCUMENTS = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *(ROOT / folder / "README.md" for folder in ("benchmarks", "examples", "examples/udp_driver")),
]
FOLDERS = ("benchmarks", "configs", "docs", "drivers", "examples", "flexmotion", "retarget", "streamer", "tests")
FILES = [
    path.relative_to(ROOT).as_posix()
    for folder in FOLDERS
    for path in (ROOT / folder).rglob("*")
    if "__pycache__" not in path.parts
]
PATH = re.compile(r"`((?:[\w.]+/)*[\w]+\.(?:py|yaml|xml|html))`|`((?:[\w]+/)+)`")
DOTTED = re.compile(r"`(flexmotion(?:\.\w+)+)`")
LINK = re.compile(r"\]\((?!https?:|#)([^)#]+)(?:#[^)]*)?\)")
OF_A_USER = {
    "NAME.py",
    "NAME.yaml",
    "calibration.yaml",
    "identification.yaml",
    "clips.yaml",
    "config.yaml",
    "index.html",
    "ours.yaml",
    "robot.yaml",
    "walk_external_loads.xml",
}
"""Files that the documents speak of and that are not part of the project."""
OTHER = {"flexmotion.drivers", "flexmotion.imus", "work/"}
"""Entry-point groups, and the folder in which a build works."""


def text(document: Path) -> str:
    """Its text without blocks of code, which speak of the reader's files."""
    return re.sub(r"```.*?```", "", document.read_text(encoding="utf-8"), flags=re.S)


def is_there(name: str) -> bool:
    """Whether a file or folder of the project has this name, or ends in it."""
    name = name.rstrip("/")
    return any(file == name or file.endswith(f"/{name}") for file in FILES) or (ROOT / name).exists()


def resolves(name: str) -> bool:
    """Whether a dotted name is that of a module, or of something in one."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_what_a_document_names_is_there(document: Path) -> None:
    """Regression: documents named modules and benchmarks that had moved."""
    content = text(document)
    paths = {next(filter(None, found)) for found in PATH.findall(content)}
    missing = [path for path in paths - OTHER if Path(path).name not in OF_A_USER and not is_there(path)]
    missing += [name for name in set(DOTTED.findall(content)) - OTHER if not resolves(name)]
    missing += [link for link in LINK.findall(content) if not (document.parent / link.strip()).exists()]
    assert not missing
