"""A recording, opened: what it holds, the robot's state at any time, and every message between two times.

Whatever can be shown is shown: what is wrong with a file is told in `warnings`, one line each.
"""

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

import msgspec

from app.recording import channels
from app.recording.channels import STATE, TYPES
from app.recording.container import ChunkPlace, Container, Openable, Record, RecordingError
from app.recording.digest import Digest, Digester
from cobra.description import RobotDescription
from cobra.loading import DescriptionError, parse_description
from cobra.messages import Answered, Event, Judged, Message, RobotState

CACHED_CHUNKS: Final = 16
M = TypeVar("M", bound=Message)


class Timed(NamedTuple):
    """A message and when it happened [s from the start of the recording]."""

    time_s: float
    topic: str
    message: Message


class Recording(Openable):
    """`with Recording(path) as recording`. Times are seconds from its first message."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.warnings: list[str] = []
        """What is wrong with it, one line each, and what to do."""
        self.description: RobotDescription | None = None
        """None when it is missing or of a version that is not understood."""
        self.digest = Digest()
        self.robot = ""
        self.title = ""
        self.start_ns = self.end_ns = 0
        self.unreadable = 0
        """Messages met so far that could not be decoded."""
        self._file = Container(path)
        self._numbers: dict[str, int] = {}
        self._places: list[ChunkPlace] = []
        self._begins: list[int] = []
        self._cache: OrderedDict[int, list[Record]] = OrderedDict()

    @property
    def duration_s(self) -> float:
        return (self.end_ns - self.start_ns) * 1e-9

    @property
    def closed(self) -> bool:
        """Whether it was closed in order."""
        return self._file.closed

    @property
    def topics(self) -> tuple[str, ...]:
        """All channels, Foxglove's and unknown ones too."""
        return tuple(topic.name for topic in self._file.topics.values())

    @property
    def attachments(self) -> dict[str, bytes]:
        return self._file.attachments

    def open(self) -> None:
        """Open the file and its digest.

        Raises:
            RecordingError: it is no recording, or there is nothing in it.
        """
        self._file.open()
        try:
            self._understand()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        self._file.close()

    def state_at(self, time_s: float) -> RobotState | None:
        """The newest state at that time; the first one before it; None when there is none at all."""
        number = self._numbers.get(STATE)
        if number is None or not self._places:
            return None
        time_ns = self.start_ns + round(time_s * 1e9)
        # The last chunk that begins before that time; chunks overlap by fractions of a second.
        first = max(bisect_right(self._begins, time_ns) - 1, 0)
        for place in (*self._places[first::-1][:3], *self._places[first + 1 : first + 3]):
            records = self._states(place, number)
            i = bisect_right(records, time_ns, key=lambda record: record.time_ns) - 1
            if records and (i >= 0 or place is self._places[0] or place.first_ns > time_ns):
                return self._decoded(records[max(i, 0)], RobotState)
        return None

    def states(self, start_s: float = 0.0, end_s: float = float("inf")) -> Iterator[tuple[float, RobotState]]:
        """All states between two times, in order."""
        return self._of(STATE, RobotState, start_s, end_s)

    def events(self) -> Iterator[tuple[float, Event]]:
        return self._of(channels.EVENT, Event)

    def commands(self) -> Iterator[tuple[float, Judged]]:
        return self._of(channels.COMMAND, Judged)

    def requests(self) -> Iterator[tuple[float, Answered]]:
        return self._of(channels.REQUEST, Answered)

    def inputs(self) -> Iterator[tuple[float, channels.Input]]:
        return self._of(channels.INPUT, channels.Input)

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Timed]:
        """Messages of our own channels in the order of the file; those that cannot be read are counted."""
        wanted = {number: name for name, number in self._numbers.items() if topics is None or name in topics}
        for place in self._file.chunks:
            if place.channels is not None and not place.channels & wanted.keys() and place.channels:
                continue
            for record in self._file.records(place, wanted):
                message = self._decoded(record, TYPES[wanted[record.channel]])
                if message is not None:
                    yield Timed((record.time_ns - self.start_ns) * 1e-9, wanted[record.channel], message)

    def _of(
        self, topic: str, kind: type[M], start_s: float = 0.0, end_s: float = float("inf")
    ) -> Iterator[tuple[float, M]]:
        number = self._numbers.get(topic)
        if number is None:
            return
        for place in self._file.chunks:
            first, last = ((time - self.start_ns) * 1e-9 for time in (place.first_ns, place.last_ns))
            if last < start_s or first > end_s or (place.channels and number not in place.channels):
                continue
            for record in self._file.records(place, (number,)):
                time_s = (record.time_ns - self.start_ns) * 1e-9
                if start_s <= time_s <= end_s and (message := self._decoded(record, kind)) is not None:
                    yield time_s, message

    def _states(self, place: ChunkPlace, number: int) -> list[Record]:
        if place.offset in self._cache:
            self._cache.move_to_end(place.offset)
        else:
            self._cache[place.offset] = self._file.records(place, (number,))
            if len(self._cache) > CACHED_CHUNKS:
                self._cache.popitem(last=False)
        return self._cache[place.offset]

    def _decoded(self, record: Record, kind: type[M]) -> M | None:
        try:
            return channels.decode(record.data, kind)
        except msgspec.MsgspecError:
            self.unreadable += 1
            return None

    def _understand(self) -> None:
        file = self._file
        facts = file.metadata.get(channels.METADATA)
        if facts is None and file.profile != channels.PROFILE:
            profile = f"profile {file.profile!r}" if file.profile else "no profile"
            raise RecordingError(
                f"{self.path}: an MCAP file of another program ({profile}), not a recording of a robot"
            )
        facts = facts or {}
        self.robot, self.title = facts.get("robot", ""), facts.get("title", "")
        if not file.closed:
            lost = file.size - file.whole_bytes
            self.warnings.append(
                f"{self.path.name} was not closed"
                + (f": its last {lost} bytes are not whole" if lost else "")
                + f"; what is there is shown (cobra-teleop recover {self.path.name} makes a clean file of it)"
            )
        version = facts.get("format", "")
        if not version.isdigit() or int(version) > channels.FORMAT:
            self.warnings.append(
                f"{self.path.name} was written by a newer cobra-teleop (format {version or 'unknown'}, this one knows "
                f"{channels.FORMAT}): what it does not know is left out"
            )
        names = {topic.name: number for number, topic in file.topics.items()}
        self._numbers = {name: names[name] for name in TYPES if name in names}
        for name in (name for name in TYPES if name not in names):
            self.warnings.append(f"{self.path.name} has no channel {name}: {_MISSING[name]}")
        if not file.chunks:
            raise RecordingError(f"{self.path}: a recording in which nothing was recorded")
        self.start_ns = min(place.first_ns for place in file.chunks)
        self.end_ns = max(place.last_ns for place in file.chunks)
        state = self._numbers.get(STATE)
        self._places = [place for place in file.chunks if not place.channels or state in place.channels]
        self._begins = [place.first_ns for place in self._places]
        self._read_description()
        self._read_digest()

    def _read_description(self) -> None:
        text = self._file.attachments.get(channels.DESCRIPTION)
        if text is None:
            self.warnings.append(f"{self.path.name} has no description of its robot: there is no 3D view")
            return
        try:
            self.description = parse_description(text.decode(), f"{self.path.name}: {channels.DESCRIPTION}")
        except (DescriptionError, UnicodeDecodeError) as error:
            self.warnings.append(f"{error}: there is no 3D view")
        else:
            self.title = self.title or self.description.title

    def _read_digest(self) -> None:
        data = self._file.attachments.get(channels.DIGEST)
        if data is not None:
            try:
                self.digest = msgspec.json.decode(data, type=Digest)
            except msgspec.MsgspecError:
                self.warnings.append(f"{self.path.name}: its digest cannot be read; it is made anew")
            else:
                self._take_times()
                return
        self.digest = digest_of(self)
        self._take_times()

    def _take_times(self) -> None:
        """From the first to the last of what the robot said; the recorder's own notes lie around it."""
        if self.digest.states:
            self.start_ns = self.digest.started_ns
            self.end_ns = self.start_ns + round(self.digest.duration_s * 1e9)


_MISSING: Final = {
    STATE: "there is no motion to show",
    channels.COMMAND: "what was commanded is not known",
    channels.REQUEST: "what was asked of the robot is not known",
    channels.EVENT: "events and alarms are not known",
    channels.INPUT: "the sticks are not known, so it cannot drive",
    channels.RECORDER: "how the recording itself went is not known",
}


def digest_of(recording: Recording, recovered: str = "") -> Digest:
    """The digest of a file that has none, from all its messages."""
    digester = Digester(recording.robot, recording.description)
    zero = recording.start_ns
    for time_s, _, message in recording.messages((STATE, channels.EVENT, channels.COMMAND, channels.RECORDER)):
        time_ns = zero + round(time_s * 1e9)
        if isinstance(message, RobotState):
            digester.state(message, time_ns)
        elif isinstance(message, Event):
            digester.event(message, time_ns)
        elif isinstance(message, Judged):
            digester.judged(message)
        elif isinstance(message, channels.RecorderState):
            digester.dropped = max(digester.dropped, message.dropped)
    return digester.result(recovered)
