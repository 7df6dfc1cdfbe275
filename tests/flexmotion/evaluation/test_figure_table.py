"""Tables of figures: nothing is left out, and a file says how it was made."""

from __future__ import annotations

import re
from pathlib import Path

from flexmotion.evaluation.figure_table import FigureTable, condition_table, metric_table
from flexmotion.evaluation.interval import Interval

RESULTS = Path(__file__).parents[3] / "docs" / "results"


def of(value: float) -> Interval:
    return Interval(value, 0.0)


def test_a_metric_that_a_model_lacks_is_absent_and_not_zero() -> None:
    made = metric_table({"real": {"fid": of(0.1)}, "bundle": {"fid": of(0.3), "moved": of(2.0)}})
    assert made.headings == ["metric", "real", "bundle"]
    assert made.lines == [["fid", "0.1 ± 0", "0.3 ± 0"], ["moved", "-", "2 ± 0"]]


def test_what_was_asked_stands_beside_what_was_not_told() -> None:
    rows: dict[str, dict[str, Interval] | str] = {
        "none": {"fid": of(0.2)},
        "1 joint": {"fid": of(0.25), "place_cm": of(1.2), "place_cm_untold": of(19.7)},
        "1 muscle": "constraints of activations: model x has no control branch",
    }
    made = condition_table(rows)
    kept = {line[0]: line[1] for line in made.lines}
    assert kept == {"none": "-", "1 joint": "1.2 cm (19.7)", "1 muscle": rows["1 muscle"]}
    assert all(len(line) == len(made.headings) for line in made.lines)


def test_a_table_on_disk_names_its_command(tmp_path: Path) -> None:
    path = tmp_path / "table.md"
    made = FigureTable(["metric", "real"], [["fid", "0.1"]], ["`fid`: a distance"])
    made.write(path, "flexmotion evaluate training", "64 windows.")
    text = path.read_text(encoding="utf-8")
    assert text.startswith("Made by `flexmotion evaluate training` on 20") and "64 windows." in text
    assert text.endswith("| metric | real |\n| --- | --- |\n| fid | 0.1 |\n\n- `fid`: a distance\n")


def test_every_figure_of_the_kept_tables_is_explained_with_its_unit() -> None:
    """The tables named metrics as the code does, without units, and did not say what they are."""
    metrics = re.findall(r"^\| ([a-z]\w+) \| [^|]*\d", (RESULTS / "evaluation.md").read_text(), re.MULTILINE)
    told = " ".join(metric_table({"bundle": {metric: of(1.0) for metric in metrics}}).legend)
    assert len(metrics) > 25
    for metric in metrics:
        bare = metric.removeprefix("delivered_").removesuffix("_p95")
        assert f"`{bare}`" in told or f"`{bare.removeprefix('r_precision_')}`" in told, metric
    assert "[N·m/kg]" in told and "[% of body weight]" in told
    headings = condition_table({"none": {"fid": of(0.2)}})
    assert all(any(line.startswith(f"{heading}:") for line in headings.legend) for heading in headings.headings[2:])
