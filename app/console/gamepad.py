"""The pad plugged into the console's computer, through SDL's game controller mapping (pygame).

One thread owns SDL: every call into pygame is made there. SDL itself looks at the devices every millisecond, without
Python, and wakes the thread when something changed. On macOS SDL sees pads on the main thread only: there, use the
browser's pad. One `Gamepad` a process, since SDL has one event queue.
"""

import logging
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from msgspec.structs import replace

from app.console.inputs import Button, Controls
from cobra.clock import Clock, SystemClock
from cobra.control.realtime import OTHERS_PRIORITY, ask_for_realtime

log = logging.getLogger(__name__)

REFRESH_MS = 10
"""Without any event the pad is read, and its stamp renewed, this often."""

SDL_ENVIRONMENT = {
    "SDL_VIDEODRIVER": "dummy",  # events need a video driver; we show no window
    "SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS": "1",  # else sticks are dead without the focus that we never have
    "SDL_NO_SIGNAL_HANDLERS": "1",  # else SDL turns SIGTERM into an event that nobody reads
    "PYGAME_HIDE_SUPPORT_PROMPT": "1",
}

# SDL_GameControllerButton and SDL_GameControllerAxis; 5 is the guide button, which belongs to the desktop.
BUTTONS: dict[int, Button] = {
    0: "a",
    1: "b",
    2: "x",
    3: "y",
    4: "back",
    6: "start",
    7: "left_stick",
    8: "right_stick",
    9: "left_shoulder",
    10: "right_shoulder",
    11: "dpad_up",
    12: "dpad_down",
    13: "dpad_left",
    14: "dpad_right",
}
LEFT_X, LEFT_Y, RIGHT_X, RIGHT_Y, LEFT_TRIGGER, RIGHT_TRIGGER = range(6)


def load_pygame() -> Any:
    """pygame with its environment set before SDL reads it.

    Raises:
        ImportError: pygame or a library that it needs is missing.
    """
    os.environ.update(SDL_ENVIRONMENT)
    import pygame  # noqa: PLC0415 - takes 0.2 s and reads the environment
    import pygame._sdl2.controller  # noqa: PLC0415

    return pygame


@dataclass(frozen=True, slots=True)
class Pad:
    """A device with axes that is present."""

    name: str
    """Unique among those present."""
    usable: bool
    """Whether SDL has a controller mapping for it."""
    chosen: bool


@dataclass(frozen=True, slots=True)
class _Device:
    """An open device. `controller` is None where SDL has no mapping."""

    instance: int
    guid: str
    name: str
    joystick: Any
    controller: Any


