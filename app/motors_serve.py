"""Simulated drives as a process of their own: they outlive every controller, and anything that speaks SLCAN can talk to them."""

import gc
import select
import signal
import sys
import threading
from collections.abc import Sequence
from typing import Any, Final

import can
import msgspec

from app.slcan_endpoints import Endpoint, open_endpoint
from cobra.control.realtime import OTHERS_PRIORITY, ask_for_realtime
from cobra.description import Bus
from cobra.loading import load_description
from cobra.motors.channel import one_line
from cobra.simulation.faults import FaultDesk, FaultError
from cobra.simulation.options import Simulation
from cobra.simulation.slcan import SlcanPort

POLL_S: Final = 0.1


def serve(
    robot: str,
    *,
    where: str,
    simulation: Simulation,
    timing: str,
    latency_ms: float,
    faults: Sequence[str],
    drive_with: Sequence[str] = (),
) -> int:
    """Serve until Ctrl-C. Faults are taken from standard input, a line each.

    `drive_with`: options that whoever drives these drives must give too.

    Raises:
        OperatorError: with one clear line.
    """
    description = load_description(robot)
    # They stand for hardware: a busy machine must not make them answer late.
    ask_for_realtime(OTHERS_PRIORITY)
    buses = tuple(msgspec.structs.replace(bus, interface="cobra-sim") for bus in description.buses)
    description = msgspec.structs.replace(description, buses=buses)
    options = {
        **simulation.bus_options(),
        "timing": timing,
        "latency_ms": latency_ms,
        "description": description,
    }
    done = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: done.set())
    adapters: list[_Adapter] = []
    try:
        for offset, bus in enumerate(buses):
            adapters.append(_Adapter(robot, bus, open_endpoint(where, offset), options))
        desk = FaultDesk(robot)
        for line in faults:
            print(desk.make(line), flush=True)
        for adapter in adapters:
            adapter.start(done)
        gc.collect()
        gc.freeze()  # going through all that stays would make drives answer late
        _introduce(robot, adapters, drive_with)
        _take_faults(desk, done)
    finally:
        done.set()
        for adapter in adapters:
            adapter.stop()
    return 0


def _introduce(robot: str, adapters: list["_Adapter"], drive_with: Sequence[str]) -> None:
    for adapter in adapters:
        print(f"bus {adapter.name}: slcan {adapter.endpoint.channel}", flush=True)
    routes = [f"--bus {adapter.name}=slcan:{adapter.endpoint.channel}?sleep_after_open=0" for adapter in adapters]
    print(f"drive it with: cobra-teleop --robot {robot} {' '.join([*routes, *drive_with])}")
    print("faults, a line each: e.g. 'drop S1 0.2', 'heal'; 'help' lists them; Ctrl-C ends", flush=True)


def _take_faults(desk: FaultDesk, done: threading.Event) -> None:
    """Until told to end; without a standard input there is nothing to take."""
    while not done.is_set():
        try:
            ready, _, _ = select.select([sys.stdin], [], [], POLL_S)
        except (OSError, ValueError):
            done.wait()
            return
        if not ready:
            continue
        line = sys.stdin.readline()
        if not line:
            done.wait()
        elif line.strip() == "help":
            print(desk.usage(), flush=True)
        elif line.strip():
            try:
                print(desk.make(line), flush=True)
            except FaultError as error:
                print(error, flush=True)


class _Adapter:
    """One simulated bus behind one endpoint: a thread that listens to the program, and one that listens to the bus."""

    def __init__(self, robot: str, bus: Bus, endpoint: Endpoint, options: dict[str, Any]) -> None:
        self.name = bus.name
        self.endpoint = endpoint
        try:
            self._bus = can.Bus(interface="cobra-sim", channel=f"{robot}#{bus.name}", ignore_config=True, **options)
        except can.CanError as error:
            endpoint.close()
            raise FaultError(one_line(error)) from error
        self._port = SlcanPort(self._bus, bus.bitrate, endpoint.write)
        self._threads: list[threading.Thread] = []

    def start(self, done: threading.Event) -> None:
        listen = threading.Thread(
            target=self.endpoint.run, args=(self._port.feed, self._port.hang_up, done), name=f"slcan-{self.name}"
        )
        self._threads = [listen, threading.Thread(target=self._show, args=(done,), name=f"bus-{self.name}")]
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        for thread in self._threads:
            thread.join()
        self._bus.shutdown()
        self.endpoint.close()

    def _show(self, done: threading.Event) -> None:
        while not done.is_set():
            frame = self._bus.recv(POLL_S)
            if frame is not None:
                self._port.show(frame)
