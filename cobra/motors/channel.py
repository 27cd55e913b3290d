"""One CAN channel over python-can: opened, written, read, watched; looked for again when it is gone.

Whatever is wrong with the adapter becomes one `BusError` in words. A channel that failed stays failed until a side thread has
opened it anew, with nothing queued: no frame from before reaches a motor afterwards. Whoever uses the channel then finds
`interrupted` set, and must probe its motors before it commands them.
"""

import contextlib
import errno
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any, Final

import can

from cobra.clock import Clock
from cobra.description import Bus
from cobra.motors.bus import BusError, ChannelHealth
from cobra.motors.frame_bits import frame_bits
from cobra.motors.serial_reading import read_ahead

CHANNEL_ERRORS: Final = (can.CanError, OSError, ValueError, ImportError, NotImplementedError)
"""What python-can's interfaces raise when a channel cannot be opened or is gone."""
SEND_TIMEOUT_S: Final = 0.005
"""An interface may wait so long for room in its transmit queue; more than a burst takes on the wire at 1 Mbit/s."""
SERIAL_SEND_TIMEOUT_S: Final = {"slcan": 0.25}
"""Its driver counts the time in which this process is not scheduled, and gives up what it has just written: on a busy machine
5 ms would lose an adapter that is well."""
MAX_STALE_FRAMES: Final = 4096
"""Frames thrown away at once; a flood must not keep the loop from its work."""
MAX_GARBLED: Final = 64
"""Unreadable lines in a row before waiting for the next burst."""
REOPEN_PERIOD_S: Final = 1.0
SAMPLED: Final = 11
"""Every 11th frame's bits are counted exactly and the others taken as their mean: a full count would cost 7 µs a frame."""
LOAD_WINDOW_S: Final = 1.0
DRAIN_WAIT_S: Final = {"slcan": 0.0005}
"""A serial adapter's acknowledgements end a read that does not wait, with frames still behind them."""

_ADVICE = {
    "socketcan": "bring it up with `ip link set {channel} up type can bitrate {bitrate} restart-ms 100` and "
    "`ip link set {channel} txqueuelen 100`; `ip link` lists what there is",
    "slcan": "check that the adapter is plugged in, its device path, and that you may open it (group dialout)",
    "gs_usb": "check that the adapter is plugged in and install the driver: pip install 'python-can[gs-usb]'",
    "pcan": "check that the adapter is plugged in and install the vendor's PCAN-Basic library",
}
_LINUX_ERROR_FRAMES: Final = frozenset({"socketcan", "gs_usb", "cobra-sim"})
"""Interfaces whose error frames say by Linux' bits (linux/can/error.h) what is wrong."""
_CONTROLLER, _BUS_OFF, _RESTARTED = 0x004, 0x040, 0x100
_OVERFLOW, _WARNING, _PASSIVE, _ACTIVE_AGAIN = 0x03, 0x0C, 0x30, 0x40

Record = Callable[[can.Message, bool], None]
"""Called with every frame and whether it was received; must not keep the message, whose bytes are used again."""


