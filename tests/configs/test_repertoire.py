"""The kinds of motion that a robot was judged to do are checked when it is loaded, and kept beside its robot file."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.judged import Judged
from flexmotion.configs.repertoire import FILE, write_repertoire
from flexmotion.configs.robot import ROBOTS, Robot, load_robot


def judged(share: float) -> Judged:
    return Judged(judge="robot/kinds", samples=5, share=share, least=0.8)


@pytest.fixture
def unjudged(tmp_path: Path) -> Robot:
    """A copy of OP3 that no judge has seen."""
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    (folder / FILE).unlink()
    return load_robot(folder)


def test_op3_does_all_that_its_joints_allow_and_does_not_tilt_its_head(op3: Robot) -> None:
    """A tilt of the head was accepted, and PASS with likeness 100 %: OP3 has no joint for it, and nothing moved."""
    own = op3.repertoire
    assert own is not None and own.place == "op3"
    assert {kind for kind in own.kinds if not own.offers(kind)} == {"tilt-head-right", "tilt-head-left"}
    assert own.figure("tilt-head-left") == "robot/kinds: 0 of 5 runs did, 80 % pass"


def test_figures_are_written_beside_the_robot_file_and_those_of_other_kinds_stay(unjudged: Robot) -> None:
    assert unjudged.repertoire is None
    kinds = {"walk": judged(1.0), "run": judged(1.0), "dash": judged(1.0), "nod": judged(0.2)}
    write_repertoire(unjudged, kinds, {"run": "walk", "dash": "walk"})
    again = load_robot(unjudged.folder)
    write_repertoire(again, {"nod": judged(0.8), "dash": judged(1.0)}, {"dash": "run"})
    own = load_robot(unjudged.folder).repertoire
    assert own is not None and own.offers("walk") and own.offers("nod") and own.place == str(unjudged.folder)
    assert own.done_as == {"run": "walk", "dash": "run"}
    told = f"not judged: python -m benchmarks robot/kinds --robot {unjudged.folder} --write --kind bow"
    assert not own.offers("bow") and own.figure("bow") == told


@pytest.mark.parametrize("place", ["link to nowhere", "folder"])
def test_a_repertoire_that_cannot_be_read_was_taken_for_a_robot_that_was_never_judged(
    unjudged: Robot, place: str
) -> None:
    """The robot was offered every kind of motion."""
    file = unjudged.folder / FILE
    if place == "folder":
        file.mkdir()
    else:
        file.symlink_to(unjudged.folder / "gone.yaml")
    with pytest.raises(ConfigError, match=f"{file}: cannot be read"):
        load_robot(unjudged.folder)


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda c: c.update(kinds={}), "field kinds"),
        (lambda c: c.update(manners={}), "field manners"),
        (lambda c: c["kinds"]["walk"].update(share=1.5), "field kinds.walk.share"),
        (lambda c: c["kinds"]["walk"].update(samples=0), "field kinds.walk.samples"),
        (lambda c: c["kinds"]["walk"].pop("least"), "field kinds.walk.least"),
        (lambda c: c["kinds"].update(walk=True), "field kinds.walk"),
        (lambda c: c.update(version=2), "repertoire of version 2, this release reads 1"),
    ],
)
def test_what_is_wrong_is_named(unjudged: Robot, edit: Callable[[dict[str, Any]], None], says: str) -> None:
    file = write_repertoire(unjudged, {"walk": judged(1.0)})
    content = yaml.safe_load(file.read_text())
    edit(content)
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigError, match=FILE) as error:
        load_robot(unjudged.folder)
    assert error.match(says)
