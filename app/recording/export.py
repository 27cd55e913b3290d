"""Exports of a recording: tables for analysis, a scene and plots to share, a report to file."""

import csv
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Final, Literal

import numpy as np

from app.recording.container import RecordingError
from app.recording.reader import Recording
from app.recording.tables import Column, batches, wanted_columns

Kind = Literal["csv", "parquet", "npz", "viser", "png", "report"]
KINDS: Final[tuple[Kind, ...]] = ("csv", "parquet", "npz", "viser", "png", "report")


def export(source: Path, kinds: Sequence[Kind], wanted: Sequence[str], folder: Path | None) -> list[Path]:
    """Write the exports; returns what was written.

    Raises:
        RecordingError: it is no recording, has no such channel, or the folder cannot be written.
    """
    with Recording(source) as recording:
        target = folder or source.with_name(source.name.removesuffix(".mcap"))
        selection = wanted_columns(recording, wanted)
        written: list[Path] = []
        try:
            target.mkdir(parents=True, exist_ok=True)
            for kind in kinds:
                written += _export(recording, kind, selection, target)
        except OSError as error:
            raise RecordingError(f"{target}: cannot be written: {error.strerror}") from None
        for warning in recording.warnings:
            print(f"cobra-teleop: {warning}", file=sys.stderr)
    return written


def _export(recording: Recording, kind: Kind, selection: dict[str, tuple[str, ...]], folder: Path) -> list[Path]:
    # Matplotlib and viser take a while to load: only where they are needed.
    match kind:
        case "csv":
            return [_csv(recording, name, beginnings, folder) for name, beginnings in selection.items()]
        case "parquet":
            return [_parquet(recording, name, beginnings, folder) for name, beginnings in selection.items()]
        case "npz":
            return [_npz(recording, selection, folder)]
        case "viser":
            from app.recording import scene_file  # noqa: PLC0415

            return [scene_file.write(recording, folder / "scene.viser.html")]
        case "png":
            from app.recording import figures  # noqa: PLC0415

            return figures.write(recording, folder)
        case "report":
            from app.recording import report  # noqa: PLC0415

            return [report.write(recording, folder / "report.html")]


def _csv(recording: Recording, channel: str, beginnings: tuple[str, ...], folder: Path) -> Path:
    path = folder / f"{channel}.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        for i, table in enumerate(batches(recording, channel, beginnings)):
            if i == 0:
                writer.writerow(table)
            writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
    return path


def _npz(recording: Recording, selection: dict[str, tuple[str, ...]], folder: Path) -> Path:
    arrays: dict[str, Column] = {}
    for channel, beginnings in selection.items():
        parts = list(batches(recording, channel, beginnings))
        for name in parts[0] if parts else ():
            arrays[f"{channel}.{name}"] = np.concatenate([part[name] for part in parts])
    path = folder / "data.npz"
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return path


def _parquet(recording: Recording, channel: str, beginnings: tuple[str, ...], folder: Path) -> Path:
    if find_spec("pyarrow") is None:
        raise RecordingError("Parquet needs pyarrow: pip install 'cobra-teleop[parquet]', or export --to csv or npz")
    import pyarrow as pa  # noqa: PLC0415 - an extra
    import pyarrow.parquet as pq  # noqa: PLC0415

    path = folder / f"{channel}.parquet"
    writer = None
    try:
        for table in batches(recording, channel, beginnings):
            rows = pa.table({name: pa.array(column.tolist()) for name, column in table.items()})
            writer = writer or pq.ParquetWriter(path, rows.schema, compression="zstd")
            writer.write_table(rows.cast(writer.schema))
        if writer is None:
            pq.write_table(pa.table({"time_s": pa.array([], pa.float64())}), path)
    finally:
        if writer is not None:
            writer.close()
    return path