class Gamepad:
    """An `InputSource`: the chosen pad.

    The first usable pad that is seen is chosen. No other takes over, even when it goes away; it is taken up again when
    it comes back. After a pad came, went or was chosen, the readings are not `connected` until all buttons are up.
    """

    def __init__(self, on_change: Callable[[Controls], None] | None = None, clock: Clock | None = None) -> None:
        """`on_change` is called in the pad's thread, at once, with every reading that differs from the one before."""
        self._on_change = on_change
        self._clock: Clock = clock or SystemClock()
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()
        self._newest = Controls(connected=False)
        self._pads: tuple[Pad, ...] = ()
        self._name = "pad"
        self._wanted: str | None = None
        self._devices: dict[int, _Device] = {}
        self._chosen: _Device | None = None
        self._distrusted = False
        self.problem = ""
        """Why there is no pad to drive with, in words; empty when there is one."""
        self.polls = 0
        """Readings taken; it stands still when the pad's thread does."""
        self.errors: dict[str, int] = {"callback": 0, "device": 0}
        """Faults that were survived, by where they happened."""

    @property
    def name(self) -> str:
        """Of the chosen pad, also while it is gone; "pad" before there was any."""
        return self._name

    @property
    def pads(self) -> tuple[Pad, ...]:
        """All pads present, the unusable ones too. Devices without axes, such as headsets, are no pads."""
        return self._pads

    def read(self) -> Controls:
        """The newest controls. An old stamp means that the pad's thread or SDL hangs."""
        return self._newest

    def choose(self, name: str) -> None:
        """Drive with another pad from now on.

        Raises:
            ValueError: no usable pad of this name is present.
        """
        usable = [pad.name for pad in self._pads if pad.usable]
        if name not in usable:
            raise ValueError(f"no usable pad is called {name!r}; present: {', '.join(usable) or 'none'}")
        self._wanted = name

    def start(self) -> None:
        self._stopping.clear()
        self._thread = threading.Thread(target=self._run, name="gamepad", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    # From here on, all in the pad's thread.

    def _run(self) -> None:
        ask_for_realtime(OTHERS_PRIORITY)
        try:
            pygame = load_pygame()
            pygame.display.init()
            pygame.joystick.init()
            pygame._sdl2.controller.init()
        except (ImportError, RuntimeError) as error:  # pygame's errors are RuntimeErrors
            self._fail(f"no pad can be read: {error}")
            return
        try:
            self._watch(pygame)
        except Exception as error:
            # Counted and told on the page: the thread's end reads as a pad that is gone, which holds.
            self._fail(f"the pad's thread ended: {error}. Restart the console to drive with a pad.")
        finally:
            self._forget_all()
            self._publish(Controls(connected=False, stamp=self._clock.now()))
            pygame._sdl2.controller.quit()
            pygame.joystick.quit()
            pygame.display.quit()

    def _fail(self, problem: str) -> None:
        self.problem = problem
        self.errors["device"] += 1
        log.exception(problem)

    def _watch(self, pygame: Any) -> None:
        self._rescan(pygame)
        listing = (pygame.JOYDEVICEADDED, pygame.JOYDEVICEREMOVED)
        while not self._stopping.is_set():
            events = [pygame.event.wait(REFRESH_MS), *pygame.event.get()]
            if any(event.type in listing for event in events):
                self._rescan(pygame)
            if self._wanted is not None:
                self._choose_wanted()
            self._replay_buttons(pygame, events)
            self._publish(self._reading())
            self.polls += 1

    def _replay_buttons(self, pygame: Any, events: list[Any]) -> None:
        """Publish each press and release: a STOP that was pressed and let go between two readings must not be lost."""
        if self._chosen is None or self._chosen.instance not in self._devices:
            return
        for event in events:
            if event.type not in (pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP):
                continue
            if event.instance_id == self._chosen.instance and event.button in BUTTONS:
                changed: frozenset[Button] = frozenset({BUTTONS[event.button]})
                buttons = self._newest.buttons - changed
                if event.type == pygame.CONTROLLERBUTTONDOWN:
                    buttons |= changed
                self._publish(replace(self._newest, buttons=buttons, stamp=self._clock.now()))

    def _reading(self) -> Controls:
        stamp = self._clock.now()
        controller = self._chosen.controller if self._chosen else None
        if controller is None or not controller.attached():
            return Controls(connected=False, stamp=stamp)
        axes = [max(-1.0, controller.get_axis(axis) / 32767) for axis in range(6)]
        buttons = frozenset(button for index, button in BUTTONS.items() if controller.get_button(index))
        self._distrusted = self._distrusted and bool(buttons)
        return Controls(
            left=(axes[LEFT_X], axes[LEFT_Y]),
            right=(axes[RIGHT_X], axes[RIGHT_Y]),
            left_trigger=axes[LEFT_TRIGGER],
            right_trigger=axes[RIGHT_TRIGGER],
            buttons=buttons,
            connected=not self._distrusted,
            stamp=stamp,
        )

    def _publish(self, controls: Controls) -> None:
        before, self._newest = self._newest, controls
        if self._on_change is None or replace(before, stamp=controls.stamp) == controls:
            return
        try:
            self._on_change(controls)
        except Exception:  # counted and logged: the listener's fault must not cost the pad its STOP
            self.errors["callback"] += 1
            log.exception("the pad's listener failed")

    def _rescan(self, pygame: Any) -> None:
        """Bring the list of devices up to date, after any came or went."""
        present: dict[int, _Device] = {}
        for index in range(pygame.joystick.get_count()):
            try:
                device = self._open(pygame, index)
            except RuntimeError as error:  # went away meanwhile, or no permission
                self.errors["device"] += 1
                log.warning("an input device cannot be opened: %s", error)
                continue
            if device is not None:
                present[device.instance] = device
        came_or_went = present.keys() != self._devices.keys()
        new = [device for device in present.values() if device.instance not in self._devices]
        self._devices = present
        if came_or_went:
            self._distrusted = True
            self._take_up(new)
        self._list()

    def _open(self, pygame: Any, index: int) -> _Device | None:
        """The device at SDL's index, or None where it has no axes."""
        joystick = pygame.joystick.Joystick(index)
        known = self._devices.get(joystick.get_instance_id())
        if known is not None:
            return known
        if joystick.get_numaxes() == 0:
            joystick.quit()
            return None
        sdl = pygame._sdl2.controller
        controller = sdl.Controller(index) if sdl.is_controller(index) else None
        return _Device(joystick.get_instance_id(), joystick.get_guid(), joystick.get_name(), joystick, controller)

    def _take_up(self, new: list[_Device]) -> None:
        """Choose the first pad ever seen, or the chosen one when it comes back. Nothing else takes over by itself."""
        gone = self._chosen is not None and self._chosen.instance not in self._devices
        if self._chosen is None:
            candidates = [device for device in new if device.controller]
        else:
            candidates = [device for device in new if gone and device.controller and device.guid == self._chosen.guid]
        if candidates:
            self._chosen = candidates[0]

    def _choose_wanted(self) -> None:
        names = self._unique_names()
        chosen = next((device for device in self._devices.values() if names[device.instance] == self._wanted), None)
        self._wanted = None
        if chosen is not None and chosen is not self._chosen:
            self._chosen = chosen
            self._distrusted = True
            self._list()

    def _unique_names(self) -> dict[int, str]:
        names: dict[int, str] = {}
        for device in self._devices.values():
            same = sum(
                other.name == device.name for other in self._devices.values() if other.instance < device.instance
            )
            names[device.instance] = f"{device.name} ({same + 1})" if same else device.name
        return names

    def _list(self) -> None:
        names = self._unique_names()
        self._pads = tuple(
            Pad(names[device.instance], device.controller is not None, device is self._chosen)
            for device in self._devices.values()
        )
        self._name = next((pad.name for pad in self._pads if pad.chosen), self._name)
        unusable = [pad.name for pad in self._pads if not pad.usable]
        if self._chosen is None:
            self.problem = "no pad is plugged in"
            if unusable:
                self.problem = (
                    f"SDL has no controller mapping for {', '.join(unusable)}: set SDL_GAMECONTROLLERCONFIG to one, "
                    "or use another pad, the keyboard or the page's sticks"
                )
        elif self._chosen.instance not in self._devices:
            self.problem = f"{self._chosen.name} is gone: plug it in again or choose another pad"
        else:
            self.problem = ""

    def _forget_all(self) -> None:
        self._devices.clear()
        self._chosen = None
        self._distrusted = False
        self._list()
