"""Writes one MCAP file in small compressed chunks that reach the disk half a second after they happened.

The `mcap` package's own writer closes chunks by their size only and cannot take back a chunk that the disk refused in
the middle. This one uses that package's records, closes chunks when it is told to, and cuts off what was half written,
so that a file on a full disk stays a good file. Layout: header, metadata, schemas, channels, attachments, then chunks
with their message indexes, then the summary (mcap.dev/spec).
"""

import os
import struct
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Final, NamedTuple

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

from app.recording.channels import METADATA, PROFILE

MESSAGE: Final = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence, log time, publish time; the data follow."""
MESSAGE_HEAD: Final = MESSAGE.size - 9
"""Of the above what counts as the record's content."""
COMPRESSION_LEVEL: Final = 3
LIBRARY: Final = f"cobra-teleop {metadata.version('cobra-teleop')}"


class Topic(NamedTuple):
    """One channel of a file, and the JSON Schema of its messages."""

    name: str
    schema_name: str
    schema: bytes


class McapFile:
    """One file being written, by one thread. Fails only with OSError, and is whole up to there.

    `durable`: every chunk waits until the disk has it, so that a power failure takes nothing that was written.
    """

    def __init__(self, path: Path, topics: Sequence[Topic], durable: bool = True) -> None:
        self.path = path
        self.size = 0
        """Bytes that are safely in the file."""
        self.messages = 0
        """Messages that are in the file."""
        self._topics = topics
        self._durable = durable
        self._ids = {topic.name: number for number, topic in enumerate(topics, 1)}
        self._compressor = zstandard.ZstdCompressor(level=COMPRESSION_LEVEL)
        self._descriptor = -1
        self._chunk = bytearray()
        self._indexes: dict[int, list[tuple[int, int]]] = {}
        self._first_ns = self._last_ns = 0
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: Counter[int] = Counter()

    @property
    def pending_bytes(self) -> int:
        """Size of the chunk that is not written yet."""
        return len(self._chunk)

    @property
    def pending_messages(self) -> int:
        return sum(map(len, self._indexes.values()))

    @property
    def descriptor(self) -> int:
        """The open file's descriptor, for locking it."""
        return self._descriptor

    def start(self, facts: Mapping[str, str]) -> None:
        """Create the file, which must not exist, and write what stands before the messages.

        Raises:
            OSError: it cannot be created or written.
        """
        self._descriptor = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o600)
        self._append(MCAP0_MAGIC + _bytes(Header(PROFILE, LIBRARY)))
        record = _bytes(Metadata(METADATA, dict(facts)))
        self._metadata.append(MetadataIndex(self.size, len(record), METADATA))
        self._append(record + b"".join(map(_bytes, self._declarations())))

    def attach(self, name: str, media_type: str, data: bytes, time_ns: int) -> None:
        """Add an attachment. Not while a chunk is pending: `flush` first.

        Raises:
            OSError: it did not fit; the file is as before.
        """
        record = _bytes(Attachment(time_ns, time_ns, name, media_type, data))
        index = AttachmentIndex(self.size, len(record), time_ns, time_ns, len(data), name, media_type)
        self._append(record)
        self._attachments.append(index)

    def add(self, topic: str, log_ns: int, publish_ns: int, data: bytes, sequence: int = 0) -> None:
        """Put a message into the pending chunk; nothing is written yet."""
        channel, indexes = self._ids[topic], self._indexes
        if not indexes:
            self._first_ns = self._last_ns = log_ns
        self._first_ns, self._last_ns = min(self._first_ns, log_ns), max(self._last_ns, log_ns)
        indexes.setdefault(channel, []).append((log_ns, len(self._chunk)))
        head = (Opcode.MESSAGE, MESSAGE_HEAD + len(data), channel, sequence & 0xFFFFFFFF, log_ns, publish_ns)
        self._chunk += MESSAGE.pack(*head)
        self._chunk += data

    def flush(self) -> None:
        """Write the pending chunk and wait until the disk has it.

        Raises:
            OSError: it did not fit: its messages are lost, the file is as before, and further chunks may be tried.
        """
        if not self._indexes:
            return
        plain, indexes, span = bytes(self._chunk), self._indexes, (self._first_ns, self._last_ns)
        self._chunk, self._indexes = bytearray(), {}
        packed = self._compressor.compress(plain)
        chunk = _bytes(Chunk("zstd", packed, span[1], span[0], zlib.crc32(plain), len(plain)))
        tail, offsets = bytearray(), {}
        for channel, entries in indexes.items():
            offsets[channel] = self.size + len(chunk) + len(tail)
            tail += _bytes(MessageIndex(channel, entries))
        index = ChunkIndex(
            chunk_length=len(chunk),
            chunk_start_offset=self.size,
            compression="zstd",
            compressed_size=len(packed),
            message_end_time=span[1],
            message_index_length=len(tail),
            message_index_offsets=offsets,
            message_start_time=span[0],
            uncompressed_size=len(plain),
        )
        self._append(chunk + bytes(tail))
        self._chunks.append(index)
        for channel, entries in indexes.items():
            self._counts[channel] += len(entries)
            self.messages += len(entries)

    def forget(self) -> None:
        """Drop the pending chunk."""
        self._chunk, self._indexes = bytearray(), {}

    def finish(self) -> None:
        """Write the pending chunk and the summary: from now on it is a complete file.

        Raises:
            OSError: it did not fit; what is there can be recovered.
        """
        self.flush()
        end = _bytes(DataEnd(0))
        start = self.size + len(end)
        summary, offsets = bytearray(), bytearray()
        for opcode, records in self._summary():
            group = b"".join(map(_bytes, records))
            if group:
                offsets += _bytes(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        offset_start = start + len(summary)
        summary += offsets
        head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start)
        footer = Footer(start, offset_start, zlib.crc32(head, zlib.crc32(bytes(summary))))
        self._append(end + bytes(summary) + _bytes(footer) + MCAP0_MAGIC)

    def close(self) -> None:
        """Close the file as it is."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _declarations(self) -> list[McapRecord]:
        out: list[McapRecord] = []
        for number, topic in enumerate(self._topics, 1):
            out.append(Schema(number, topic.schema, "jsonschema", topic.schema_name))
            out.append(Channel(number, topic.name, "json", {}, number))
        return out

    def _summary(self) -> list[tuple[Opcode, Sequence[McapRecord]]]:
        declarations = self._declarations()
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._topics),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=self.messages,
            message_end_time=max((index.message_end_time for index in self._chunks), default=0),
            message_start_time=min((index.message_start_time for index in self._chunks), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._topics),
        )
        return [
            (Opcode.SCHEMA, declarations[::2]),
            (Opcode.CHANNEL, declarations[1::2]),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ]

    def _append(self, data: bytes) -> None:
        """All of it, on the disk, or nothing."""
        try:
            rest = memoryview(data)
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
            if self._durable:
                _synchronise(self._descriptor)
        except OSError:
            os.ftruncate(self._descriptor, self.size)
            os.lseek(self._descriptor, self.size, os.SEEK_SET)
            raise
        self.size += len(data)


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _synchronise(descriptor: int) -> None:
    """The data only, where the system knows the difference."""
    getattr(os, "fdatasync", os.fsync)(descriptor)
