"""Makes a clean file of one that was not closed: everything whole in it, a fresh summary, and what was lost in words."""

import time
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import msgspec

from app.recording import channels
from app.recording.channels import DIGEST
from app.recording.container import Container, RecordingError
from app.recording.mcap_file import McapFile
from app.recording.reader import Recording, digest_of


class Recovery(NamedTuple):
    """What became of it."""

    path: Path
    messages: int
    duration_s: float
    end_ns: int
    """Wall clock of the last message."""
    lost_bytes: int
    """At the end of the damaged file, not whole."""
    damaged_chunks: int
    """In its middle."""
    missed: int
    """Ticks of the robot between the first and the last state that are not in it."""
    was_closed: bool

    @property
    def words(self) -> str:
        """What was lost, in one sentence."""
        if self.was_closed and not self.damaged_chunks:
            return "it was closed in order and nothing of it is damaged"
        out = []
        if self.lost_bytes:
            out.append(f"the last {self.lost_bytes} bytes were not whole, which is less than a second of recording")
        if self.damaged_chunks:
            out.append(f"{self.damaged_chunks} damaged chunks of its middle were left out")
        if self.missed:
            out.append(f"{self.missed} ticks of the robot are missing between its first and its last state")
        return "; ".join(out) or "nothing that reached the disk was lost"


def recover(source: Path, target: Path) -> Recovery:
    """Write the clean file.

    Raises:
        RecordingError: the source is no recording, or the target exists or cannot be written.
    """
    if target.exists():
        raise RecordingError(f"{target}: exists already; name another file with --out, or delete it")
    with Container(source) as damaged, Recording(source) as recording:
        file = McapFile(target, list(damaged.topics.values()), durable=False)
        try:
            _copy(damaged, file)
        except OSError as error:
            file.close()
            target.unlink(missing_ok=True)
            raise RecordingError(f"{target}: cannot be written: {error.strerror}") from None
        recovery = Recovery(
            path=target,
            messages=file.messages,
            duration_s=recording.duration_s,
            end_ns=recording.end_ns,
            lost_bytes=damaged.size - damaged.whole_bytes,
            damaged_chunks=damaged.damaged_chunks,
            missed=0,
            was_closed=damaged.closed,
        )
        digest = digest_of(recording)
        recovery = recovery._replace(missed=digest.missed)
        digest = msgspec.structs.replace(digest, recovered=recovery.words)
        file.attach(DIGEST, "application/json", channels.encode(digest), time.time_ns())
        file.finish()
        file.close()
    return recovery


def default_target(source: Path) -> Path:
    """Beside the source: NAME.recovered.mcap."""
    return source.with_name(f"{source.name.removesuffix('.mcap')}.recovered.mcap")


def _copy(damaged: Container, file: McapFile) -> None:
    names = {number: topic.name for number, topic in damaged.topics.items()}
    file.start(damaged.metadata.get(channels.METADATA, {}))
    for name, content in damaged.attachments.items():
        if name != DIGEST:
            kind = "application/toml" if name.endswith(".toml") else "application/json"
            file.attach(name, kind, content, time.time_ns())
    for place in damaged.chunks:
        for record in damaged.records(place, names):
            file.add(names[record.channel], record.time_ns, record.publish_ns, record.data, record.sequence)
        file.flush()


def run_recover(source: Path, out: Path | None) -> int:
    """Recover and say what was lost."""
    recovery = recover(source, out or default_target(source))
    last = f"{datetime.fromtimestamp(recovery.end_ns / 1e9):%H:%M:%S.%f}"[:-5]
    print(f"{recovery.path}: {recovery.messages} messages, {recovery.duration_s:.1f} s, the last at {last}")
    print(f"{source.name}: {recovery.words}.")
    return 0
