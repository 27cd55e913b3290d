"""The `canopen` package on a channel of ours: no thread reads for it, whoever waits for an answer reads the channel himself.

So a lost adapter is noticed where every other is, frames are counted and logged like all others, and tests need no sleep.
"""

import logging
from collections.abc import Callable
from typing import Final

import can
from canopen import Network, RemoteNode
from canopen.sdo.client import SdoClient

from cobra.motors.channel import MAX_STALE_FRAMES, Channel
from cobra.motors.cia402_frames import EMERGENCY, HEARTBEAT, SDO_REPLY
from cobra.motors.cia402_objects import object_dictionary

# What goes wrong is told in one line by whoever asks; the package would tell it a second time, in its own words.
logging.getLogger("canopen").setLevel(logging.CRITICAL)

SDO_TIMEOUT_S: Final = 0.05
"""A drive may take so long for a single answer."""
SDO_ATTEMPTS: Final = 3
SEND_WITHIN_S: Final = 0.02

_LENGTHS: Final = {EMERGENCY: 8, SDO_REPLY: 8, HEARTBEAT: 1}
"""Of the frames that the package unpacks without asking."""


class CanopenChannel(Network):
    """What arrives goes to the subscribers of its id; what nobody wants is counted."""

    def __init__(self, channel: Channel) -> None:
        super().__init__()
        self.channel = channel
        # Unknown ids must not fill the queue of a layer that is not used.
        self.unsubscribe(self.lss.LSS_RX_COBID)

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Raises BusError."""
        message = can.Message(arbitration_id=can_id, is_extended_id=False, is_rx=False, data=data)
        self.channel.send(message, self.channel.clock.now() + SEND_WITHIN_S)

    def take(self, message: can.Message) -> None:
        """Hand a usable frame to its subscribers; never raises for what is in it."""
        node, service = message.arbitration_id & 0x7F, message.arbitration_id & 0x780
        wanted = _LENGTHS.get(service, len(message.data))
        if message.arbitration_id not in self.subscribers:
            self.channel.counts["node never asked" if node and service in _LENGTHS else "unknown id"] += 1
        elif len(message.data) != wanted:
            self.channel.counts["short frame" if len(message.data) < wanted else "long frame"] += 1
        else:
            self.notify(message.arbitration_id, message.data, self.channel.clock.now())

    def read_until(self, done: Callable[[], bool], deadline_s: float) -> bool:
        """Take frames until `done` or the deadline; says which. What is there already is taken even after it."""
        clock = self.channel.clock
        for _ in range(MAX_STALE_FRAMES):
            if done():
                return True
            message = self.channel.receive(max(0.0, deadline_s - clock.now()))
            if message is None:
                break
            if self.channel.usable(message):
                self.take(message)
        return done()


class _Sdo(SdoClient):
    RESPONSE_TIMEOUT = 0.0
    MAX_RETRIES = SDO_ATTEMPTS

    def read_response(self) -> bytes:
        network = self.network
        assert isinstance(network, CanopenChannel)
        network.read_until(lambda: not self.responses.empty(), network.channel.clock.now() + SDO_TIMEOUT_S)
        return bytes(super().read_response())  # type: ignore[no-untyped-call]


class CanopenNode(RemoteNode):
    """A drive on a `CanopenChannel`; its SDO client reads the channel while it waits."""

    def __init__(self, node: int) -> None:
        super().__init__(node, object_dictionary())

    def add_sdo(self, rx_cobid: int, tx_cobid: int) -> SdoClient:
        client = _Sdo(rx_cobid, tx_cobid, self.object_dictionary)  # type: ignore[no-untyped-call]
        self.sdo_channels.append(client)
        if self.has_network():
            self.network.subscribe(client.tx_cobid, client.on_response)
        return client
