"""The model that a benchmark measures."""

from __future__ import annotations

from pathlib import Path

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.shipped import bundle_folder, shipped_bundle
from flexmotion.configs.errors import ConfigError
from flexmotion.sampling.sampler import Sampler


def open_bundle(folder: Path | None) -> Bundle:
    """The bundle of a folder, or a shipped one by its name; None: the default one.

    Raises:
        ConfigError: the bundle is damaged, or none is given and none is shipped.
    """
    found = shipped_bundle() if folder is None else bundle_folder(folder)
    if found is None:
        raise ConfigError("this version comes without a model bundle; name one")
    return Bundle(found)


def open_sampler(
    folder: Path | None, steps: int | None = None, *, unjudged: bool = False, balanced: bool = True
) -> Sampler:
    """A sampler of the bundle of a folder, or of the shipped one; `steps` of the diffusion, by default the bundle's.

    `unjudged`: with the kinds that the bundle was not judged to do, for their judges. `balanced`: as in
    `flexmotion.open_sampler`; False for what a robot follows.

    Raises:
        ConfigError: as `open_bundle`.
    """
    return Sampler(open_bundle(folder), steps, unjudged=unjudged, balanced=balanced)
