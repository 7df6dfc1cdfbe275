"""One page about the dynamics of a clip: ground forces, centre of pressure, residuals, moments, muscles, contact."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flexmotion.biomechanics.analysis import SATURATED, ClipAnalysis, MuscleAnalysis
from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.biomechanics.plausibility import RESIDUAL_FORCE, RESIDUAL_MOMENT
from flexmotion.biomechanics.sole import COLUMNS, POINTS, sole_grid
from flexmotion.human.human_model import human_model
from flexmotion.human.signals import runs
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.streamer.plots.palette import INK, LEFT, MIDDLE, MUTED, RIGHT, WARN
from flexmotion.streamer.plots.style import new_figure

Float = NDArray[np.float64]

WIDTH, HEAD, MARGIN = 13.0, 0.6, 0.72
"""Of the page, of its title, and left of the panels [inch]."""
ROWS, MUSCLE_ROWS = (2.6, 2.8, 2.4, 2.4), (5.4, 2.4)
"""Heights of the rows [inch]: forces, pressure and residuals, moments (two); activations, joint contact."""

MAPS = ((0.85, 4.05), (4.85, 8.05), (9.35, 11.95), (12.1, 12.25))
"""Left and right edges of the panels of activations, and of their scale; names of muscles beside them [inch]."""

COLOURS, FEET = (LEFT, RIGHT), ("left", "right")

LEG_MOMENTS = {
    "hip_flexion": "hip flexion",
    "hip_adduction": "hip adduction",
    "hip_rotation": "hip internal rotation",
    "knee_flexion": "knee flexion",
    "ankle_dorsiflexion": "ankle dorsiflexion",
}
LUMBAR_MOMENTS = {
    "lumbar_extension": ("extension", MIDDLE, "-"),
    "lumbar_bending": ("bending", INK, "--"),
    "lumbar_rotation": ("rotation", MUTED, ":"),
}

LEG_MUSCLES = (
    *("psoas", "iliacus", "recfem", "sart", "tfl", "glmax1", "glmax2", "glmax3", "glmed1", "glmed2", "glmed3"),
    *("glmin1", "glmin2", "glmin3", "piri", "addbrev", "addlong", "addmagProx", "addmagMid", "addmagDist"),
    *("addmagIsch", "grac", "bflh", "semimem", "semiten", "bfsh", "vasint", "vaslat", "vasmed", "gasmed"),
    *("gaslat", "soleus", "tibpost", "fdl", "fhl", "perbrev", "perlong", "tibant", "edl", "ehl"),
)
"""Leg muscles from hip to ankle: flexors, abductors, adductors, hamstrings, knee extensors, calf, shin."""

TRUNK_GROUPS = {
    "psoas": "Ps_",
    "rectus abdominis": "rect_abd",
    "external oblique": "EO",
    "internal oblique": "IO",
    "iliocostalis": "IL_",
    "longissimus": "LTp",
    "multifidus": "MF_",
    "quadratus lumborum": "QL_",
}
"""Groups of trunk muscles, and how their names begin."""

OUTLINE = (0, COLUMNS - 1, POINTS - 1, POINTS - COLUMNS)
"""Corners of `sole.sole_grid` around the sole."""

CONTACTS = {"hip": "hip", "knee": "knee", "ankle": "ankle", "lumbar": "lumbar joint"}


def draw_dynamics(clip: ClipAnalysis) -> Figure:
    """The page of a clip."""
    motion = clip.dynamics.motion
    height = HEAD + sum(ROWS) + (sum(MUSCLE_ROWS) if clip.muscles else 0.0)
    subtitle = (
        f"{len(clip)} frames at {motion.fps:g} Hz, low-pass filter {clip.cutoff:g} Hz; "
        f"human of {motion.body.mass:.1f} kg and {motion.body.height:.2f} m; left blue, right orange;\n"
        "red: a force is flagged as uncertain, or the residual or a joint is beyond its limit; "
        "grey: ends, where accelerations are known from one side"
    )
    title = f"Dynamics of {Path(motion.source).name or 'a motion'}"
    figure = new_figure(WIDTH, height, title, subtitle, layout=False)
    tops = HEAD + np.cumsum([0.0, *ROWS, *MUSCLE_ROWS])
    _ground_forces(_panels(figure, tops[0], tops[1], 3), clip)
    _pressure_and_residuals(_panels(figure, tops[1], tops[2], 2, (2.1, 1.0)), clip)
    _moments(_panels(figure, tops[2], tops[3], 3), clip, ("hip_flexion", "hip_adduction", "hip_rotation"))
    _moments(_panels(figure, tops[3], tops[4], 3), clip, ("knee_flexion", "ankle_dorsiflexion", "lumbar"))
    if clip.muscles:
        _activations(figure, tops[4], tops[5], clip, clip.muscles)
        _joint_contact(_panels(figure, tops[5], tops[6], len(CONTACTS)), clip, clip.muscles)
    return figure


def _panels(figure: Figure, top: float, bottom: float, count: int, widths: Sequence[float] | None = None) -> list[Axes]:
    """A row of panels between two distances from the figure's top [inch]; margins hold titles and labels."""
    width, height = figure.get_size_inches()
    cells = figure.add_gridspec(
        1,
        count,
        left=MARGIN / width,
        right=1 - 0.45 * MARGIN / width,
        top=1 - (top + 0.3) / height,
        bottom=1 - (bottom - 0.45) / height,
        wspace=0.22,
        width_ratios=widths,
    )
    return [figure.add_subplot(cells[0, column]) for column in range(count)]


