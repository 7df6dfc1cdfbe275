"""The result of `check latency` for a terminal."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from flexmotion.streamer.checks.latency_result import HISTOGRAM_US, LatencyResult

_BAR = 40
_EIGHTHS = " ▏▎▍▌▋▊▉█"


def render_latency(result: LatencyResult) -> RenderableType:
    """Verdict, stages against their budgets, histogram of lateness."""
    return Group(_verdict(result), Text(), _stages(result), Text(), _histogram(result), _counts(result))


def _verdict(result: LatencyResult) -> Text:
    reasons = "; ".join(result.failures) or "every budget kept"
    return Text.assemble(
        ("PASS" if result.ok else "FAIL", "bold green" if result.ok else "bold red"),
        f" {result.seconds:.1f} s at {result.rate_hz:g} Hz, {result.switches} switches: {reasons}",
    )


def _stages(result: LatencyResult) -> Table:
    apart = () if result.standstills is None else ("p99 apart", "max apart")
    table = Table("Stage", "p50", "p99", "p99.9", "max", "budget p99", *apart, title="Times [ms]", title_justify="left")
    for name, stage in result.stages.items():
        budget = "" if stage.budget_ms is None else f"{stage.budget_ms:g}"
        style = "red" if stage.over else None
        if stage.time is None:
            table.add_row(name, "-", "-", "-", "-", budget)
            continue
        time = stage.time
        figures = [f"{ms:.3g}" for ms in (time.p50, time.p99, time.p99_9, time.max)]
        rest = [] if stage.apart is None else [f"{ms:.3g}" for ms in (stage.apart.p99, stage.apart.max)]
        table.add_row(name, *figures, budget, *rest, style=style)
    return table


def _histogram(result: LatencyResult) -> Table:
    """Ticks by how late the loop woke; bars on a logarithmic scale, since rare ticks matter."""
    table = Table("woke late by [µs]", "ticks", "", box=None, title="Loop lateness", title_justify="left")
    most = max(len(str(count)) for count in result.lateness)
    for lower, upper, count in zip(HISTOGRAM_US, [*HISTOGRAM_US[1:], None], result.lateness, strict=True):
        limits = f"{lower:5.0f} - {upper:.0f}" if upper is not None else f"{lower:5.0f} and more"
        # One full length for every power of ten: 1 shows, 10 shows more.
        length = (len(str(count)) - 1 + count / 10 ** len(str(count))) / most * _BAR if count else 0.0
        table.add_row(limits, str(count), _bar(length))
    return table


def _bar(length: float) -> str:
    whole = int(length)
    return "█" * whole + _EIGHTHS[round((length - whole) * 8)].strip()


def _counts(result: LatencyResult) -> Text:
    memory = ""
    if result.memory_mb is not None:
        memory = f"; loop memory {result.memory_mb[0]:.1f} -> {result.memory_mb[1]:.1f} MB"
    processors = "kept awake" if result.awake else "may sleep"
    return Text(
        f"{result.scheduling} scheduling, processors {processors}, {result.load} hogs; {result.cycles} ticks, "
        f"{result.missed_deadlines} missed; {result.answered} of {result.switches} switches followed, "
        f"{result.late_plans} plans late, {result.underruns} under-runs; {result.violations_sent} goals outside the "
        f"envelope{memory}{_standstills(result)}"
    )


def _standstills(result: LatencyResult) -> str:
    """Standstills of the machine itself, which the program cannot avoid."""
    found = result.standstills
    if found is None or not found.count:
        return ""
    host = f", its host took {found.stolen_ms:.0f} ms" if found.stolen_ms else ""
    return (
        f"\nThe machine itself stood still {found.count} times, {found.total_ms:.0f} ms in all, up to "
        f"{found.longest_ms:.1f} ms (a timer of the highest priority woke that late{host}): "
        f"{found.missed_deadlines} of {result.missed_deadlines} missed deadlines fall into these times; "
        "the columns on the right leave them out"
    )
