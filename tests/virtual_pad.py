"""A gamepad made of nothing: SDL's virtual joystick, by ctypes, in the very SDL that pygame has loaded.

The device exists only inside this process. It reaches the console through SDL's own device list, controller mapping and
event queue, so nothing of pygame is mocked. Let pads come and go from one thread: SDL's device indices shift. Never hold
SDL's own joystick lock here: the pad's thread waits for it inside pygame, with the interpreter's lock in hand.
"""

import ctypes
import re
from ctypes import POINTER, Structure, c_char_p, c_int, c_int16, c_uint8, c_uint16, c_uint32, c_void_p
from functools import cache
from pathlib import Path
from typing import Any

from app.console.gamepad import BUTTONS, load_pygame

AXES = {"leftx": 0, "lefty": 1, "rightx": 2, "righty": 3, "lefttrigger": 4, "righttrigger": 5}
TRIGGERS = ("lefttrigger", "righttrigger")
BUTTON_INDEX = {name: index for index, name in BUTTONS.items()}

_INIT_GAMECONTROLLER = 0x2000
_TYPE_UNKNOWN, _TYPE_GAMECONTROLLER = 0, 1
_FULL = 32767
_REFERENCES = 1000
"""pygame's modules quit subsystems that they found initialised; this many references outlast every `Gamepad` of a run."""


class _Description(Structure):
    """SDL_VirtualJoystickDesc, version 1. All callbacks stay NULL."""

    _fields_ = (
        ("version", c_uint16),
        ("type", c_uint16),
        ("naxes", c_uint16),
        ("nbuttons", c_uint16),
        ("nhats", c_uint16),
        ("vendor_id", c_uint16),
        ("product_id", c_uint16),
        ("padding", c_uint16),
        ("button_mask", c_uint32),
        ("axis_mask", c_uint32),
        ("name", c_char_p),
        ("userdata", c_void_p),
        ("callbacks", c_void_p * 6),
    )


@cache
def sdl() -> Any:
    """pygame's SDL with its controllers initialised, once a process; they stay, so that pads outlive a `Gamepad`."""
    load_pygame()
    mapped = Path("/proc/self/maps").read_text(encoding="utf-8")
    library = ctypes.CDLL(re.findall(r"\S*libSDL2-2\S*", mapped)[0])
    signatures: dict[str, tuple[Any, list[Any]]] = {
        "SDL_InitSubSystem": (c_int, [c_uint32]),
        "SDL_GetError": (c_char_p, []),
        "SDL_NumJoysticks": (c_int, []),
        "SDL_JoystickAttachVirtualEx": (c_int, [POINTER(_Description)]),
        "SDL_JoystickDetachVirtual": (c_int, [c_int]),
        "SDL_JoystickGetDeviceInstanceID": (c_int, [c_int]),
        "SDL_JoystickOpen": (c_void_p, [c_int]),
        "SDL_JoystickClose": (None, [c_void_p]),
        "SDL_JoystickSetVirtualAxis": (c_int, [c_void_p, c_int, c_int16]),
        "SDL_JoystickSetVirtualButton": (c_int, [c_void_p, c_int, c_uint8]),
        "SDL_JoystickUpdate": (None, []),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    for _ in range(_REFERENCES):
        _check(library, library.SDL_InitSubSystem(_INIT_GAMECONTROLLER))
    return library


class VirtualPad:
    """One pad. With `mapped=False` SDL knows no controller mapping for it; with `axes=0` it is like a headset."""

    def __init__(self, name: str = "Test Pad", *, axes: int = 6, mapped: bool = True) -> None:
        self.name = name
        self._sdl = sdl()
        kind = _TYPE_GAMECONTROLLER if mapped else _TYPE_UNKNOWN
        self._description = _Description(1, kind, axes, 15, 0, 0x1234, 0x5678, name=name.encode())
        self._instance: int | None = None
        self._joystick = None
        self.attach()

    def attach(self) -> None:
        """Plug it in, at rest; after a `detach` SDL sees a new instance of the same kind of pad."""
        index = _check(self._sdl, self._sdl.SDL_JoystickAttachVirtualEx(ctypes.byref(self._description)))
        self._instance = self._sdl.SDL_JoystickGetDeviceInstanceID(index)
        self._joystick = self._sdl.SDL_JoystickOpen(index)
        for trigger in TRIGGERS[: max(0, self._description.naxes - 4)]:
            self.axis(trigger, 0.0)

    def detach(self) -> None:
        """Pull it out; once is enough."""
        if self._instance is None:
            return
        for index in range(self._sdl.SDL_NumJoysticks()):
            if self._sdl.SDL_JoystickGetDeviceInstanceID(index) == self._instance:
                _check(self._sdl, self._sdl.SDL_JoystickDetachVirtual(index))
                break
        self._sdl.SDL_JoystickClose(self._joystick)
        self._instance = self._joystick = None

    def axis(self, name: str, value: float) -> None:
        """Sticks −1…1 (x right, y down), triggers 0…1."""
        low = 0.0 if name in TRIGGERS else -1.0
        if not low <= value <= 1.0:
            raise ValueError(f"{name} goes from {low:.0f} to 1, not to {value}")
        raw = 2.0 * value - 1.0 if name in TRIGGERS else value
        _check(self._sdl, self._sdl.SDL_JoystickSetVirtualAxis(self._joystick, AXES[name], round(raw * _FULL)))

    def update(self) -> None:
        """Let SDL take the settings now, as a device's report would, and put them into the event queue."""
        self._sdl.SDL_JoystickUpdate()

    def button(self, name: str, down: bool = True) -> None:
        """Press or release a button by the console's name for it, e.g. `left_shoulder`."""
        _check(self._sdl, self._sdl.SDL_JoystickSetVirtualButton(self._joystick, BUTTON_INDEX[name], int(down)))


def _check(library: Any, result: int) -> int:
    if result < 0:
        raise RuntimeError(f"SDL: {library.SDL_GetError().decode()}")
    return result
