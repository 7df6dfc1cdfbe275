"""Tables of the documents are those of the kept results."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.results import Machine, Result
from benchmarks.tables import BEGIN, BIOMECHANICS, END, TABLES, documents, main, of_figures, of_groups, updated
from flexmotion.configs.errors import ConfigError

TEXT = "# Title\n\n<!-- figures: bus-cycle-time -->\nold\n<!-- end -->\n\nafter\n"


def result(name: str, figures: dict[str, object]) -> Result:
    machine = Machine(processor="Some Processor", cores=2, load=0.5)
    command = f"python -m benchmarks {name}"
    return Result(
        name=name,
        command=command,
        commit="0123456789ab",
        date="2026-01-31",
        machine=machine,
        seconds=1.0,
        verdicts=(),
        figures=figures,
    )


CYCLES = {
    "client": "sdk",
    "baud": 1000000,
    "wire_ms": 4.0,
    "median_ms": 5.0,
    "p99_ms": 6.0,
    "median_over_wire": 1.25,
    "processor_us": 270.0,
    "processor_ratio": 5.28,
    "failed": 0,
}


def test_documents_are_as_the_kept_results() -> None:
    assert main(["--check"]) == 0


def test_every_table_is_in_one_document() -> None:
    texts = [path.read_text(encoding="utf-8") for path in documents()]
    assert sorted(begin["name"] for text in texts for begin in BEGIN.finditer(text)) == sorted(TABLES)


def test_a_table_is_written_between_its_markers() -> None:
    kept = result("bus/cycle_time", {"sdk, 1000000": CYCLES, "processor_share_1000000": 0.4, "others": {"x": 1}})
    text = updated(TEXT, "doc.md", lambda name: kept if name == "bus/cycle_time" else None)
    assert text.startswith("# Title\n\n<!-- figures: bus-cycle-time -->\n") and text.endswith(f"{END}\n\nafter\n")
    assert "| sdk | 1000000 | 4.00 | 5.00 | 6.00 | 1.25 | 270 | 5.28 | 0 |" in text and "old" not in text
    assert "`bus/cycle_time`: measured (2026-01-31, 0123456, load 0.5 on 2 cores); Some Processor." in text
    assert updated(text, "doc.md", lambda _name: kept) == text


def test_options_of_a_result_are_named() -> None:
    kept = result("bus/faults", {}).model_copy(update={"command": "python -m benchmarks bus/faults --minutes 0.2"})
    text = of_groups("bus/faults", "fault", {"fault": "{fault}"}, lambda _name: kept)
    assert "measured (2026-01-31, 0123456, load 0.5 on 2 cores, with `--minutes 0.2`)" in text


def test_a_group_is_named_and_a_figure_that_it_lacks_leaves_its_cell_empty() -> None:
    kept = result("model/baselines", {"real": {"fid": 0.1}, "frames, 50": {"fid": 0.25, "times": 30.0}})
    columns = {"way": "{group}", "distance": "{fid:.2f}", "time": "{times:.1f}"}
    text = of_groups("model/baselines", "fid", columns, lambda _name: kept)
    assert "| real | 0.10 |  |\n| frames, 50 | 0.25 | 30.0 |" in text
    with pytest.raises(KeyError, match="jerk"):  # of a figure that was renamed
        of_groups("model/baselines", "fid", {"jerk": "{jerk:.1f}"}, lambda _name: kept)


def test_without_a_result_the_table_says_so() -> None:
    assert of_groups("bus/faults", "fault", {}, lambda _name: None) == "`bus/faults`: no result is kept."


def test_rows_of_figures_are_those_with_a_result() -> None:
    figures = {
        "biomechanics/muscles": {
            "close": 0.902,
            "frames": 9821,
            "outside": 0,
            "saturated": 0.02,
            "contact_bw": {"hip": 4.2, "knee": 3.0},
            "collections": {"bandai": {"residual_percent": 0.351}, "cmu": {"residual_percent": 0.4}},
        },
        "biomechanics/opensim_reference": {
            "inverse_dynamics": {"rms_nm_most": 0.003, "time_ratio": 39.0},
            "static_optimisation": {"rms": 0.002, "correlation": 0.999, "time_ratio": 264.0},
        },
        "biomechanics/speed": {"workers_2": {"frames_per_s": 402.0, "frames_per_core_s": 348.0, "memory_gb": 0.61}},
    }
    text = of_figures(BIOMECHANICS, lambda name: result(name, figures[name]) if name in figures else None)
    assert "0.35 / 0.40 % of body weight" in text and "90.2% of 9821 frames" in text
    assert "0.003 N·m, 39 times faster" in text and "402 frames/s" in text
    assert "ground force" not in text and len(text.splitlines()) == 2 + 8


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TEXT.replace(END, ""), "doc.md: the table 'bus-cycle-time' has no <!-- end -->"),
        (TEXT.replace("bus-cycle-time", "bus"), "doc.md: no table 'bus', expected one of model"),
    ],
)
def test_broken_markers(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        updated(text, "doc.md", lambda _name: None)


def test_check_fails_where_a_document_differs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "results"
    result("bus/cycle_time", {"sdk, 1000000": CYCLES}).write(folder)
    (tmp_path / "docs").mkdir()
    document = tmp_path / "docs" / "drivers.md"
    document.write_text(TEXT)
    assert main(["--check"], tmp_path, folder) == 1 and document.read_text() == TEXT
    assert "docs/drivers.md" in capsys.readouterr().err
    assert main([], tmp_path, folder) == 0 and "sdk" in document.read_text()
    assert main(["--check"], tmp_path, folder) == 0
    # A new result makes the document stale.
    result("bus/cycle_time", {"sdk, 1000000": CYCLES | {"median_ms": 9.0}}).write(folder)
    assert main(["--check"], tmp_path, folder) == 1
