"""One clip: import, augmentation, forces, torques and activations."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from flexmotion.biomechanics.analysis import muscle_analysis
from flexmotion.biomechanics.augmentation import varied
from flexmotion.biomechanics.dynamics import Dynamics, dynamics
from flexmotion.biomechanics.external_load import ExternalLoad
from flexmotion.biomechanics.force_error import FLAGGED
from flexmotion.biomechanics.mirror import mirror
from flexmotion.biomechanics.plausibility import explained, plausible, within_turn
from flexmotion.biomechanics.simulation.variant import PerturbedMotion, TrackingFailedError, perturbed
from flexmotion.configs.errors import FlexMotionError
from flexmotion.dataset.clips import Clip
from flexmotion.dataset.fields import FIELDS
from flexmotion.dataset.settings import BuildSettings
from flexmotion.human.motion import Motion
from flexmotion.importers import read


@dataclass(frozen=True)
class Entry:
    """A clip, its mirror image or a variant, for the set, or the reason for dropping it.

    Attributes:
        name: of the clip, with suffix `~mirror`, `~N` or `~perturbedN`.
        info: its entry in the manifest.
        arrays: by field; empty if dropped.
        dropped: reason; empty if kept.
    """

    name: str
    info: dict[str, Any]
    arrays: dict[str, np.ndarray]
    dropped: str = ""


def enrich(clip: Clip, settings: BuildSettings) -> list[Entry]:
    """Entries of a clip and everything derived from it."""
    source = clip.path.name + (f":{clip.member}" if clip.member else "")
    about: dict[str, Any] = {
        "source": source,
        "source_sha256": hashlib.sha256(clip.path.read_bytes()).hexdigest(),
        "collection": clip.collection,
        "licence": clip.licence,
        "split": clip.split,
        "labels": clip.labels,
        "captions": [asdict(caption) for caption in clip.captions],
    }
    try:
        imported = read(clip.path, fps=settings.fps, clip=clip.member or None)
    except FlexMotionError as error:
        # The path of the file is removed from the message: it differs between machines.
        reason = str(error).replace(str(clip.path), clip.path.name)
        return [Entry(clip.name, about, {}, f"unreadable: {reason}")]
    motion = imported.motion
    if np.any(imported.belt):
        about |= {"belt": [round(float(speed), 4) for speed in imported.belt]}
    if imported.notes:
        about |= {"warnings": list(imported.notes)}
    about |= {"mass_given": bool(motion.mass_given)}
    motion = replace(motion, source=source)
    entries = [_entry(clip.name, about | {"variant": "original"}, motion, (), settings)]
    if settings.mirrored:
        entries.append(_entry(f"{clip.name}~mirror", about | {"variant": "mirror"}, mirror(motion), (), settings))
    for number in range(1, settings.variants + 1):
        seed = _seed(clip.name, number, settings.seed)
        changed, loads = varied(motion, seed, settings.ranges)
        info = about | {"variant": "varied", "seed": seed}
        entries.append(_entry(f"{clip.name}~{number}", info, changed, loads, settings))
    if _chosen(clip.name, settings):
        for number in range(1, settings.perturbed + 1):
            seed = _seed(clip.name, -number, settings.seed)
            info = about | {"variant": "perturbed", "seed": seed}
            entries.append(_perturbed_entry(f"{clip.name}~perturbed{number}", info, motion, settings))
    return entries


def _chosen(name: str, settings: BuildSettings) -> bool:
    """Whether a clip has simulated copies; independent of the order in which clips are built."""
    return _seed(name, 0, settings.seed) < settings.perturbed_share * 2**32


def _perturbed_entry(name: str, info: dict[str, Any], motion: Motion, settings: BuildSettings) -> Entry:
    if motion.duration < settings.shortest:
        return Entry(name, info, {}, f"short: {motion.duration:.2f} s")
    try:
        found = perturbed(
            motion,
            info["seed"],
            settings.perturbations,
            cutoff=settings.cutoff,
            ground=settings.ground,
            nearness=settings.nearness,
        )
    except TrackingFailedError as error:
        return Entry(name, info | {"frames": len(motion), "fps": motion.fps}, {}, str(error))
    return _entry(name, info | found.description(), found.dynamics.motion, (), settings, found)


def _seed(name: str, number: int, seed: int) -> int:
    """A seed that is independent of the order in which clips are built."""
    return int(hashlib.sha256(f"{seed} {name} {number}".encode()).hexdigest()[:8], 16)


def _entry(
    name: str,
    info: dict[str, Any],
    motion: Motion,
    loads: tuple[ExternalLoad, ...],
    settings: BuildSettings,
    answer: PerturbedMotion | None = None,
) -> Entry:
    """Entry of a motion under loads, or of a simulated one."""
    info = info | {"frames": len(motion), "fps": motion.fps}
    if motion.duration < settings.shortest:
        return Entry(name, info, {}, f"short: {motion.duration:.2f} s")
    found = (
        answer.dynamics
        if answer
        else dynamics(motion, settings.cutoff, settings.ground, settings.nearness, loads=loads)
    )
    pulled = answer.pulled if answer else False
    moved = replace(found.motion, joints=within_turn(found.motion.joints))
    borne = explained(found.residual, settings.residual_force, settings.residual_moment) & ~np.asarray(pulled)
    good = borne & plausible(moved, settings.reach)
    medians = np.median(found.residual, axis=0)
    info |= {
        "body": asdict(found.motion.body),
        "good_share": round(float(good.mean()), 4),
        "implausible_share": round(float((borne & ~good).mean()), 4),
        "residual_median": [round(float(value), 5) for value in medians],
        "force_error_mean": round(float(found.force_error.mean()), 5),
        "flagged_share": round(float((found.force_error > FLAGGED).any(axis=1).mean()), 4),
    }
    if borne.mean() < settings.kept_share:
        reason = f"residual: {100 * borne.mean():.0f} % of its frames are explained by ground forces"
        return Entry(name, info, {}, reason)
    if good.mean() < settings.kept_share:
        reason = f"implausible: {100 * good.mean():.0f} % of its frames are plausible"
        return Entry(name, info, {}, reason)
    arrays = {
        "root_position": moved.root_position,
        "root_quaternion": moved.root_quaternion,
        "joints": moved.joints,
        "torques": moved.torques,
        "wrenches": moved.wrenches,
        "centres": found.centres,
        "contacts": moved.contacts,
        "loads": _stacked(found),
        "residual": found.residual,
        "force_error": found.force_error,
        "good": good,
    }
    if settings.muscles:
        muscles = muscle_analysis(found)
        arrays |= {
            "activations": muscles.state.activations,
            "joint_contact": muscles.contact,
            "infeasible": muscles.infeasible,
        }
    return Entry(name, info, {field: np.asarray(value).astype(FIELDS[field].dtype) for field, value in arrays.items()})


def _stacked(found: Dynamics) -> np.ndarray:
    """Forces of the loads on torso, left and right hand, (T, 3, 3) [N]."""
    if not found.loads:
        return np.zeros((len(found.motion), 3, 3))
    return np.stack([load.force for load in found.loads], axis=1)
