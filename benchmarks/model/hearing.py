"""What is heard: are sentences that nobody wrote down for a model understood?

    python benchmarks/hearing.py [BUNDLE] [--sentences FILE] [--csv FILE]

Each sentence of hearing.yaml is read, none of which a model has been taught. Printed are the share of each kind that is
heard as that kind, and what was misheard; what means nothing must be heard as nothing, or as standing still. Exits with
1 below OVERALL of all, below EACH of a kind, or where a sentence to one side is heard as any motion to the other. Kinds
that a robot hardly shows (kicks, punches, dances, beckoning) are not among them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
import yaml
from rich.console import Console
from rich.table import Table
from verdicts import Verdict, benchmark, write_csv

from flexmotion.streamer.commands.choice import open_sampler
from flexmotion.text.phrases import STAND
from flexmotion.text.sayings import NOTHING
from flexmotion.text.sides import sides

SENTENCES = Path(__file__).with_name("hearing.yaml")
OVERALL, EACH = 0.95, 0.85
SAME_MOTION = {"dash": "run", NOTHING: STAND}
"""Kinds that are no mistake for another."""


def main(
    bundle: Annotated[Path | None, typer.Argument(help="Of the model; else the shipped one.")] = None,
    sentences: Annotated[Path, typer.Option(help="YAML: kinds, each with a list of sentences.")] = SENTENCES,
    csv_out: Annotated[Path | None, typer.Option("--csv", help="Write one row a sentence here.")] = None,
) -> list[Verdict]:
    """Read all sentences."""
    sampler = open_sampler(bundle, "this benchmark")
    rows = []
    for kind, said in yaml.safe_load(sentences.read_text(encoding="utf-8")).items():
        for sentence in said:
            heard = sampler.prompt(sentence).kind
            right = SAME_MOTION.get(heard, heard) == SAME_MOTION.get(kind, kind)
            rows.append({"kind": kind, "sentence": sentence, "heard": heard, "right": right})
    table = Table(title="Sentences that no model was taught")
    for column in ("kind", "sentences", "heard right", "misheard"):
        table.add_column(column)
    shares = {}
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        shares[kind] = sum(row["right"] for row in own) / len(own)
        misheard = "\n".join(f"{row['sentence']} → {row['heard']}" for row in own if not row["right"])
        table.add_row(kind, str(len(own)), f"{100 * shares[kind]:.0f} %", misheard)
    Console(width=140).print(table)
    if csv_out is not None:
        write_csv(csv_out, rows)
    overall = sum(row["right"] for row in rows) / len(rows)
    worst = min(shares, key=lambda kind: shares[kind])
    crossed = [row for row in rows if len(sides(row["kind"]) | sides(row["heard"])) == 2]
    return [
        Verdict(f"heard right: {100 * overall:.1f} % of {len(rows)} (>= {100 * OVERALL:.0f} %)", overall >= OVERALL),
        Verdict(f"worst kind: {worst}, {100 * shares[worst]:.0f} % (>= {100 * EACH:.0f} %)", shares[worst] >= EACH),
        Verdict(f"left heard as right or right as left: {len(crossed)} (0)", not crossed),
    ]


if __name__ == "__main__":
    benchmark(main)
