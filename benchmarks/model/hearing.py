"""Are sentences that no model was taught understood as what they mean?

Reads each sentence of `hearing.yaml`. Prints the share of each kind that is understood as that kind, and what was
misunderstood; a sentence without meaning must be understood as nothing, or as standing still. Fails below `OVERALL` of
all, below `EACH` of a kind, or where a sentence of one side is understood as a motion of the other. Kinds that a robot
hardly shows (kicks, punches, dances) are left out.

Likewise the gestures of `gesture_hearing.yaml` that the bundle's listener knows, and the manners of
`manner_hearing.yaml`, whether the model can do them or not: a manner of no list must be dropped. Fails below
`GESTURE_SHARE`, `MANNER_SHARE` of all.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
import yaml
from rich.console import Console
from rich.table import Table

from benchmarks.shared.cells import share
from benchmarks.shared.judges import confuses_sides, understood
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleArgument, CsvOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.sampling.sampler import Sampler
from flexmotion.text.manners import NORMAL

SENTENCES = Path(__file__).with_suffix(".yaml")
GESTURES, MANNER_SENTENCES = (Path(__file__).with_name(f"{name}_hearing.yaml") for name in ("gesture", "manner"))
OVERALL, EACH = 0.97, 0.85
GESTURE_SHARE, MANNER_SHARE = 0.95, 0.9
UNKNOWN_MANNER = "none"


def untaught_sentences(file: Path = SENTENCES) -> dict[str, list[str]]:
    """Sentences by the kind of motion that they mean."""
    content: dict[str, list[str]] = yaml.safe_load(file.read_text(encoding="utf-8"))
    return content


def read_all(sampler: Sampler, sentences: dict[str, list[str]]) -> list[dict[str, Any]]:
    """One row a sentence: its kind, the kind it was understood as, whether that is right."""
    rows = []
    for kind, own in sentences.items():
        for sentence in own:
            prompt = sampler.prompt(sentence)
            found = prompt.refused or prompt.kind  # heard, though the model does not offer it
            rows.append({"kind": kind, "sentence": sentence, "heard": found, "right": understood(kind, found)})
    return rows


def read_manners(sampler: Sampler, sentences: dict[str, list[str]]) -> list[dict[str, Any]]:
    """One row a sentence: its manner, the manner it was understood as, whether that is right."""
    rows = []
    for manner, own in sentences.items():
        for sentence in own:
            phrases = sampler.requests.reader.manner(sentence).phrases
            found = NORMAL if not phrases else next((one.manner for one in phrases if one.manner), UNKNOWN_MANNER)
            rows.append({"kind": manner, "sentence": sentence, "heard": found, "right": found == manner})
    return rows


def main(
    bundle: BundleArgument = None,
    sentences: Annotated[Path, typer.Option(help="YAML: kinds, each with a list of sentences.")] = SENTENCES,
    csv_out: CsvOption = None,
) -> Outcome:
    """Read all sentences."""
    sampler = open_sampler(bundle, unjudged=True)
    rows = read_all(sampler, untaught_sentences(sentences))
    overall, shares = _shown("Sentences that no model was taught", rows)
    worst = min(shares, key=lambda kind: shares[kind])
    heard = set(sampler.bundle.listener.kinds)
    gestures = {kind: said for kind, said in untaught_sentences(GESTURES).items() if kind in heard}
    parts = {"gestures": (read_all(sampler, gestures), GESTURE_SHARE)} if gestures else {}
    if sampler.bundle.manner_listener is not None:
        parts["manners"] = (read_manners(sampler, untaught_sentences(MANNER_SENTENCES)), MANNER_SHARE)
    figures: dict[str, Any] = {"sentences": len(rows), "overall": overall, "by_kind": shares}
    verdicts = [
        Verdict(f"understood: {100 * overall:.1f} % of {len(rows)} (>= {100 * OVERALL:.0f} %)", overall >= OVERALL),
        Verdict(f"worst kind: {worst}, {100 * shares[worst]:.0f} % (>= {100 * EACH:.0f} %)", shares[worst] >= EACH),
    ]
    for name, (found, least) in parts.items():
        share_of, by_kind = _shown(f"{name.capitalize()} in sentences that no model was taught", found)
        text = f"{name}: {100 * share_of:.1f} % of {len(found)} (>= {100 * least:.0f} %)"
        verdicts.append(Verdict(text, share_of >= least))
        figures[name] = {"sentences": len(found), "overall": share_of, "by_kind": by_kind}
    every = [*rows, *(row for name, (found, _) in parts.items() if name == "gestures" for row in found)]
    crossed = [row for row in every if confuses_sides(row["kind"], row["heard"])]
    verdicts.append(Verdict(f"left taken for right or right for left: {len(crossed)} (0)", not crossed))
    if csv_out is not None:
        write_csv(csv_out, [*rows, *(row for found, _ in parts.values() for row in found)])
    return Outcome(verdicts, figures)


def _shown(title: str, rows: list[dict[str, Any]]) -> tuple[float, dict[str, float]]:
    """Print a table of what was misunderstood; the share of all rows that are right, and by kind."""
    table = Table("kind", "sentences", "understood", "misunderstood", title=title)
    shares = {}
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        shares[kind] = share([row["right"] for row in own])
        wrong = "\n".join(f"{row['sentence']} → {row['heard']}" for row in own if not row["right"])
        table.add_row(kind, str(len(own)), f"{100 * shares[kind]:.0f} %", wrong)
    Console(width=140).print(table)
    return share([row["right"] for row in rows]), shares
