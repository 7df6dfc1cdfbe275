"""Whether targets that cannot be done ended as documented."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from benchmarks.shared.outcome import Verdict


def as_documented(runs: Iterable[Mapping[str, str]], expected: Mapping[str, str]) -> Verdict:
    """Whether each target has the state that is expected.

    Args:
        runs: states of the answers by what was asked for, of each run.
        expected: the same as documented.
    """
    others = {what: state for run in runs for what, state in run.items()}
    wrong = [f"{what}: {state}" for what, state in others.items() if state != expected[what]]
    told = f" ({', '.join(wrong)})" if wrong else ""
    right = len(others) - len(wrong)
    return Verdict(f"impossible targets that end as documented: {right} of {len(others)}{told}", not wrong)
