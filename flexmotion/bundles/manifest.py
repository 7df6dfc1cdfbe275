"""`Manifest`: a bundle's description of itself, and the versions of its schema."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flexmotion.configs.corrections import Corrections
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.judged import Judged
from flexmotion.configs.schema import Strict, load, parse
from flexmotion.configs.versions import FormatVersions
from flexmotion.human.body import Sex

MANIFEST = "manifest.json"
SCHEMA_VERSIONS = FormatVersions(
    kind="bundle",
    oldest=3,
    newest=11,
    migration="export the bundle anew from its training folder ('flexmotion export')",
    field="schema_",
)
SCHEMA = f"flexmotion.bundle/{SCHEMA_VERSIONS.newest}"
"""Schema that is written."""

CORRECTIONS_OF_3 = Corrections(
    standing_noise=0.4,
    aside=1.5,
    ahead_per_aside=1.25,
    turning_per_aside=0.2,
    catch_up=0.3,
    catch_up_limit=0.3,
    speeds={
        "walk": (1.3, 0.0, 0.0),
        "walk-back": (-0.75, 0.0, 0.0),
        "walk-turn-left": (1.2, 0.0, 0.9),
        "walk-turn-right": (1.2, 0.0, -0.9),
        "run": (2.3, 0.0, 0.0),
        "dash": (3.1, 0.0, 0.0),
    },
)
"""Corrections of every bundle of schema 3: they were constants of the sampler."""


_CORRECTIONS_SINCE_11 = {"manner_speeds"}
_SINCE_11: dict[str, Any] = {"corrections": _CORRECTIONS_SINCE_11}
_CORRECTIONS_SINCE_10 = {"guidance", "normal_guidance"} | _CORRECTIONS_SINCE_11
_SINCE_10: dict[str, Any] = {"corrections": _CORRECTIONS_SINCE_10}
_CORRECTIONS_SINCE_9 = {"pose_noise"} | _CORRECTIONS_SINCE_10
_SINCE_9: dict[str, Any] = {"corrections": _CORRECTIONS_SINCE_9}
_SINCE_8: dict[str, Any] = {"personal": True} | _SINCE_9
_CORRECTIONS_SINCE_7 = {"travelling_noise", "spot_noise", "ahead", "turning"}
_SINCE_7: dict[str, Any] = _SINCE_8 | {"eight_bits": True, "corrections": _CORRECTIONS_SINCE_7 | _CORRECTIONS_SINCE_9}
_SINCE_6 = {"manner": True, "manner_guidance": True, "repertoire": True} | _SINCE_7
"""Fields that former schemas lack."""


class BodySize(Strict):
    """Size [m], mass [kg] and proportions (`human.body.Segments`) of the generated human."""

    height: float
    mass: float
    sex: Sex
    segments: dict[str, float]


class Repertoire(Strict):
    """What a bundle was judged to do, by kind of motion and by manner; see `repertoire`. None: not judged."""

    kinds: dict[str, Judged] | None = None
    manners: dict[str, Judged] | None = None


class Manifest(Strict):
    """Description of a bundle.

    Attributes:
        schema_: version of the manifest, `SCHEMA`.
        name, description: for people.
        layout: hash of the feature layout.
        fps, muscles, joint_contact: of that layout; before schema 5 without joint contact forces.
        history, future: frames of input and output.
        latent: size of the latent vector.
        steps: default number of sampling steps.
        times: length of the noise schedule.
        guided: whether the guidance scale is an input of the network; else guidance takes three evaluations.
        guidance: default scale; kinds may have another one (`corrections`).
        manner_guidance: default scale of the manner; the normal one may have another (`corrections`).
        velocity: whether a velocity can be commanded.
        manner: whether the manner is an input of the network; before schema 6 it is not.
        personal: manner of a person -> file of the denoiser that is used for requests in that manner, and for no other;
            before schema 8 there is none.
        repertoire: figures of its judges; None: it was not judged, and offers every kind and manner of its training.
        body: the generated human.
        corrections: fitted to this model.
        eight_bits: whether products of matrices in its networks are of integers; before schema 7 they are not.
        licence: of the weights.
        versions: of the libraries that made the bundle.
        files: name -> sha256.
    """

    schema_: str
    name: str
    description: str = ""
    layout: str
    fps: float
    muscles: int
    joint_contact: bool = False
    history: int
    future: int
    latent: int
    steps: int
    times: int
    guided: bool
    guidance: float
    manner_guidance: float = 1.0
    velocity: bool
    manner: bool = False
    personal: dict[str, str] = {}
    repertoire: Repertoire | None = None
    body: BodySize
    corrections: Corrections = Corrections()
    eight_bits: bool = False
    licence: str
    versions: dict[str, str] = {}
    files: dict[str, str] = {}


def read_manifest(path: Path) -> Manifest:
    """A manifest of a schema in `SCHEMA_VERSIONS`, as one of the newest.

    Raises:
        ConfigError: the file cannot be read, is no manifest, or has another schema.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: no bundle there ({error.strerror}); 'flexmotion export' makes one") from error
    except ValueError as error:
        raise ConfigError(f"{path}: damaged ({error})") from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: damaged (expected an object, found {type(content).__name__})")
    found = _version(content.get("schema_"), path)
    SCHEMA_VERSIONS.check(found, path)
    if found == 3:
        content = content | {"corrections": CORRECTIONS_OF_3.model_dump()}
    content = content | {"schema_": SCHEMA}
    return parse(Manifest, content, path)


