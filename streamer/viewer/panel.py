"""The panel beside the scene: state, timing and torques as text, and checkboxes for the layers."""

from __future__ import annotations

from collections.abc import Callable
from html import escape

import viser

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.plots.palette import FAINT, INK, MIDDLE, MUTED, WARN
from flexmotion.streamer.viewer.colours import COM, DCM, FORCE, SIDES, ZMP
from flexmotion.streamer.viewer.from_above import draw_from_above
from flexmotion.streamer.viewer.health import WINDOW_S, Health

_STATE_COLOURS = {
    State.OFF: MUTED,
    State.READY: "#0072b2",
    State.STREAMING: MIDDLE,
    State.HOLD: "#0072b2",
    State.PARK: "#b45309",
    State.DAMPED: WARN,
    State.FAULT: WARN,
}
_JOINTS = 5
"""Joints in the list of torques."""
_HIGH = 0.8
"""Share of a servo's usable torque above which its bar is red."""


class Panel:
    """Text that is sent only when it changes, and one checkbox for each layer of the scene."""

    def __init__(self, gui: viser.GuiApi, title: str) -> None:
        self.title = title
        self._text = gui.add_html("")
        self._gui, self._layers = gui, gui.add_folder("Show", expand_by_default=False)

    def toggle(self, label: str, hint: str, act: Callable[[bool], None]) -> None:
        """Add a checkbox, initially on; `act` is called with its new value, in a thread of the server."""
        with self._layers:
            box = self._gui.add_checkbox(label, True, hint=hint)

        @box.on_update
        def _(_: viser.GuiEvent[viser.GuiCheckboxHandle]) -> None:
            act(box.value)

    def show(self, health: Health) -> None:
        """Show the present figures."""
        text = render(self.title, health)
        if text != self._text.content:
            self._text.content = text


def render(title: str, health: Health) -> str:
    """The panel's text as HTML."""
    state = health.state
    row = health.row
    badge = (
        f'<span style="background:{_STATE_COLOURS[state]};color:white;border-radius:4px;padding:2px 8px;'
        f'font-weight:600">{state.name}</span>'
    )
    figures = [
        ("Woke late", _ms(health.lateness_s(50)), _ms(health.lateness_s(99))),
        ("Loop work", _ms(health.work_s(50)), _ms(health.work_s(99))),
    ]
    if row is not None:
        figures.append(("Tick", str(int(row["tick"])), f"{health.time_s:.1f} s"))
        figures.append(("Plan", str(int(row["plan"])) if row["plan"] else "none", f"{int(row['late_plans'])} late"))
        figures.append(("Missed periods", str(int(row["missed_deadlines"])), f"{int(row['underruns'])} underruns"))
    table = "".join(
        f'<tr><td style="color:{MUTED}">{name}</td><td>{first}</td><td>{second}</td></tr>'
        for name, first, second in figures
    )
    bars = "".join(_bar(load.joint, load.share) for load in health.hardest(_JOINTS))
    above = "" if row is None else draw_from_above(row, health.robot)
    events = "".join(
        f"<div>{event.tick / health.robot.rate_hz:.1f} s  {escape(event.message)}</div>" for event in health.events
    )
    return (
        f'<div style="font-size:12px;line-height:1.5;color:{INK};padding:2px 12px 6px;'
        'font-variant-numeric:tabular-nums">'
        f'<div style="display:flex;justify-content:space-between;align-items:center;margin-bottom:4px">'
        f"<b>{escape(title)}</b>{badge}</div>"
        f'<table style="width:100%;border-spacing:0">{table}</table>'
        f'<div style="color:{MUTED}">median and 99th percentile of the last {WINDOW_S:g} s</div>'
        f'<div style="color:{MUTED};margin-top:6px">RMS torque of 1 s, share of usable torque</div>{bars}'
        f'<div style="margin-top:6px">{above}{_legend()}</div>'
        f'<div style="color:{MUTED};margin-top:6px;overflow-wrap:anywhere">{events}</div></div>'
    )


def _ms(seconds: float) -> str:
    return "-" if seconds != seconds else f"{1e3 * seconds:.2f} ms"


def _bar(joint: str, share: float) -> str:
    colour = WARN if share > _HIGH else MIDDLE
    return (
        '<div style="display:flex;align-items:center;gap:6px">'
        f'<span style="width:42%;overflow:hidden;text-overflow:ellipsis">{escape(joint)}</span>'
        f'<span style="flex:1;background:{FAINT};height:7px;border-radius:3px">'
        f'<span style="display:block;width:{100 * min(share, 1.0):.0f}%;background:{colour};height:7px;'
        'border-radius:3px"></span></span>'
        f'<span style="width:34px;text-align:right">{100 * share:.0f} %</span></div>'
    )


def _legend() -> str:
    left, right = SIDES
    marks = (
        ("zero-moment point", ZMP),
        ("divergent component", DCM),
        ("centre of mass", COM),
        ("ground force", FORCE),
        ("left foot", left),
        ("right foot", right),
    )
    dots = "".join(
        f'<span style="white-space:nowrap;margin-right:10px"><span style="display:inline-block;width:8px;height:8px;'
        f'border-radius:4px;background:{colour};margin-right:4px"></span>{name}</span> '
        for name, colour in marks
    )
    return f'{dots}<div style="color:{MUTED}">rings: planned; discs: with feedback, and estimated</div>'
