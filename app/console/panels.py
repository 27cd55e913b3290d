"""The panels beside the 3D view: what the robot says, in numbers with units. They only show; nothing here acts.

Each panel is one HTML element that is replaced as a whole: viser's cost is per message. All text is escaped.
"""

import math
from dataclasses import dataclass
from html import escape

import numpy as np
import viser

from app.console.appearance import hex_color, tension_colors
from cobra.description import Drive, RobotDescription
from cobra.messages import RobotState, tensions_of

STYLE = """<style>
.cb{font:12px/1.5 system-ui,sans-serif;font-variant-numeric:tabular-nums;padding:2px 10px 4px}
.cb table{width:100%;border-collapse:collapse;table-layout:fixed}
.cb td,.cb th{padding:1px 0;overflow:hidden;white-space:nowrap;text-overflow:ellipsis;text-align:right;font-weight:400}
.cb td:first-child,.cb th:first-child{text-align:left}
.cb th,.cb .q{opacity:.7}
.cb .row{display:flex;align-items:center;gap:8px;height:17px}
.cb .name{flex:0 0 34px;overflow:hidden;text-overflow:ellipsis}
.cb .bar{flex:1;position:relative;height:8px;border-radius:4px;background:rgba(128,140,155,.25);overflow:hidden}
.cb .bar i{position:absolute;left:0;top:0;bottom:0;border-radius:4px}
.cb .bar b{position:absolute;top:0;bottom:0;width:1px;background:rgba(255,255,255,.55)}
.cb .value{flex:0 0 56px;text-align:right;white-space:nowrap}
.cb .group{margin:5px 0 1px;opacity:.7}
.cb .bad{color:#ff8f85;white-space:normal;text-align:left}
.cb .warn{color:#ffc766}
.cb dl{display:grid;grid-template-columns:112px 1fr;margin:0}
.cb dt{opacity:.7}
.cb dd{margin:0}
</style>"""

PHASES = {
    "disarmed": "disarmed",
    "commissioning": "commissioning",
    "homing": "homing",
    "ready": "ready",
    "driving": "driving",
    "holding": "holding still",
    "stopped": "stopped",
    "fault": "fault",
}
LOAD_UNITS = {"tendon": "N", "feed": "N", "twist": "N·m"}
STALE_S = 0.5
"""Data older than this are shown as old."""
WARM_SHARE = 0.8
"""A motor is shown as warm from this share of its highest temperature on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewTiming:
    """How the console itself keeps up."""

    age_s: float = math.inf
    """Since the newest state arrived."""
    frame_rate_Hz: float = 0.0
    frame_time_s: float = 0.0
    """Spent on a frame, smoothed."""
    viewers: int = 0
    errors: dict[str, int] | None = None


class Panels:
    """The shared panels of one server. Each viewer's own choices go into `plot_tab` and `view_tab`."""

    def __init__(self, server: viser.ViserServer, description: RobotDescription) -> None:
        self._server = server
        self._description = description

    def start(self) -> None:
        gui = self._server.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, control_width="medium")
        gui.set_panel_label(self._description.title)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(300)
        gui.add_html(STYLE)
        self._status = gui.add_html("")
        tabs = gui.add_tab_group()
        self._tendons: viser.GuiHtmlHandle | None = None
        if self._description.tendon_names:
            with tabs.add_tab("Tendons"):
                self._tendons = gui.add_html("")
        with tabs.add_tab("Motors"):
            self._motors = gui.add_html("")
        self.plot_tab = tabs.add_tab("Plot")
        with tabs.add_tab("Timing"):
            self._timing = gui.add_html("")
        self.view_tab = tabs.add_tab("View")

    def update(self, state: RobotState | None, timing: ViewTiming) -> None:
        """Show a state, or that there is none yet. Its lists must match the description (`Scene.update` checks)."""
        with self._server.atomic():
            self._status.content = status_html(state, timing.age_s)
            self._timing.content = timing_html(state, timing, self._description.teleop.loop_rate_Hz)
            if state is not None and self._tendons is not None:
                self._tendons.content = tendons_html(self._description, state)
            if state is not None:
                self._motors.content = motors_html(self._description, state)


def status_html(state: RobotState | None, age_s: float) -> str:
    """One line: what the robot does and how old that is."""
    if state is None:
        return _panel("<span class=q>waiting for the robot</span>")
    cause = f"<div class=q>{escape(state.cause)}</div>" if state.cause else ""
    age = f"<td class={'warn' if age_s > STALE_S else 'q'}>data {_age(age_s)} old</td>"
    return _panel(f"<table><tr><td>{PHASES[state.phase]}</td>{age}</tr></table>{cause}")


