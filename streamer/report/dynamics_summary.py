"""Figures of one clip's dynamics for people: rows for a terminal, and an HTML page that needs no network."""

from __future__ import annotations

import base64
from html import escape
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from flexmotion.streamer.report.summary import show, table

MOMENTS = {
    "hip_flexion": "hip flexion",
    "hip_adduction": "hip adduction",
    "knee_flexion": "knee flexion",
    "ankle_dorsiflexion": "ankle",
}
MOST = 4
"""Saturated muscles that are named."""

Row = tuple[str, str, str]


def dynamics_rows(content: dict[str, Any]) -> list[Row]:
    """Name, value and meaning of every figure.

    Args:
        content: `ClipAnalysis.figures`, and of the import `mass_is` (where the mass is from), `belt_m_s` and `notes`.
    """
    body, peak, error = content["body"], content["peak_vertical_force_bw"], content["force_error_mean_bw"]
    rows = [
        ("body", f"{body['mass']:.1f} kg", f"{content['mass_is']}; height {body['height']:.2f} m"),
        (
            "belt",
            show(content["belt_m_s"], "m/s", digits=2) if content["belt_m_s"] else "none",
            "speed of a treadmill, removed" if content["belt_m_s"] else "",
        ),
        (
            "vertical force",
            f"{peak['left']:.2f}, {peak['right']:.2f} BW",
            "greatest on left and right foot, in body weights",
        ),
        (
            "force error",
            f"{100 * error['left']:.1f}, {100 * error['right']:.1f} % BW",
            f"estimated standard error, mean; {100 * content['flagged_share']:.0f} % of the frames are flagged",
        ),
        (
            "residual",
            show(content["residual_force_median_bw"], "% BW", 100, 2),
            f"median, moment {content['residual_moment_median_bw_m']:.4f} BW·m; "
            f"{100 * content['good_share']:.0f} % of the frames are good",
        ),
    ]
    moments = content["peak_moment_nm_per_kg"]
    rows += [
        (
            f"{label} moment",
            f"{moments[f'{name}_l']:.2f}, {moments[f'{name}_r']:.2f} N·m/kg",
            "greatest, left and right",
        )
        for name, label in MOMENTS.items()
    ]
    if "saturated_share" in content:
        rows += _muscle_rows(content)
    return rows


def _muscle_rows(content: dict[str, Any]) -> list[Row]:
    saturated = list(content["saturated_muscles"].items())
    named = ", ".join(f"{name} {100 * share:.0f} %" for name, share in saturated[:MOST])
    more = f" and {len(saturated) - MOST} more" if len(saturated) > MOST else ""
    peaks, stance = content["peak_compression_bw"], content["stance_compression_bw"]
    return [
        *(
            (
                f"{joint} compression",
                ", ".join(f"{value:.1f}" for name, value in peaks.items() if name.startswith(joint)) + " BW",
                ("greatest, left and right" if joint != "lumbar" else "greatest") + _in_stance(stance, joint),
            )
            for joint in ("hip", "knee", "ankle", "lumbar")
        ),
        (
            "saturated",
            f"{100 * content['saturated_share']:.0f} %",
            "of the frames have a leg muscle at its greatest activation" + (f": {named}{more}" if named else ""),
        ),
    ]


def _in_stance(stance: dict[str, float | None], joint: str) -> str:
    """Mean over the stance phases of each leg; of the lumbar joint, which has no phases of its own, nothing."""
    values = [value for name, value in stance.items() if name.startswith(joint)]
    if joint == "lumbar" or all(value is None for value in values):
        return ""
    return "; peak of a stance phase, mean: " + ", ".join("-" if value is None else f"{value:.1f}" for value in values)


def _headline(content: dict[str, Any]) -> str:
    seconds = (content["frames"] - 1) / content["fps"]
    return f"{content['source']}: {content['frames']} frames at {content['fps']:g} Hz, {seconds:.2f} s"


def render_dynamics(content: dict[str, Any]) -> RenderableType:
    """The figures for a terminal."""
    drawn = table("", "", "", "")
    for name, value, meaning in dynamics_rows(content):
        drawn.add_row(name, value, Text(meaning, style="dim"))
    return Group(Text(_headline(content), style="bold"), drawn)


def dynamics_page(content: dict[str, Any], picture: bytes) -> bytes:
    """The figures and a picture (PNG) as one HTML page."""
    rows = "\n".join(
        f"<tr><th>{escape(name)}</th><td>{escape(value)}</td><td>{escape(meaning)}</td></tr>"
        for name, value, meaning in dynamics_rows(content)
    )
    notes = "".join(f"<li>{escape(note)}</li>" for note in content.get("notes", ()))
    text = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Dynamics</title><style>
body {{ font: 14px system-ui, sans-serif; color: #1f2937; max-width: 1300px; margin: 2em auto; padding: 0 1em }}
th {{ text-align: left; font-weight: 600 }} td, th {{ padding: .15em 1em .15em 0; vertical-align: top }}
img {{ width: 100%; margin-top: 1.5em }}
</style></head><body>
<h1>{escape(_headline(content))}</h1>
<table>
{rows}
</table>
{f"<h2>How the file was read</h2><ul>{notes}</ul>" if notes else ""}
<img alt="Ground forces, centre of pressure, residuals, joint moments, muscles and joint contact of the clip"
 src="data:image/png;base64,{base64.b64encode(picture).decode("ascii")}">
</body></html>
"""
    return text.encode()
