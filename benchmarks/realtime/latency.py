"""How late does the control loop wake on this machine, and how soon does a new target become a command?

Runs `flexmotion check latency`, which compares its figures with the budgets of the stream settings. Meant for an
otherwise idle machine that grants realtime scheduling; --load adds busy processes.
"""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from benchmarks.shared.outcome import Outcome, Verdict
from flexmotion.configs.errors import DriverError


def measured(seconds: float, load: int) -> dict[str, Any]:
    """Figures of `flexmotion check latency --json`, whether budgets were kept or not (exit codes 0 and 1).

    Raises:
        DriverError: the command failed.
    """
    command = [sys.executable, "-m", "flexmotion.streamer", "check", "latency", "--json"]
    command += ["--seconds", str(seconds), "--load", str(load)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise DriverError(f"check latency: exit {done.returncode}: {done.stderr.strip()[-200:]}")
    content: dict[str, Any] = json.loads(done.stdout)
    return content


def main(
    seconds: Annotated[float, typer.Option(min=5.0, help="Length of the measurement [s].")] = 60.0,
    load: Annotated[int, typer.Option(min=0, help="Busy processes beside it.")] = 0,
) -> Outcome:
    """Measure and compare with the budgets."""
    found = measured(seconds, load)
    table = Table("stage", "p50 ms", "p99 ms", "max ms", "p99 ms kept pace", title="Latency")
    for name, stage in found["stages"].items():
        times = stage["ms"] or {}
        cells = (times.get("p50"), times.get("p99"), times.get("max"), (stage["kept_pace_ms"] or {}).get("p99"))
        table.add_row(name, *("-" if value is None else f"{value:.3g}" for value in cells))
    Console(width=120).print(table)
    failures = found["unfit"] or "; ".join(found["failures_kept"]) or "none"
    names = ("scheduling", "load", "cycles", "switches", "answered", "missed_deadlines", "late_plans", "underruns")
    figures = {name: found[name] for name in names} | {"stages": found["stages"]}
    figures |= {name: found[name] for name in ("verdict", "verdict_all", "failures", "left_out", "slowness")}
    return Outcome([Verdict(f"budgets exceeded while the machine kept its pace: {failures}", found["ok"])], figures)