def _ground_forces(panels: Sequence[Axes], clip: ClipAnalysis) -> None:
    """Three components; the error's band is on the vertical one, which is nearly all of the force."""
    titles = ("vertical ground force", "fore-aft ground force, forward positive", "side ground force, left positive")
    along = _horizontal_axes(clip)
    for axes, title, component in zip(panels, titles, ("vertical", "forward", "left"), strict=True):
        for foot, (colour, name) in enumerate(zip(COLOURS, FEET, strict=True)):
            force = clip.forces[:, foot]
            value = force[:, 2] if component == "vertical" else np.sum(force * along[component], axis=1)
            axes.plot(clip.times, value, color=colour, label=name)
            if component == "vertical":
                error = clip.dynamics.force_error[:, foot]
                label = "± standard error" if foot else None
                axes.fill_between(
                    clip.times, value - error, value + error, color=colour, alpha=0.2, linewidth=0, label=label
                )
        _shade(axes, clip.times, np.logical_or(*clip.flagged.T))
        _time_panel(axes, clip, title, "body weights")
    _legend(panels[0])


def _horizontal_axes(clip: ClipAnalysis) -> dict[str, Float]:
    """Forward and left of the pelvis on the floor, (T, 3) each."""
    pelvis = clip.dynamics.segments.rotation[:, 1]
    left = pelvis[:, :, 1] * [1.0, 1.0, 0.0]
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-9)
    return {"left": left, "forward": np.cross(left, [0.0, 0.0, 1.0])}


def _pressure_and_residuals(panels: Sequence[Axes], clip: ClipAnalysis) -> None:
    floor, residuals = panels
    _centre_of_pressure(floor, clip)
    force, moment = clip.dynamics.residual.T
    residuals.plot(clip.times, 100 * force, color=INK, label="force [% BW]")
    residuals.plot(clip.times, 100 * moment, color=MIDDLE, linestyle="--", label="moment [% BW·m]")
    limit = 100 * RESIDUAL_FORCE
    assert RESIDUAL_FORCE == RESIDUAL_MOMENT
    residuals.axhline(limit, color=WARN, linewidth=0.8, linestyle=":", label="limit")
    _shade(residuals, clip.times, ~clip.good)
    _time_panel(residuals, clip, "residual", "% BW, % BW·m")
    residuals.set_ylim(0.0, max(1.25 * limit, 110 * force.max(), 110 * moment.max()))
    _legend(residuals)