class Channel:
    """Frames out and in, one caller at a time."""

    def __init__(self, bus: Bus, clock: Clock, options: dict[str, Any], counts: Counter[str]) -> None:
        self.described = bus
        self.clock = clock
        self.counts = counts
        self.record: Record | None = None
        self.interrupted = False
        """The channel was gone and is there again; its user clears it."""
        self.waited_s = 0.0
        self.told_off = False
        """The adapter said bus-off, and nothing was received since."""
        self.listeners: dict[int, Callable[[bytearray], None]] = {}
        """By frame id, who takes the data of frames that come unasked and are no drive's."""
        self._options = options
        self._bus: can.BusABC | None = None
        self._sent = False
        """Something, since the adapter was opened."""
        self._broken = ""
        self._warning = ""
        self._reopener: _Reopener | None = None
        self._send_timeout_s = SERIAL_SEND_TIMEOUT_S.get(bus.interface, SEND_TIMEOUT_S)
        self._drain_wait_s = DRAIN_WAIT_S.get(bus.interface, 0.0)
        self._frames = 0
        self._sampled_frames = self._sampled_bits = 0
        self._window: tuple[float, int] = (clock.now(), 0)
        self._rate_Hz = 0.0

    @property
    def label(self) -> str:
        return f"bus {self.described.name!r} ({self.described.interface} {self.described.channel})"

    @property
    def health(self) -> ChannelHealth:
        """Load over the last second, and what is wrong with the channel."""
        now = self.clock.now()
        since, frames = self._window
        if now - since >= LOAD_WINDOW_S:
            self._rate_Hz = (self._frames - frames) / (now - since)
            self._window = (now, self._frames)
        bits = self._sampled_bits / self._sampled_frames if self._sampled_frames else 0.0
        return ChannelHealth(
            name=self.described.name,
            load=self._rate_Hz * bits / self.described.bitrate,
            frame_rate_Hz=self._rate_Hz,
            trouble=self._broken or self._warning,
        )

    # -- life -----------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Raises BusError."""
        self._broken = self._warning = ""
        self._bus, self._sent = self._opened(), False

    def close(self) -> None:
        if self._reopener is not None:
            self._reopener.stop()
            self._reopener = None
        bus, self._bus = self._bus, None
        _shut(bus)

    def check_open(self) -> None:
        """Take the channel over when it was found again. Raises BusError while it is gone."""
        self._open_bus()

    def purge(self) -> None:
        """Throw away what still waits to be sent, and what was received. Raises BusError."""
        bus = self._open_bus()
        try:
            # Most interfaces cannot: those that queue in the kernel drop the queue when the channel goes down.
            with contextlib.suppress(NotImplementedError):
                bus.flush_tx_buffer()
            serial = getattr(bus, "serialPortOrig", None)
            # Before the first frame only the commands that open the adapter wait there, and it needs them.
            if serial is not None and self._sent:
                serial.reset_output_buffer()
                serial.write(b"\r")  # ends the line that this may have cut
        except CHANNEL_ERRORS as error:
            raise self.gone("purging", error) from error
        self.drain(lambda _: None)

    # -- frames ---------------------------------------------------------------------------------------------------

    def send(self, message: can.Message, deadline_s: float) -> None:
        """Hand over one frame; waits for room in the transmit queue until the deadline. Raises BusError."""
        bus = self._open_bus()
        self._sent = True
        began_s = self.clock.now()
        while True:
            try:
                bus.send(message, self._send_timeout_s)
                break
            except CHANNEL_ERRORS as error:
                # A kernel queue shorter than a burst drains as the frames go out.
                full = errno.ENOBUFS in (getattr(error, "error_code", None), getattr(error, "errno", None))
                now = self.clock.now()
                if not full:
                    raise self.gone("sending", error) from error
                if now >= deadline_s:
                    raise self._jammed(error) from error
                self.counts["transmit queue full"] += 1
                self.clock.sleep_until(now + 0.0002)
        self.waited_s += self.clock.now() - began_s
        self._count(message)
        if self.record is not None:
            self.record(message, False)

    def receive(self, timeout_s: float) -> can.Message | None:
        """The next frame, of any kind. Raises BusError when the channel is gone."""
        bus = self._open_bus()
        for _ in range(MAX_GARBLED):
            began_s = self.clock.now()
            try:
                message = bus.recv(timeout_s)
            except (ValueError, IndexError):
                # A serial adapter's line that is no frame.
                self.counts["garbled frame"] += 1
                timeout_s = 0.0
                continue
            except CHANNEL_ERRORS as error:
                raise self.gone("receiving", error) from error
            self.waited_s += self.clock.now() - began_s
            if message is None:
                return None
            if self.record is not None:
                self.record(message, True)
            if message.is_error_frame:
                self._take_error(message)
            else:
                self.told_off = False
                self._count(message)
            return message
        return None

    def drain(self, take: Callable[[can.Message], None]) -> None:
        """Show `take` every usable frame that is there already. Raises BusError."""
        for _ in range(MAX_STALE_FRAMES):
            message = self.receive(self._drain_wait_s)
            if message is None:
                return
            if self.usable(message):
                take(message)

    def usable(self, message: can.Message) -> bool:
        """A plain data frame from somebody else that nobody listens for; what is none is counted."""
        if message.is_error_frame:
            return False
        if message.is_remote_frame:
            self.counts["remote frame"] += 1
        elif message.is_extended_id:
            self.counts["extended frame"] += 1
        elif message.is_fd:
            self.counts["FD frame"] += 1
        elif not message.is_rx:
            self.counts["own frame"] += 1
        elif (take := self.listeners.get(message.arbitration_id)) is not None:
            take(message.data)
        else:
            return True
        return False

    # -- what goes wrong ------------------------------------------------------------------------------------------

    def gone(self, doing: str, error: BaseException) -> BusError:
        """Give the channel up, have it looked for in the background, and say so."""
        return self._give_up(
            f"{self.label}: {doing} failed: {one_line(error)}; check the adapter, the cable, the drives' power and the "
            "termination. It is looked for again every second"
        )

    def check_off(self) -> None:
        """To be called when everybody is silent: is the adapter off the bus? Raises BusError if so.

        Some adapters tell it by an error frame, some in their state only.
        """
        bus = self._open_bus()
        try:
            off = self.told_off or bus.state is can.BusState.ERROR
        except CHANNEL_ERRORS as error:
            raise self.gone("asking its state", error) from error
        if off:
            self.counts["bus-off"] += 1
            raise self._give_up(
                f"{self.label}: bus-off: the adapter saw too many errors and left the bus; check bit rate, cable and "
                "termination. It is opened again every second"
            )

    def _take_error(self, message: can.Message) -> None:
        self.counts["error frame"] += 1
        if self.described.interface not in _LINUX_ERROR_FRAMES:
            return
        kind, data = message.arbitration_id, bytes(message.data).ljust(8, b"\0")
        if kind & _BUS_OFF:
            self.told_off = True
        elif kind & _RESTARTED or (kind & _CONTROLLER and data[1] & _ACTIVE_AGAIN):
            self._warning = ""
        elif kind & _CONTROLLER and data[1] & _OVERFLOW:
            self.counts["adapter overflow"] += 1
        elif kind & _CONTROLLER and data[1] & (_WARNING | _PASSIVE):
            level = "error passive" if data[1] & _PASSIVE else "many errors"
            self._warning = f"{level}: check cable, termination and bit rate"

    def _jammed(self, error: BaseException) -> BusError:
        return self._give_up(
            f"{self.label}: the transmit queue stays full ({one_line(error)}): nobody takes the frames; check the drives' "
            "power, bit rate and termination. It is opened again every second, without what was queued"
        )

    def _give_up(self, why: str) -> BusError:
        bus, self._bus = self._bus, None
        self._broken, self.told_off = why, False
        self._reopener = _Reopener(bus, self._opened)
        self._reopener.start()
        return BusError(why)

    def _open_bus(self) -> can.BusABC:
        if self._bus is None and self._reopener is not None and self._reopener.bus is not None:
            self._bus, self._reopener = self._reopener.bus, None
            self._sent = False
            self._broken = self._warning = ""
            self.interrupted = True
        if self._bus is None:
            raise BusError(self._broken or f"{self.label} is not open; open it first")
        return self._bus

    def _opened(self) -> can.BusABC:
        bus = self.described
        try:
            opened = can.Bus(
                interface=bus.interface, channel=bus.channel, bitrate=bus.bitrate, ignore_config=True, **self._options
            )
            read_ahead(opened)
            return opened
        except CHANNEL_ERRORS as error:
            advice = _ADVICE.get(bus.interface, "check buses.interface, buses.channel and buses.options")
            advice = advice.format(channel=bus.channel, bitrate=bus.bitrate)
            raise BusError(f"{self.label} cannot be opened: {one_line(error)}; {advice}") from error

    def _count(self, message: can.Message) -> None:
        self._frames += 1
        if self._frames % SAMPLED == 0 and len(message.data) <= 8:
            self._sampled_frames += 1
            self._sampled_bits += frame_bits(message.arbitration_id, message.data)


class _Reopener:
    """Closes what is left of an adapter and tries to open it again, in a thread of its own: opening may take seconds."""

    def __init__(self, left: can.BusABC | None, open_: Callable[[], can.BusABC]) -> None:
        self.bus: can.BusABC | None = None
        """The new one, once it is there."""
        self._left = left
        self._open = open_
        self._stopped = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="reopen-can", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """Does not wait for an interface that is just being opened; that one is closed when it is."""
        with self._lock:
            self._stopped.set()
            bus, self.bus = self.bus, None
        _shut(bus)

    def _run(self) -> None:
        _shut(self._left)
        self._left = None
        while not self._stopped.wait(REOPEN_PERIOD_S):
            try:
                bus = self._open()
            except BusError:
                continue
            with self._lock:
                if not self._stopped.is_set():
                    self.bus = bus
                    return
            _shut(bus)


def _shut(bus: can.BusABC | None) -> None:
    if bus is not None:
        with contextlib.suppress(*CHANNEL_ERRORS):  # an adapter that was pulled out cannot be closed in order
            bus.shutdown()


def one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