def tendons_html(description: RobotDescription, state: RobotState) -> str:
    """A bar a tendon from 0 to the limit, with marks at the lowest tension and at pretension."""
    tendon = description.tendon
    assert tendon is not None
    tensions = tensions_of(description, state)
    limit = tendon.max_tension_N
    marks = "".join(
        f'<b style="left:{100.0 * value / limit:.1f}%"></b>' for value in (tendon.min_tension_N, tendon.pretension_N)
    )
    colors = tension_colors(np.array(tensions, dtype=float), limit)
    rows, shown = [], None
    for i, (name, tension) in enumerate(zip(description.tendon_names, tensions, strict=True)):
        section = description.sections[description.tendon_section[i]].name
        if section != shown:
            rows.append(f"<div class=group>section {escape(section)}</div>")
            shown = section
        share = min(max(tension / limit, 0.0), 1.0) if math.isfinite(tension) else 0.0
        alarm = " bad" if tension > limit else " warn" if tension < tendon.min_tension_N else ""
        rows.append(
            f"<div class=row><span class=name>{escape(name)}</span><span class=bar>"
            f'<i style="width:{100.0 * share:.1f}%;background:{hex_color(colors[i])}"></i>{marks}</span>'
            f'<span class="value{alarm}">{_number(tension, 1, "N")}</span></div>'
        )
    ends = (
        f"<div class=q>0 to {limit:g} N; marks: slack under {tendon.min_tension_N:g} N, "
        f"pretension {tendon.pretension_N:g} N</div>"
    )
    return _panel("".join(rows) + ends)


def motors_html(description: RobotDescription, state: RobotState) -> str:
    """A table: load, temperature, voltage and age of each motor, and its fault in words."""
    head = "<tr><th>motor</th><th style='width:27%'>load</th><th>temp.</th><th>volt.</th><th>age</th></tr>"
    rows = [_motor_rows(description, drive, i, state) for i, drive in enumerate(description.drives)]
    return _panel(f"<table>{head}{''.join(rows)}</table>")


def timing_html(state: RobotState | None, timing: ViewTiming, loop_rate_Hz: float) -> str:
    """Loop, link and view in words."""
    lines: list[tuple[str, str]] = []
    if state is not None:
        loop = state.timing
        lines += [
            ("control loop", f"{loop.rate_Hz:.1f} of {loop_rate_Hz:g} Hz"),
            ("period, median", _ms(loop.period_p50)),
            ("period, 99 %", f"under {_ms(loop.period_p99)}"),
            ("period, longest", _ms(loop.period_max)),
            ("computing, 99 %", f"under {_ms(loop.compute_p99)}"),
            ("late ticks", f"{loop.late}"),
            ("real-time", "scheduled as real-time" if loop.realtime else "not granted by the system"),
            ("link", f"newest state {_age(timing.age_s)} old"),
            ("not obeyed", _counts(state.drops, "commands")),
            ("bus", _counts(state.bus, "frames not usable")),
        ]
    lines += [
        ("3D view", f"{timing.frame_rate_Hz:.1f} frames/s"),
        ("a frame takes", _ms(timing.frame_time_s)),
        ("viewers", f"{timing.viewers}"),
        ("not drawn", _counts(timing.errors or {}, "states")),
    ]
    return _panel("<dl>" + "".join(f"<dt>{name}</dt><dd>{escape(text)}</dd>" for name, text in lines) + "</dl>")


def _motor_rows(description: RobotDescription, drive: Drive, i: int, state: RobotState) -> str:
    drives, motor = state.drives, description.motor_of(drive)
    hot = " class=warn" if drives.temperature[i] > WARM_SHARE * motor.max_temperature_C else ""
    odd = " class=warn" if not motor.min_voltage_V <= drives.voltage[i] <= motor.max_voltage_V else ""
    old = "" if drives.valid[i] else " class=warn"
    load = _number(drives.load[i], 1 if drive.moves != "twist" else 3, LOAD_UNITS[drive.moves])
    row = (
        f"<tr><td>{escape(drive.name)}</td><td>{load}</td>"
        f"<td{hot}>{_number(drives.temperature[i], 0, '°C')}</td>"
        f"<td{odd if math.isfinite(drives.voltage[i]) else ''}>{_number(drives.voltage[i], 1, 'V')}</td>"
        f"<td{old}>{_age(drives.age[i])}</td></tr>"
    )
    fault = f"<tr><td class=bad colspan=5>{escape(drives.fault[i])}</td></tr>" if drives.fault[i] else ""
    return row + fault


def _panel(content: str) -> str:
    return f"<div class=cb>{content}</div>"


def _number(value: float, digits: int, unit: str) -> str:
    return f"{value:.{digits}f} {unit}" if math.isfinite(value) else f"– {unit}"


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.2f} ms"


def _age(seconds: float) -> str:
    """Rounded so that it can be read while it changes."""
    if not math.isfinite(seconds):
        return "–"
    return f"{1e3 * seconds:.0f} ms" if seconds < 1.0 else f"{seconds:.1f} s" if seconds < 100.0 else f"{seconds:.0f} s"


def _counts(counts: dict[str, int], what: str) -> str:
    if not counts:
        return f"no {what}"
    return f"{what}: " + ", ".join(f"{reason} {number}" for reason, number in sorted(counts.items()))
