"""Are sentences that no model was taught understood as what they mean?

Reads each sentence of `hearing.yaml`. Prints the share of each kind that is understood as that kind, and what was
misunderstood; a sentence without meaning must be understood as nothing, or as standing still. Fails below `OVERALL` of
all, below `EACH` of a kind, or where a sentence of one side is understood as a motion of the other. Kinds that a robot
hardly shows (kicks, punches, dances, beckoning) are left out.
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

SENTENCES = Path(__file__).with_suffix(".yaml")
OVERALL, EACH = 0.95, 0.85


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


def main(
    bundle: BundleArgument = None,
    sentences: Annotated[Path, typer.Option(help="YAML: kinds, each with a list of sentences.")] = SENTENCES,
    csv_out: CsvOption = None,
) -> Outcome:
    """Read all sentences."""
    rows = read_all(open_sampler(bundle), untaught_sentences(sentences))
    table = Table(title="Sentences that no model was taught")
    for column in ("kind", "sentences", "understood", "misunderstood"):
        table.add_column(column)
    shares = {}
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        shares[kind] = share([row["right"] for row in own])
        wrong = "\n".join(f"{row['sentence']} → {row['heard']}" for row in own if not row["right"])
        table.add_row(kind, str(len(own)), f"{100 * shares[kind]:.0f} %", wrong)
    Console(width=140).print(table)
    if csv_out is not None:
        write_csv(csv_out, rows)
    overall = share([row["right"] for row in rows])
    worst = min(shares, key=lambda kind: shares[kind])
    crossed = [row for row in rows if confuses_sides(row["kind"], row["heard"])]
    verdicts = [
        Verdict(f"understood: {100 * overall:.1f} % of {len(rows)} (>= {100 * OVERALL:.0f} %)", overall >= OVERALL),
        Verdict(f"worst kind: {worst}, {100 * shares[worst]:.0f} % (>= {100 * EACH:.0f} %)", shares[worst] >= EACH),
        Verdict(f"left taken for right or right for left: {len(crossed)} (0)", not crossed),
    ]
    return Outcome(verdicts, {"sentences": len(rows), "overall": overall, "by_kind": shares})
