"""An MCAP file read by its chunks, whole or not: through its summary, or record by record where there is none.

Knows nothing of robots. A file that was not closed (power loss, a killed recorder) has no summary; what is whole in it
is found by walking from record to record. A damaged chunk is left out and counted.
"""

import mmap
import os
import struct
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple, Self

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, Header, Metadata, Schema
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from app.recording.mcap_file import MESSAGE, Topic
from cobra.errors import OperatorError

RECORD_HEAD: Final = struct.Struct("<BQ")
CHUNK_TIMES: Final = struct.Struct("<QQ")
INDEX_CHANNEL: Final = struct.Struct("<H")
DAMAGE: Final = (
    McapError,
    CRCValidationError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    KeyError,
    OverflowError,
    MemoryError,
    EOFError,
)
"""What the parts of a damaged file raise."""


class RecordingError(OperatorError):
    """A file that cannot be read as a recording. The message says what it is instead."""


class ChunkPlace(NamedTuple):
    """Where a chunk lies, what time it covers, and which channels are in it (None: not known)."""

    offset: int
    length: int
    first_ns: int
    last_ns: int
    channels: frozenset[int] | None


class Record(NamedTuple):
    """One message."""

    channel: int
    time_ns: int
    publish_ns: int
    sequence: int
    data: bytes


class Openable(ABC):
    """`with` opens it and closes it."""

    @abstractmethod
    def open(self) -> None: ...

    @abstractmethod
    def close(self) -> None: ...

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class Container(Openable):
    """`with Container(path) as file`. Everything but `records` is known once it is open."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = 0
        self.profile = ""
        self.closed = False
        """Whether it was closed in order: it has a summary."""
        self.whole_bytes = 0
        """Up to here the file can be read; of a closed file its size."""
        self.topics: dict[int, Topic] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.chunks: list[ChunkPlace] = []
        """In the order of the file, which is that of time but for fractions of a second."""
        self.damaged_chunks = 0
        """Chunks that turned out to be damaged when they were read."""
        self._damaged: set[int] = set()
        self._map: mmap.mmap | None = None

    def open(self) -> None:
        """Find out what is in it.

        Raises:
            RecordingError: it cannot be opened, or is no MCAP file.
        """
        try:
            with self.path.open("rb") as file:
                self.size = os.fstat(file.fileno()).st_size
                head = file.read(len(MCAP0_MAGIC))
                if self.size and head == MCAP0_MAGIC:
                    self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be opened: {error.strerror}") from None
        if self._map is None:
            what = "empty" if not self.size else "not a recording: it does not begin as an MCAP file does"
            raise RecordingError(f"{self.path}: {what}")
        try:
            self.closed = self._read_summary(self._map)
        except DAMAGE:
            self.closed = False
        if not self.closed:
            self._forget()
            self._walk(self._map)

    def close(self) -> None:
        """Let go of the file."""
        if self._map is not None:
            self._map.close()
            self._map = None

    def records(self, place: ChunkPlace, channels: Collection[int] | None = None) -> list[Record]:
        """The messages of a chunk, of these channels only, in the order of time; none when the chunk is damaged."""
        assert self._map is not None
        try:
            start = place.offset + RECORD_HEAD.size
            chunk = Chunk.read(ReadDataStream(BytesIO(self._map[start : place.offset + place.length])))
            stream, length = get_chunk_data_stream(chunk, validate_crc=True)
            out = list(_messages(stream.read(length), channels))
        except DAMAGE:
            self._damaged.add(place.offset)
            self.damaged_chunks = len(self._damaged)
            return []
        out.sort(key=lambda record: record.time_ns)
        return out

    def _forget(self) -> None:
        self.topics, self.metadata, self.attachments, self.chunks = {}, {}, {}, []

    def _read_summary(self, data: mmap.mmap) -> bool:
        reader = SeekingReader(data, record_size_limit=self.size)  # type: ignore[arg-type]
        summary = reader.get_summary()
        if summary is None:
            return False
        self.profile = reader.get_header().profile
        for number, channel in summary.channels.items():
            self.topics[number] = _topic(channel, summary.schemas)
        self.chunks = [
            ChunkPlace(
                index.chunk_start_offset,
                index.chunk_length,
                index.message_start_time,
                index.message_end_time,
                frozenset(index.message_index_offsets) or None,
            )
            for index in summary.chunk_indexes
        ]
        self.metadata = {entry.name: entry.metadata for entry in reader.iter_metadata()}
        self.attachments = {entry.name: entry.data for entry in reader.iter_attachments()}
        self.whole_bytes = self.size
        return True

    def _walk(self, data: mmap.mmap) -> None:
        """Record by record up to the first that is not whole."""
        schemas: dict[int, Schema] = {}
        place = len(MCAP0_MAGIC)
        try:
            while place + RECORD_HEAD.size <= self.size:
                opcode, length = RECORD_HEAD.unpack_from(data, place)
                end = place + RECORD_HEAD.size + length
                if end > self.size or not 0 < opcode <= max(Opcode):
                    break
                self._take(data, place, end, opcode, schemas)
                self.whole_bytes = place = end
        except DAMAGE:
            return  # what was found before it counts

    def _take(self, data: mmap.mmap, place: int, end: int, opcode: int, schemas: dict[int, Schema]) -> None:
        start = place + RECORD_HEAD.size

        def stream() -> ReadDataStream:
            return ReadDataStream(BytesIO(data[start:end]))

        match opcode:
            case Opcode.HEADER:
                self.profile = Header.read(stream()).profile
            case Opcode.SCHEMA:
                schema = Schema.read(stream())
                schemas[schema.id] = schema
            case Opcode.CHANNEL:
                channel = Channel.read(stream())
                self.topics[channel.id] = _topic(channel, schemas)
            case Opcode.METADATA:
                metadata = Metadata.read(stream())
                self.metadata[metadata.name] = metadata.metadata
            case Opcode.ATTACHMENT:
                attachment = Attachment.read(stream())
                self.attachments[attachment.name] = attachment.data
            case Opcode.CHUNK:
                first, last = CHUNK_TIMES.unpack_from(data, start)
                self.chunks.append(ChunkPlace(place, end - place, first, last, frozenset()))
            case Opcode.MESSAGE_INDEX if self.chunks:
                (channel_id,) = INDEX_CHANNEL.unpack_from(data, start)
                before = self.chunks[-1]
                known = (before.channels or frozenset()) | {channel_id}
                self.chunks[-1] = before._replace(channels=known)


def _topic(channel: Channel, schemas: dict[int, Schema]) -> Topic:
    schema = schemas.get(channel.schema_id)
    return Topic(channel.topic, schema.name if schema else "", schema.data if schema else b"")


def _messages(data: bytes, channels: Collection[int] | None) -> Iterator[Record]:
    place, end = 0, len(data)
    while place < end:
        opcode, length = RECORD_HEAD.unpack_from(data, place)
        after = place + RECORD_HEAD.size + length
        if opcode == Opcode.MESSAGE:
            _, _, channel, sequence, log_ns, publish_ns = MESSAGE.unpack_from(data, place)
            if channels is None or channel in channels:
                yield Record(channel, log_ns, publish_ns, sequence, data[place + MESSAGE.size : after])
        place = after
