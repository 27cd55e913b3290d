"""`--bus NAME=INTERFACE:CHANNEL`: lead a described bus to another adapter without changing the description."""

from collections.abc import Sequence
from typing import Annotated, Any
from urllib.parse import parse_qsl

import msgspec
import tyro

from cobra.description import Bus, RobotDescription
from cobra.errors import OperatorError

BusRoutes = Annotated[
    tyro.conf.UseAppendAction[tuple[str, ...]],
    tyro.conf.arg(
        metavar="NAME=INTERFACE:CHANNEL",
        help="Lead a described bus to this adapter, e.g. main=socketcan:can0 or main=slcan:/dev/ttyACM0; may be given "
        "again. Options of the interface follow a question mark: main=slcan:/dev/ttyACM0?sleep_after_open=0",
    ),
]


class RouteError(OperatorError):
    """A route that leads nowhere. The message says what would be right."""


def rerouted(description: RobotDescription, routes: Sequence[str]) -> RobotDescription:
    """The description with its buses led to the given adapters.

    Raises:
        RouteError: not of the form NAME=INTERFACE:CHANNEL, or no such bus.
    """
    buses = {bus.name: bus for bus in description.buses}
    for route in routes:
        name, _, rest = route.partition("=")
        if name not in buses:
            raise RouteError(f"--bus {route}: {description.name} has no bus {name!r}; it has {', '.join(buses)}")
        buses[name] = route_of(buses[name], rest, route)
    return msgspec.structs.replace(description, buses=tuple(buses.values()))


def route_of(bus: Bus, rest: str, route: str) -> Bus:
    """The bus led to `INTERFACE:CHANNEL?OPTIONS`; `route` is what was given, for messages. Raises RouteError."""
    interface, _, where = rest.partition(":")
    channel, _, query = where.partition("?")
    if not interface or not channel:
        raise RouteError(f"--bus {route}: must be NAME=INTERFACE:CHANNEL, e.g. {bus.name}=socketcan:can0")
    options = {key: _value(text) for key, text in parse_qsl(query, keep_blank_values=True)}
    return msgspec.structs.replace(bus, interface=interface, channel=channel, options=options)


def _value(text: str) -> Any:
    """A number, true or false where it reads like one, else text."""
    try:
        return msgspec.json.decode(text)
    except msgspec.DecodeError:
        return text
