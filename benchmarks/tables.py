"""Tables of the documents, made from kept results.

A document has `<!-- figures: NAME -->`, the table, and `<!-- end -->`; NAME is one of `TABLES`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from string import Formatter

from benchmarks.catalogue import CATALOGUE
from benchmarks.results import FOLDER, ROOT, Result, kept
from flexmotion.configs.errors import ConfigError

DOCUMENTS = ("README.md", "docs/*.md", "docs/results/*.md", "benchmarks/README.md")
"""Where tables may be (globs in the project)."""

BEGIN = re.compile(r"^<!-- figures: (?P<name>[\w-]+) -->\n", re.MULTILINE)
END = "<!-- end -->"
NOT_KEPT = "-"
"""Cell of a benchmark without a kept result."""

Results = Callable[[str], Result | None]
"""The kept result of a benchmark by name."""


@dataclass(frozen=True)
class Row:
    """A row of figures.

    Attributes:
        what: was measured.
        benchmark: that measured it.
        found: its figures, as a format string over the result's figures, such as `{force[left]:.1f} N`.
        target: what is wanted; empty where nothing is.
    """

    what: str
    benchmark: str
    found: str
    target: str = ""


BIOMECHANICS = (
    Row(
        "ground force per foot, vertical / fore-aft / side, RMSE",
        "biomechanics/gait",
        "{force_percent[vertical]:.1f} / {force_percent[fore-aft]:.1f} / {force_percent[side]:.1f} % of body weight",
        "4.5 / 2.5 / 2.5",
    ),
    Row(
        "hip / knee / ankle moment, RMSE",
        "biomechanics/gait",
        "{moment_nm_kg[hip_flexion]:.3f} / {moment_nm_kg[knee_flexion]:.3f} / {moment_nm_kg[ankle_dorsiflexion]:.3f}"
        " N·m/kg",
        ".15 / .15 / .18",
    ),
    Row(
        "root residual of walking clips, median, Bandai / CMU",
        "biomechanics/muscles",
        "{collections[bandai][residual_percent]:.2f} / {collections[cmu][residual_percent]:.2f} % of body weight",
        "2",
    ),
    Row(
        "torque put back through MuJoCo's muscles within 2 %",
        "biomechanics/muscles",
        "{close:.1%} of {frames} frames",
        "90 %",
    ),
    Row("activations outside [0, 1] or too fast", "biomechanics/muscles", "{outside}", "0"),
    Row("frames with a saturated leg muscle", "biomechanics/muscles", "{saturated:.1%}", "5 %"),
    Row(
        "compression of hip / knee, peak of a stance phase",
        "biomechanics/muscles",
        "{contact_bw[hip]:.1f} / {contact_bw[knee]:.1f} body weights",
        "4.5 / 3.2",
    ),
    Row(
        "inverse dynamics against OpenSim",
        "biomechanics/opensim_reference",
        "{inverse_dynamics[rms_nm_most]:.3f} N·m, {inverse_dynamics[time_ratio]:.0f} times faster",
    ),
    Row(
        "static optimisation against OpenSim, 80 leg muscles",
        "biomechanics/opensim_reference",
        "RMS {static_optimisation[rms]:.3f}, r {static_optimisation[correlation]:.3f},"
        " {static_optimisation[time_ratio]:.0f} times faster",
    ),
    Row(
        "whole pipeline with muscles, two workers",
        "biomechanics/speed",
        "{workers_2[frames_per_s]:.0f} frames/s, {workers_2[frames_per_core_s]:.0f} a second of a core's work,"
        " {workers_2[memory_gb]:.1f} GB",
        "350 frames/s",
    ),
)
"""Rows of `docs/biomechanics.md`."""


def of_topic(topic: str, results: Results) -> str:
    """The benchmarks of a topic: what they ask, where they fail, their last result."""
    rows = []
    for benchmark in CATALOGUE:
        if benchmark.name.startswith(f"{topic}/"):
            rows.append([f"`{benchmark.name}`", benchmark.asks, benchmark.fails, _last(results(benchmark.name))])
    return markdown(("benchmark", "asks", "fails", "last result"), rows)


def of_figures(rows: Sequence[Row], results: Results) -> str:
    """Figures of several benchmarks; rows without a kept result are left out."""
    cells = []
    for row in rows:
        result = results(row.benchmark)
        if result is not None:
            found = row.found.format_map(result.figures)
            cells.append([row.what, f"`{row.benchmark}`", found, row.target, _when(result)])
    return markdown(("what", "benchmark", "found", "target", "measured"), cells)


def of_groups(name: str, key: str, columns: Mapping[str, str], results: Results) -> str:
    """Figures of one benchmark that has several groups of them, one row a group, and its verdicts.

    Args:
        name: of the benchmark.
        key: a figure that each group of the table has.
        columns: heading -> a format string over the figures of a group, and `group`, its name; a cell whose figure the
            group lacks is empty.
        results: kept ones.
    """
    result = results(name)
    if result is None:
        return f"`{name}`: no result is kept."
    figures = result.figures.items()
    groups = [{"group": one, **own} for one, own in figures if isinstance(own, dict) and key in own]
    rows = list(zip(*(_column(form, groups) for form in columns.values()), strict=True))
    return f"{markdown(tuple(columns), rows)}\n\n`{name}`: {_last(result)}; {result.machine.processor}."


def _column(form: str, groups: Sequence[Mapping[str, object]]) -> list[str]:
    """Cells of a column; raises `KeyError` where no group has its figure."""
    names = {name.partition("[")[0] for _, name, _, _ in Formatter().parse(form) if name}
    if groups and not any(names <= group.keys() for group in groups):
        raise KeyError(form)
    return [form.format_map(group) if names <= group.keys() else "" for group in groups]


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines)


def _last(result: Result | None) -> str:
    if result is None:
        return NOT_KEPT
    verdicts = "; ".join(f"{'' if own.holds else 'FAIL: '}{own.sentence}" for own in result.verdicts)
    return f"{verdicts or 'measured'} ({_when(result)})"


def _when(result: Result) -> str:
    _, _, options = result.command.partition(f" {result.name}")
    machine = f"load {result.machine.load:g} on {result.machine.cores} cores"
    return f"{result.date}, {result.commit[:7]}, {machine}{f', with `{options.strip()}`' if options else ''}"


GET_UP = tuple(
    Row(
        f"up from its {way}, of perturbed robots{told}",
        "robot/get_up",
        f"{{{side}[stand]:.0f}} of {{{side}[starts]:.0f}}, in {{{side}[median_s]:.1f}} s (median); greatest torque "
        f"{{{side}[peak_nm]:.2f}} N·m, {{{side}[violations]:.0f}} goals outside the envelope",
        "all; 0",
    )
    for way in ("front", "back")
    for side, told in ((way, ""), (f"{way}, limp", " that collapsed without torque"))
)

TABLES: dict[str, Callable[[Results], str]] = {
    "model": partial(of_topic, "model"),
    "robot": partial(of_topic, "robot"),
    "biomechanics": partial(of_figures, BIOMECHANICS),
    "get-up": partial(of_figures, GET_UP),
    "bus-cycle-time": partial(
        of_groups,
        "bus/cycle_time",
        "client",
        {
            "client": "{client}",
            "baud": "{baud}",
            "on the wire [ms]": "{wire_ms:.2f}",
            "median [ms]": "{median_ms:.2f}",
            "p99 [ms]": "{p99_ms:.2f}",
            "median / wire": "{median_over_wire:.2f}",
            "processor [µs]": "{processor_us:.0f}",
            "over rustypot's": "{processor_ratio:.2f}",
            "failed cycles": "{failed}",
        },
    ),
    "ablations": partial(
        of_groups,
        "model/ablations",
        "fid",
        {
            "cell": "{group}",
            "Fréchet distance": "{fid:.3f}",
            "residual force [% of weight]": "{euler_force:.2f}",
            "residual moment [N·m/kg]": "{euler_moment:.3f}",
            "torque error [N·m/kg]": "{actuation:.4f}",
            "contact force error [% of weight]": "{contact_force:.2f}",
            "activations out of bounds [%]": "{muscle_limit:.2f}",
            "muscle torque error [N·m/kg]": "{muscle_torque:.3f}",
            "skate": "{skate_ratio:.3f}",
            "jerk [m/s³]": "{jerk:.1f}",
        },
    ),
    "baselines": partial(
        of_groups,
        "model/baselines",
        "fid",
        {
            "way, steps": "{group}",
            "Fréchet distance": "{fid:.3f}",
            "R-precision, top 3": "{r_precision_top3:.3f}",
            "diversity": "{diversity:.2f}",
            "multimodality": "{multimodality:.2f}",
            "skate": "{skate_ratio:.3f}",
            "jerk [m/s³]": "{jerk:.0f}",
            "residual, decoded [% of weight]": "{residual_force:.2f}",
            "residual, delivered": "{delivered_residual_force:.2f}",
            "ZMP outside [% of frames]": "{delivered_zmp_outside:.1f}",
            "parameters [million]": "{parameters_million:.1f}",
            "GFLOP": "{gflop:.2f}",
            "time of the shipped way": "{times:.2f}",
        },
    ),
    "personal": partial(
        of_groups,
        "model/personal",
        "personal_cm",
        {
            "kind of motion": "{group}",
            "the person's clips": "{clips}",
            "normal, moved [cm]": "{normal_cm:g}",
            "in the person's manner, moved [cm]": "{personal_cm:.1f}",
            "postures from the clips, before [cm]": "{before_cm:.2f}",
            "in the person's manner": "{after_cm:.2f}",
            "clips from each other": "{apart_cm:.2f}",
            "done, before": "{done_before:.2f}",
            "done in the manner": "{done:.2f}",
        },
    ),
    "bus-faults": partial(
        of_groups,
        "bus/faults",
        "fault",
        {"`--fault`": "`{fault}`", "events, seconds after the fault": "{events}", "violations": "{violations}"},
    ),
}


def updated(text: str, document: str, results: Results = kept) -> str:
    """A document with its tables made anew.

    Raises:
        ConfigError: a table has no end, or is unknown.
    """
    parts, place = [], 0
    while (begin := BEGIN.search(text, place)) is not None:
        name, end = begin["name"], text.find(END, begin.end())
        if end < 0:
            raise ConfigError(f"{document}: the table {name!r} has no {END}")
        if name not in TABLES:
            raise ConfigError(f"{document}: no table {name!r}, expected one of {', '.join(TABLES)}")
        # A formatter of Markdown wants a line between a comment and a table.
        parts += [text[place : begin.end()], f"\n{TABLES[name](results)}\n\n"]
        place = end
    return "".join([*parts, text[place:]])


def documents(root: Path = ROOT) -> list[Path]:
    """Documents that have tables."""
    found = [path for pattern in DOCUMENTS for path in sorted(root.glob(pattern))]
    return [path for path in found if BEGIN.search(path.read_text(encoding="utf-8"))]


def main(options: Sequence[str], root: Path = ROOT, folder: Path = FOLDER) -> int:
    """Write the tables, or with `--check` compare them; returns 1 where a document differs."""
    if set(options) - {"--check"}:
        raise ConfigError(f"tables: unknown option {' '.join(options)!r}, expected --check or nothing")
    stale = []
    for path in documents(root):
        before = path.read_text(encoding="utf-8")
        name = path.relative_to(root).as_posix()
        after = updated(before, name, partial(kept, folder=folder))
        if after == before:
            continue
        stale.append(name)
        if not options:
            path.write_text(after, encoding="utf-8")
            print(f"{name}: written")
    if options and stale:
        print(f"not as the kept results: {', '.join(stale)}; run: python -m benchmarks tables", file=sys.stderr)
        return 1
    return 0
