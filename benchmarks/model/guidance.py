"""Which guidance does each kind of motion need?

With more of it gestures are made more surely, and poses go beyond what people do: of `SCALES` each kind gets the least
one at which its prompts are done about as often as at the best. The scale of most kinds becomes the bundle's; those of
the others, where the model can make them, become its correction `guidance`. `--write` puts them into the bundle. What
was chosen by one seed is to be reported by another (`model/prompts`). Only measures.
"""

from __future__ import annotations

from collections import Counter
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.model.corrections import sampler_with
from benchmarks.model.prompts import OFFERED, done
from benchmarks.shared.cells import share
from benchmarks.shared.model import open_bundle
from benchmarks.shared.options import BundleArgument, WriteOption
from benchmarks.shared.outcome import Outcome
from benchmarks.shared.prompts import gesture_kinds, prompt_kinds
from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.manifest import MANIFEST, write_manifest
from flexmotion.sampling.sampler import Sampler

SCALES = (1.0, 1.5, 2.0, 3.0)
"""Of the request: those for which a student is distilled."""
ABOUT = 0.05
"""By so much less often than at the best scale a kind may be done at a lower one."""


def sampler_at(bundle: Bundle, scale: float) -> Sampler:
    """A sampler of a bundle at one scale for all kinds that it knows."""
    bundle.manifest = bundle.manifest.model_copy(update={"guidance": scale})
    return sampler_with(bundle, bundle.manifest.corrections.model_copy(update={"guidance": {}}))


def least_enough(shares: dict[float, float]) -> float:
    """The least scale at which a kind is done about as often as at the best, of shares by scale."""
    best = max(shares.values())
    return min(scale for scale, own in shares.items() if own >= best - ABOUT)


def main(
    bundle: BundleArgument = None,
    samples: Annotated[int, typer.Option(min=1, help="Of each wording and scale.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="Of the first sample.")] = 0,
    seconds: Annotated[float, typer.Option(min=1.0, help="Length of a sample [s].")] = 4.0,
    write: WriteOption = False,
) -> Outcome:
    """Judge every kind at every scale."""
    opened = open_bundle(bundle)
    known = opened.prompts.kinds
    entries = {entry.of: entry for entry in (*prompt_kinds(), *gesture_kinds()) if entry.of and entry.of in known}
    found: dict[str, dict[float, float]] = {kind: {} for kind in entries}
    for scale in SCALES:
        sampler = sampler_at(Bundle(opened.folder), scale)
        for kind, entry in track(entries.items(), f"scale {scale:g}", console=Console(stderr=True)):
            found[kind][scale] = share(done(sampler, entry, seed, samples, seconds))
    chosen = {kind: least_enough(shares) for kind, shares in found.items()}
    made = {kind: scale for kind, scale in sorted(chosen.items()) if max(found[kind].values()) >= OFFERED}
    usual = Counter(made.values()).most_common(1)[0][0] if made else opened.manifest.guidance
    of_kinds = {kind: scale for kind, scale in made.items() if scale != usual}
    table = Table("kind", *(f"{scale:g}" for scale in SCALES), "chosen", title="Done, by scale of the guidance")
    for kind, shares in found.items():
        table.add_row(kind, *(f"{100 * shares[scale]:.0f} %" for scale in SCALES), f"{chosen[kind]:g}")
    Console(width=100).print(table)
    others = ", ".join(f"{kind} {scale:g}" for kind, scale in of_kinds.items()) or "none"
    typer.echo(f"the bundle's scale: {usual:g}; others: {others}")
    if write:
        corrections = opened.manifest.corrections.model_copy(update={"guidance": of_kinds})
        changed = opened.manifest.model_copy(update={"guidance": usual, "corrections": corrections})
        write_manifest(changed, opened.folder / MANIFEST)
    by_kind = {kind: {f"{scale:g}": own for scale, own in shares.items()} for kind, shares in found.items()}
    return Outcome([], {"guidance": usual, "of_kinds": of_kinds, "samples": samples, "seed": seed, "by_kind": by_kind})