def _centre_of_pressure(axes: Axes, clip: ClipAnalysis) -> None:
    """Seen from above, x to the right: paths of the soles, soles in mid-stance, pressure while they carry load."""
    motion, segments = clip.dynamics.motion, clip.dynamics.segments
    assert motion.contacts is not None
    index = human_model(motion.body).body_index
    outline = sole_grid(motion.body)[list(OUTLINE)]
    for foot, (colour, name) in enumerate(zip(COLOURS, FEET, strict=True)):
        segment = index[f"calcaneus_{SIDES[foot]}"]
        corners = segments.position[:, segment, None] + np.einsum("tij,pj->tpi", segments.rotation[:, segment], outline)
        axes.plot(*corners.mean(axis=1)[:, :2].T, color=colour, alpha=0.3, linewidth=0.8)
        loaded = motion.contacts[:, foot]
        for start, stop in runs(loaded):
            axes.fill(*corners[(start + stop) // 2, :, :2].T, color=colour, alpha=0.15, linewidth=0)
        pressure = np.where(loaded[:, None], clip.dynamics.centres[:, foot, :2], np.nan)
        axes.plot(*pressure.T, color=colour, marker=".", markersize=3, label=name)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title("centre of pressure from above, soles in mid-stance, paths of the feet")
    axes.set_xlabel("x, forward in the first frame [m]")
    axes.set_ylabel("y, left [m]")
    _legend(axes)


def _moments(panels: Sequence[Axes], clip: ClipAnalysis, names: Sequence[str]) -> None:
    per_mass = clip.moments / clip.dynamics.motion.body.mass
    for axes, name in zip(panels, names, strict=True):
        if name == "lumbar":
            for joint, (label, colour, style) in LUMBAR_MOMENTS.items():
                value = per_mass[:, JOINTS.index(joint)]
                axes.plot(clip.times, value, color=colour, linestyle=style, label=label)
            _time_panel(axes, clip, "lumbar moments", "N·m/kg")
            _legend(axes)
            continue
        for side, colour, label in zip(SIDES, COLOURS, FEET, strict=True):
            axes.plot(clip.times, per_mass[:, JOINTS.index(f"{name}_{side}")], color=colour, label=label)
        axes.axhline(0.0, color=MUTED, linewidth=0.6)
        _time_panel(axes, clip, f"{LEG_MOMENTS[name]} moment", "N·m/kg")


def _activations(figure: Figure, top: float, bottom: float, clip: ClipAnalysis, muscles: MuscleAnalysis) -> None:
    width, height = figure.get_size_inches()
    lower, upper = 1 - (bottom - 0.45) / height, 1 - (top + 0.3) / height
    *maps, scale = (
        figure.add_axes((left / width, lower, (right - left) / width, upper - lower)) for left, right in MAPS
    )
    colours = colormaps["viridis"].with_extremes(over=WARN)
    rows_of_panels = [(f"{name} leg", _leg_rows(muscles, side)) for name, side in zip(FEET, SIDES, strict=True)]
    rows_of_panels.append(("trunk, mean of each group", _trunk_rows(muscles)))
    half = 0.5 / clip.dynamics.motion.fps
    picture = None
    for axes, (title, content) in zip(maps, rows_of_panels, strict=True):
        values = np.array(list(content.values()))
        picture = axes.imshow(
            values,
            aspect="auto",
            interpolation="nearest",
            extent=(clip.times[0] - half, clip.times[-1] + half, len(values), 0.0),
            vmin=0.0,
            vmax=SATURATED,
            cmap=colours,
        )
        axes.set_yticks(np.arange(len(values)) + 0.5, list(content), fontsize=6.5 if len(values) > 20 else 8)
        axes.tick_params(axis="y", length=0)
        axes.grid(visible=False)
        axes.set_title(f"muscle activations: {title}")
        axes.set_xlabel("time [s]")
    assert picture is not None
    figure.colorbar(picture, cax=scale, extend="max").set_label("activation; red: saturated")


def _leg_rows(muscles: MuscleAnalysis, side: str) -> dict[str, Float]:
    """Activation by muscle of one leg, from hip to ankle."""
    legs = muscles.names[: muscles.legs]
    own = {name.removesuffix(f"_{side}"): column for column, name in enumerate(legs) if name.endswith(f"_{side}")}
    order = [name for name in LEG_MUSCLES if name in own] + [name for name in own if name not in LEG_MUSCLES]
    return {name: muscles.state.activations[:, own[name]] for name in order}


def _trunk_rows(muscles: MuscleAnalysis) -> dict[str, Float]:
    """Mean activation of every group of trunk muscles, left and right."""
    found = {}
    for group, beginning in TRUNK_GROUPS.items():
        for side in SIDES:
            columns = [
                muscles.legs + column
                for column, name in enumerate(muscles.names[muscles.legs :])
                if name.startswith(beginning) and name.endswith(f"_{side}")
            ]
            if columns:
                found[f"{group} {side}"] = muscles.state.activations[:, columns].mean(axis=1)
    return found


def _joint_contact(panels: Sequence[Axes], clip: ClipAnalysis, muscles: MuscleAnalysis) -> None:
    pressed = clip.compression
    for axes, (joint, title) in zip(panels, CONTACTS.items(), strict=True):
        for column, crossing in enumerate(muscles.state.crossings):
            base, _, side = crossing.partition("_")
            if base == joint:
                axes.plot(clip.times, pressed[:, column], color=COLOURS[SIDES.index(side)] if side else MIDDLE)
        _time_panel(axes, clip, f"compression, {title}", "body weights")
        axes.set_ylim(bottom=min(0.0, float(pressed[clip.inner].min())))


def _time_panel(axes: Axes, clip: ClipAnalysis, title: str, unit: str) -> None:
    axes.set_title(title)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(unit)
    axes.set_xlim(clip.times[0], clip.times[-1])
    # Peaks of these frames do not count.
    for first, last in ((0, EDGE), (-EDGE - 1, -1)):
        axes.axvspan(clip.times[first], clip.times[last], color=MUTED, alpha=0.12, linewidth=0)


def _legend(axes: Axes) -> None:
    """Beside the panel's title, where it covers nothing."""
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=3,
        fontsize=7,
        borderaxespad=0.1,
        handlelength=1.4,
        columnspacing=0.9,
        handletextpad=0.4,
    )


def _shade(axes: Axes, times: Float, bad: NDArray[np.bool_]) -> None:
    """Shade the frames that are bad, (T,)."""
    half = 0.5 * (times[1] - times[0])
    for start, stop in runs(bad):
        axes.axvspan(times[start] - half, times[stop - 1] + half, color=WARN, alpha=0.12, linewidth=0)
