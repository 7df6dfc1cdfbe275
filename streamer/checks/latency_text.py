"""The result of `check latency` for a terminal."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from flexmotion.streamer.checks.latency_result import HISTOGRAM_US, LatencyResult

_BAR = 40
_OF = {"all": "", "kept": " in pace", "both": ""}
_STAGES = {
    "loop work": "computing one tick of the control loop",
    "wake lateness": "how late the system wakes the loop for a tick",
    "robot lateness": "how late the simulated robot is, as part of the load",
    "sample": "sampling motion from the model",
    "retarget": "planning that motion for the robot",
    "plan joins after": "from asking for a plan to the tick that takes it",
    "target to command": "from the arrival of a target to the first command that follows it",
    "target to effect": "the same, to the first command that clearly differs from the plan before",
}
_HELP = (
    "What usually helps: end other programs (planner and loop need a processor each), grant realtime scheduling, and "
    "keep the processors at full speed and awake. `flexmotion doctor` says what this machine lacks, and the commands "
    "for it. A virtual machine or a shared one stands still at times: measure again, or on the robot's own computer"
)
_EIGHTHS = " ▏▎▍▌▋▊▉█"


def render_latency(result: LatencyResult) -> RenderableType:
    """Verdict and what usually helps, stages against what is allowed, what they are, histogram of lateness."""
    helps = () if result.ok else (Text(_HELP),)
    parts = (_stages(result), _meanings(result), Text(), _histogram(result), _counts(result))
    return Group(_verdict(result), *helps, Text(), *parts)


def _verdict(result: LatencyResult) -> Text:
    """The verdict; below it of which moments it is, and what was exceeded in the others."""
    style = {"PASS": "bold green", "FAIL": "bold red", "UNFIT": "bold yellow"}
    length = f" {result.seconds:.1f} s at {result.rate_hz:g} Hz, {result.switches} targets"
    found = result.unfit or "; ".join(result.failures_kept) or "nothing took longer than is allowed"
    judged = ""
    if result.standstills is not None:
        share = f"{100 * (1 - result.left_out):.1f} % of the ticks"
        judged = f"\njudged: the times in which the machine itself kept its pace ({share})"
        others = [failure for failure in result.failures if failure not in result.failures_kept]
        judged += f"; in the others as well, not judged: {'; '.join(others)}" if others else ""
    return Text.assemble((result.verdict, style[result.verdict]), f"{length}: {found}{judged}")


def _stages(result: LatencyResult) -> Table:
    title, kept = "Times [ms]", tuple[str, ...]()
    if result.standstills is not None:
        title += '; "in pace": of the times in which the machine itself kept its pace'
        kept = ("median in pace", "99 % in pace", "longest in pace")
    names = ("Stage", "median", "95 %", "99 %", "longest", "allowed")
    table = Table(*names, *kept, title=title, title_justify="left")
    for name, stage in result.stages.items():
        budget = ", ".join(f"{one.name} {one.ms:g}{_OF[one.of]}" for one in stage.bounds)
        if stage.time is None:
            table.add_row(name, "-", "-", "-", "-", budget)
            continue
        time = stage.time
        figures = [f"{ms:.3g}" for ms in (time.p50, time.p95, time.p99, time.max)]
        rest = [] if stage.kept is None else [f"{ms:.3g}" for ms in (stage.kept.p50, stage.kept.p99, stage.kept.max)]
        judged = stage.failures if result.standstills is None else stage.failures_kept
        table.add_row(name, *figures, budget, *rest, style="red" if judged else None)
    return table


def _meanings(result: LatencyResult) -> Table:
    """What each stage is."""
    table = Table(box=None, show_header=False, pad_edge=False)
    for name in result.stages:
        table.add_row(name, _STAGES[name])
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
        f"{result.scheduling} scheduling, processors {processors}, {result.load} busy processes beside it; "
        f"{result.cycles} ticks, "
        f"{result.missed_deadlines} missed; {result.answered} of {result.switches} targets followed, "
        f"{result.late_plans} plans late, {result.taken_late} taken a tick late, {result.underruns} under-runs; "
        f"{result.violations_sent} goals outside the envelope{memory}{_standstills(result)}"
    )


def _standstills(result: LatencyResult) -> str:
    """When the machine itself stood still or was slow, which the program cannot avoid."""
    found, slow, text = result.standstills, result.slowness, ""
    if found is not None and found.count:
        host = f", its host took {found.stolen_ms:.0f} ms" if found.stolen_ms else ""
        text += (
            f"\nThe machine itself stood still {found.count} times, {found.total_ms:.0f} ms in all, up to "
            f"{found.longest_ms:.1f} ms (a timer of the highest priority woke that late{host}): "
            f"{found.missed_deadlines} of {result.missed_deadlines} missed deadlines fall into these times"
        )
    if slow is not None and slow.count:
        share = f"{100 * slow.share:.1f} % of the run, {100 * slow.idle_share:.1f} % before it"
        judged = "it grew with the run's own load, nothing is left out for it" if slow.ours else "left out as well"
        text += (
            f"\nAll its processors were slow at once {slow.count} times, up to {slow.longest_ms:.1f} ms ({share}): "
            f"{judged}"
        )
    return text