def read_corrections(source: Path) -> Corrections:
    """The corrections of a bundle, or those in a YAML file.

    Args:
        source: folder of a bundle, or a YAML file with fields of `Corrections`.

    Raises:
        ConfigError: it cannot be read, or is neither.
    """
    return read_manifest(source / MANIFEST).corrections if source.is_dir() else load(Corrections, source)


def write_manifest(manifest: Manifest, path: Path) -> None:
    """Write the JSON file."""
    path.write_text(_text(manifest.model_dump()), encoding="utf-8")


def equivalent_hashes(manifest: Manifest) -> tuple[str, ...]:
    """sha256 of the manifest's text in each schema that can express it, newest first.

    Motion sampled from a bundle is the same before and after its manifest is brought to the newest schema, so a log
    that names one of these hashes was recorded with the same model.
    """
    texts = [_text(manifest.model_dump())]
    corrections, plain = manifest.corrections, Corrections()
    if corrections.manner_speeds:
        return _hashes(texts)
    texts.append(_text(manifest.model_dump(exclude=_SINCE_11) | {"schema_": "flexmotion.bundle/10"}))
    if any(getattr(corrections, name) != getattr(plain, name) for name in _CORRECTIONS_SINCE_10):
        return _hashes(texts)
    texts.append(_text(manifest.model_dump(exclude=_SINCE_10) | {"schema_": "flexmotion.bundle/9"}))
    if corrections.pose_noise != plain.pose_noise:
        return _hashes(texts)
    texts.append(_text(manifest.model_dump(exclude=_SINCE_9) | {"schema_": "flexmotion.bundle/8"}))
    if manifest.personal:
        return _hashes(texts)
    texts.append(_text(manifest.model_dump(exclude=_SINCE_8) | {"schema_": "flexmotion.bundle/7"}))
    if manifest.eight_bits or any(getattr(corrections, name) != getattr(plain, name) for name in _CORRECTIONS_SINCE_7):
        return _hashes(texts)
    content = manifest.model_dump(exclude=_SINCE_7) | {"schema_": "flexmotion.bundle/6"}
    texts.append(_text(content))
    if manifest.manner or manifest.repertoire is not None:
        return _hashes(texts)
    content = manifest.model_dump(exclude=_SINCE_6) | {"schema_": "flexmotion.bundle/5"}
    texts.append(_text(content))
    if not manifest.joint_contact:
        del content["joint_contact"]
        texts.append(_text(content | {"schema_": "flexmotion.bundle/4"}))
        if manifest.corrections == CORRECTIONS_OF_3:
            del content["corrections"]
            texts.append(_text(content | {"schema_": "flexmotion.bundle/3"}))
    return _hashes(texts)


def _hashes(texts: Sequence[str]) -> tuple[str, ...]:
    return tuple(hashlib.sha256(text.encode()).hexdigest() for text in texts)


def _text(content: dict[str, Any]) -> str:
    return json.dumps(content, indent=1, sort_keys=True, ensure_ascii=False) + "\n"


def _version(schema: object, path: Path) -> int:
    found = re.fullmatch(r"flexmotion\.bundle/(\d+)", schema) if isinstance(schema, str) else None
    if found is None:
        raise ConfigError(f"{path}: no bundle: schema is {schema!r}, expected {SCHEMA!r}")
    return int(found[1])
