"""A session on one page of HTML that needs nothing: what it was, who drove, how far, how hard, and what went wrong."""

import base64
import io
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from html import escape
from pathlib import Path

from app.recording import storage
from app.recording.digest import Digest
from app.recording.figures import figures, sample
from app.recording.reader import Recording

STYLE = """
:root{color-scheme:light}body{font:14px/1.5 system-ui,sans-serif;color:#15202a;max-width:960px;margin:28px auto;padding:0 20px}
h1{font-size:22px;margin:0}h2{font-size:15px;margin:26px 0 6px;border-bottom:1px solid #cfd8e0}p.sub{color:#566675;margin:2px 0 18px}
table{border-collapse:collapse;font-variant-numeric:tabular-nums}td,th{padding:2px 18px 2px 0;text-align:left;vertical-align:top;font-weight:400}
th{color:#566675}.facts{display:grid;grid-template-columns:repeat(auto-fill,minmax(180px,1fr));gap:12px}.facts b{display:block;font-size:20px}
.facts span{color:#566675;font-size:12px}.alarm{color:#b3201a}.warning{color:#855400}.marker{color:#0a6c8a}img{width:100%}
.note{border-left:4px solid #855400;background:#fdf6e7;padding:6px 12px}@media print{body{margin:0}}
"""


def write(recording: Recording, path: Path) -> Path:
    """Write the report."""
    path.write_text(page(recording), encoding="utf-8")
    return path


def page(recording: Recording) -> str:
    """The report's HTML; everything that people wrote is escaped."""
    digest, notes = recording.digest, storage.notes_of(recording.path)
    started = datetime.fromtimestamp(recording.start_ns / 1e9, UTC).astimezone()
    parts = [
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(recording.title)} · session</title>",
        f"<style>{STYLE}</style><h1>{escape(recording.title or recording.robot)}: session of {started:%d %B %Y}</h1>",
        f"<p class=sub>{started:%H:%M:%S %Z} · {escape(recording.path.name)}</p>",
        *(f"<p class=note>{escape(text)}</p>" for text in (notes.note, *recording.warnings, digest.recovered) if text),
        _facts(digest),
        _drivers(digest),
        _events(digest),
        _extremes(digest),
        _timing(digest),
        _pictures(recording),
    ]
    return "\n".join(part for part in parts if part)


def _facts(digest: Digest) -> str:
    facts = (
        ("duration", _clock(digest.duration_s)),
        ("driven", _clock(digest.driving_s)),
        ("driver changes", str(max(len(digest.drivers) - 1, 0))),
        ("path of the tip", f"{digest.path_m:.2f} m"),
        ("largest bend", _most(digest.max_bend_deg, "°")),
        ("highest tension", _most(digest.max_tension_N, " N")),
        ("alarms", str(digest.counts.get("alarm", 0))),
        ("faults", str(len(digest.faults))),
    )
    return "<div class=facts>" + "".join(f"<div><span>{n}</span><b>{escape(v)}</b></div>" for n, v in facts) + "</div>"


def _drivers(digest: Digest) -> str:
    rows = [(span.what, _clock(span.start_s), _clock(span.end_s)) for span in digest.drivers]
    return "<h2>Who had the controls</h2>" + _table(("driver", "from", "to"), rows)


def _events(digest: Digest) -> str:
    rows = "".join(
        f"<tr class={event.level}><td>{_clock(event.time_s)}<td>{event.level}<td>{escape(event.text)}"
        for event in digest.events
    )
    faults = "".join(f"<li class=alarm>{escape(fault)}" for fault in digest.faults)
    return f"<h2>Alarms, markers and events</h2><table>{rows or '<tr><td>none'}</table>" + (
        f"<h2>Faults</h2><ul>{faults}</ul>" if faults else ""
    )


def _extremes(digest: Digest) -> str:
    rows = [(f"bend, {name}", f"{value:.1f}°") for name, value in digest.max_bend_deg.items()]
    rows += [(f"tension, {name}", f"{value:.1f} N") for name, value in digest.max_tension_N.items()]
    if digest.max_temperature_C is not None:
        rows.append(("warmest motor", f"{digest.max_temperature_C:.0f} °C"))
    return "<h2>Extremes</h2>" + _table(("what", "most"), rows)


def _timing(digest: Digest) -> str:
    rows = [
        ("loop rate", _unit(digest.loop_rate_Hz, 1.0, "Hz")),
        ("period, 99 % under (worst)", _unit(digest.period_p99_s, 1e3, "ms")),
        ("longest period", _unit(digest.period_max_s, 1e3, "ms")),
        ("late ticks", str(digest.late_ticks)),
        ("commands obeyed", str(digest.obeyed)),
        *((f"commands dropped: {reason}", str(count)) for reason, count in digest.refused.items()),
        ("states recorded", str(digest.states)),
        ("ticks that the recording does not have", str(digest.missed)),
        ("messages that the disk lost", str(digest.dropped)),
    ]
    return "<h2>Timing and recording</h2>" + _table(("what", ""), rows)


def _pictures(recording: Recording) -> str:
    if recording.description is None or not recording.digest.states:
        return ""
    out = []
    for name, figure in figures(recording, sample(recording)).items():
        data = io.BytesIO()
        figure.savefig(data, format="png", dpi=110)
        encoded = base64.b64encode(data.getvalue()).decode()
        out.append(f'<h2>{name.capitalize()}</h2><img alt="{name}" src="data:image/png;base64,{encoded}">')
    return "\n".join(out)


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    cells = "".join("<tr>" + "".join(f"<td>{escape(cell)}" for cell in row) for row in rows)
    return f"<table><tr>{''.join(f'<th>{name}' for name in head)}{cells or '<tr><td>none'}</table>"


def _most(values: dict[str, float], unit: str) -> str:
    if not values:
        return "–"
    name = max(values, key=lambda key: values[key])
    return f"{values[name]:.1f}{unit} ({name})"


def _unit(value: float | None, scale: float, unit: str) -> str:
    return "–" if value is None else f"{value * scale:.2f} {unit}"


def _clock(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))
