"""`write_judged`: the figures of judges into a bundle's manifest, which then offers what passed and nothing else."""

from __future__ import annotations

from collections.abc import Mapping

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.manifest import MANIFEST, Repertoire, write_manifest
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.judged import Judged
from flexmotion.configs.repertoire import FILE, RobotRepertoire
from flexmotion.configs.robot import Robot
from flexmotion.text.manners import NORMAL
from flexmotion.text.phrases import STAND, check_kinds


def write_judged(
    bundle: Bundle, *, kinds: Mapping[str, Judged] | None = None, manners: Mapping[str, Judged] | None = None
) -> Bundle:
    """Write figures into a bundle; those of other kinds and manners stay, and its hash changes.

    What a judge has not seen keeps being offered until a first judge of its sort has written: figures of kinds say
    nothing about manners.

    Args:
        bundle: that was judged.
        kinds, manners: figures by name.

    Raises:
        ConfigError: a kind or a manner is not one of the bundle's.
    """
    own = bundle.manifest.repertoire or Repertoire()
    for what, judged, known in (
        ("kind", kinds or {}, bundle.prompts.kinds),
        ("manner", manners or {}, bundle.manners.names),
    ):
        for name in judged:
            if name not in known:
                names = ", ".join(dict.fromkeys(known)) or "none"
                raise ConfigError(f"{bundle.folder}: {what} {name!r} was judged, but the bundle knows {names}")
    repertoire = Repertoire(
        kinds=None if own.kinds is None and kinds is None else {**(own.kinds or {}), **(kinds or {})},
        manners=None if own.manners is None and manners is None else {**(own.manners or {}), **(manners or {})},
    )
    write_manifest(bundle.manifest.model_copy(update={"repertoire": repertoire}), bundle.folder / MANIFEST)
    return Bundle(bundle.folder)


def robot_repertoire(robot: Robot) -> RobotRepertoire | None:
    """What a robot was judged to do, for a model that it follows; None: it was not judged.

    Raises:
        ConfigError: its file names an unknown kind of motion.
    """
    own = robot.repertoire
    if own is not None:
        check_kinds(own.kinds, f"{robot.folder / FILE}: field kinds")
        check_kinds([*own.done_as, *own.done_as.values()], f"{robot.folder / FILE}: field done_as")
    return own


def offered_kinds(bundle: Bundle, robot: RobotRepertoire | None = None) -> tuple[str, ...]:
    """Kinds of motion that a bundle offers: standing, and those whose judge passed; all where none was judged.

    Args:
        robot: what the robot that follows was judged to do: of its kinds the same holds; None: it was not judged.
    """
    own = tuple(dict.fromkeys(bundle.prompts.kinds))
    judged = None if bundle.manifest.repertoire is None else bundle.manifest.repertoire.kinds
    modelled = own if judged is None else tuple(kind for kind in own if kind == STAND or _passed(judged, kind))
    return tuple(kind for kind in modelled if kind == STAND or robot is None or robot.offers(kind))


def offered_manners(bundle: Bundle) -> tuple[str, ...]:
    """Manners that a bundle offers: the normal one, persons', and those whose judge passed; all where none was judged.

    A person's manner is offered without a judge: there is none for it.
    """
    own = bundle.manners.names
    judged = None if bundle.manifest.repertoire is None else bundle.manifest.repertoire.manners
    if judged is None:
        return own
    always = (NORMAL, *bundle.manifest.personal)
    return tuple(name for name in own if name in always or _passed(judged, name))


def _passed(judged: Mapping[str, Judged], name: str) -> bool:
    return name in judged and judged[name].passed
