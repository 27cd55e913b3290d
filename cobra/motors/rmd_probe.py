"""Find RMD drives on a channel without a description: every address in both dialects, by the id that answers."""

from dataclasses import dataclass, field
from typing import Final

from cobra.description import Protocol
from cobra.motors.rmd import MAX_ADDRESS, RMD_V1, RMD_V3, Dialect, Request, decode, fault_words, model_text
from cobra.motors.rmd_channel import Outgoing, RmdChannel, outgoing, reply_key

TIMEOUT_S: Final = 0.02
ATTEMPTS: Final = 2


@dataclass(frozen=True, slots=True)
class FoundDrive:
    """A drive that answered, and what it says of itself; what its dialect cannot tell is empty."""

    address: int
    protocol: Protocol
    temperature_C: float
    voltage_V: float
    errors: tuple[str, ...] = ()
    model: str = ""
    firmware: str = ""
    details: dict[str, str] = field(default_factory=dict)


def find_rmd(channel: RmdChannel, addresses: range = range(1, MAX_ADDRESS + 1)) -> list[FoundDrive]:
    """Ask every address for its status; moves and writes nothing. Raises BusError: the channel is gone.

    A status request reads the same in both dialects; what answers on 0x240 + address speaks v3.
    """
    found = []
    for address in addresses:
        for dialect in (RMD_V1, RMD_V3):
            status = _ask(channel, dialect, address, "status_1")
            if status is None:
                continue
            flags = int(status["flags"])
            told = FoundDrive(
                address, dialect.name, status["temperature_C"], status["voltage_V"], fault_words(dialect, flags)
            )
            found.append(_named(channel, told) if dialect is RMD_V3 else told)
            break
    return found


def _named(channel: RmdChannel, drive: FoundDrive) -> FoundDrive:
    model = _ask(channel, RMD_V3, drive.address, "model")
    version = _ask(channel, RMD_V3, drive.address, "version")
    return FoundDrive(
        drive.address, drive.protocol, drive.temperature_C, drive.voltage_V, drive.errors,
        model_text(model) if model else "",
        f"{int(version['date'])}" if version else "",
    )  # fmt: skip


def _ask(channel: RmdChannel, dialect: Dialect, address: int, request: Request) -> dict[str, float] | None:
    asked: Outgoing = outgoing(dialect, address, request, {})
    key = reply_key(dialect, address, asked.message.data[0])
    for _ in range(ATTEMPTS):
        if (reply := channel.transact([asked], TIMEOUT_S).get(key)) is not None:
            return decode(dialect, request, reply.data)
    return None
