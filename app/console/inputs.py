"""The seam that every input device shares: pad, browser, keyboard, script and replay all give `Controls`."""

from typing import Literal, Protocol

import msgspec

Button = Literal[
    "a",
    "b",
    "x",
    "y",
    "back",
    "start",
    "left_shoulder",
    "right_shoulder",
    "left_stick",
    "right_stick",
    "dpad_up",
    "dpad_down",
    "dpad_left",
    "dpad_right",
]


class Controls(msgspec.Struct, frozen=True, kw_only=True):
    """One reading of an input device in SDL's standard game controller layout, before dead zone and expo.

    Sticks are −1…1 with x to the right and y down; triggers 0…1. A device that is gone reads `connected=False`;
    so does one that was plugged in or chosen a moment ago, until its buttons were let go: its buttons can stop, not drive.
    """

    left: tuple[float, float] = (0.0, 0.0)
    right: tuple[float, float] = (0.0, 0.0)
    left_trigger: float = 0.0
    right_trigger: float = 0.0
    buttons: frozenset[Button] = frozenset()
    connected: bool = True
    stamp: float = 0.0
    """When it was read, changed or not [s, the console's monotonic clock]. What comes over a network is stamped on arrival."""
    device: str = ""
    """The pad that was read, where a page has one; empty for its keys and on-screen controls."""
    lag_s: float = 0.0
    """Round trip to the page that read it [s]; 0 for a device on the console's own computer."""


class InputSource(Protocol):
    """Something that gives controls."""

    @property
    def name(self) -> str:
        """What it is, for people."""

    def read(self) -> Controls:
        """The newest controls; never blocks, never raises."""
