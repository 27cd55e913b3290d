"""Run the console's own command line beside a virtual pad, in one process: such a pad exists only where it is read.

    python tests/console_with_pad.py [arguments of cobra-teleop …]

Standard input takes one JSON object a line; each is answered on standard output with the monotonic time at which it was
done, as `{"pad": {…the request…}, "time": 1234.5}`, or with `"error"` in words. Other lines there are the console's own.

    {"axis": "leftx", "value": 0.5}            leftx, lefty, rightx, righty: −1…1, y down; lefttrigger, righttrigger: 0…1
    {"button": "leftshoulder", "value": 1}     names as SDL or the console writes them
    {"attach": true}   {"detach": true}        plug the pad in again, pull it out
    {"tremble": true}  {"tremble": false}      a hand's tremor on the deflected sticks, or none: a frozen pad

The pad is there from the start, at rest. When standard input ends the pad stays as it is.
"""

import json
import random
import sys
import threading
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.virtual_pad import AXES, BUTTON_INDEX, TRIGGERS, VirtualPad

TREMOR = 0.001
TREMOR_PERIOD_S = 0.05


class Hand:
    """Holds the pad. Requests come from one thread, the tremor from another."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pad = VirtualPad()
        self._attached = True
        self._axes: dict[str, float] = {}
        self._still = threading.Event()
        self._still.set()

    def obey(self, request: dict[str, Any]) -> None:
        """Do what one line asks.

        Raises:
            ValueError: it asks for nothing known, or the pad is pulled out.
        """
        with self._lock:
            match request:
                case {"attach": True} if not self._attached:
                    self._pad.attach()
                    self._axes.clear()
                    self._attached = True
                case {"detach": True} if self._attached:
                    self._pad.detach()
                    self._attached = False
                case {"tremble": bool(trembles)}:
                    self._tremble(trembles)
                case {"axis": str(axis), "value": int() | float() as value} if self._attached and axis in AXES:
                    self._pad.axis(axis, value)
                    self._axes[axis] = value
                case {"button": str(button), "value": int() as value} if self._attached and _button(button):
                    self._pad.button(_button(button), bool(value))
                case _:
                    raise ValueError(f"not possible now ({'' if self._attached else 'not '}plugged in): {request}")

    def _tremble(self, trembles: bool) -> None:
        if not trembles:
            self._still.set()
        elif self._still.is_set():
            self._still.clear()
            threading.Thread(target=self._keep_trembling, daemon=True).start()

    def _keep_trembling(self) -> None:
        while not self._still.wait(TREMOR_PERIOD_S):
            with self._lock:
                for axis, value in self._axes.items():
                    if self._attached and value and axis not in TRIGGERS:
                        self._pad.axis(axis, max(-1.0, min(1.0, value + random.uniform(-TREMOR, TREMOR))))


def _button(name: str) -> str:
    """The console's name for a button; SDL writes leftshoulder and dpup."""
    plain = name.replace("_", "").replace("dpad", "dp")
    return next((own for own in BUTTON_INDEX if own.replace("_", "").replace("dpad", "dp") == plain), "")


def serve(hand: Hand) -> None:
    """Obey standard input, line by line."""
    for line in sys.stdin:
        if not line.strip():
            continue
        answer: dict[str, Any]
        try:
            request = json.loads(line)
            hand.obey(request)
            answer = {"pad": request, "time": time.monotonic()}
        except (ValueError, RuntimeError) as error:
            answer = {"pad": line.strip(), "error": str(error)}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    from app.cli import main

    threading.Thread(target=serve, args=(Hand(),), name="hand", daemon=True).start()
    main(sys.argv[1:])
