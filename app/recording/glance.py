"""A look at a recording that costs a few reads, however long it is: for lists of many."""

import os
from io import BytesIO
from pathlib import Path
from typing import IO, Final

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex, Footer, Metadata, SummaryOffset
from mcap.writer import MCAP0_MAGIC

from app.recording import channels
from app.recording.container import DAMAGE, RECORD_HEAD
from app.recording.digest import Digest

FOOTER_BYTES: Final = RECORD_HEAD.size + 20
MOST_BYTES: Final = 64_000_000
"""No record that is looked at here is longer, but in a damaged file."""


def glance(path: Path) -> tuple[dict[str, str], Digest | None]:
    """The facts at a recording's start and its digest; None when it was not closed, {} when it is no recording.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        try:
            return _facts(file), _digest(file, size)
        except (*DAMAGE, msgspec.MsgspecError):
            return {}, None


def _facts(file: IO[bytes]) -> dict[str, str]:
    if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        return {}
    for _ in range(2):  # the header, then ours
        opcode, content = _record(file)
        if opcode == Opcode.METADATA:
            metadata = Metadata.read(ReadDataStream(BytesIO(content)))
            return metadata.metadata if metadata.name == channels.METADATA else {}
    return {}


def _digest(file: IO[bytes], size: int) -> Digest | None:
    place = size - len(MCAP0_MAGIC) - FOOTER_BYTES
    if place < 0:
        return None
    file.seek(place)
    tail = file.read()
    if tail[-len(MCAP0_MAGIC) :] != MCAP0_MAGIC or tail[0] != Opcode.FOOTER:
        return None
    footer = Footer.read(ReadDataStream(BytesIO(tail[RECORD_HEAD.size :])))
    file.seek(footer.summary_offset_start)
    offsets = BytesIO(file.read(place - footer.summary_offset_start))
    while offsets.tell() < len(offsets.getbuffer()):
        offset = SummaryOffset.read(ReadDataStream(BytesIO(_record(offsets)[1])))
        if offset.group_opcode == Opcode.ATTACHMENT_INDEX:
            return _digest_among(file, offset)
    return None


def _digest_among(file: IO[bytes], group: SummaryOffset) -> Digest | None:
    file.seek(group.group_start)
    indexes = BytesIO(file.read(min(group.group_length, MOST_BYTES)))
    while indexes.tell() < len(indexes.getbuffer()):
        index = AttachmentIndex.read(ReadDataStream(BytesIO(_record(indexes)[1])))
        if index.name == channels.DIGEST:
            file.seek(index.offset)
            attachment = Attachment.read(ReadDataStream(BytesIO(_record(file)[1])))
            return msgspec.json.decode(attachment.data, type=Digest)
    return None


def _record(file: IO[bytes]) -> tuple[int, bytes]:
    opcode, length = RECORD_HEAD.unpack(file.read(RECORD_HEAD.size))
    if length > MOST_BYTES:
        raise ValueError(f"a record of {length} bytes")
    return opcode, file.read(length)
