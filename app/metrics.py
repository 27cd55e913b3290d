"""What Prometheus scrapes: the robot's loop, drives and tensions, and who is connected, from the newest state."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from cobra.description import RobotDescription
from cobra.messages import RobotState

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
PREFIX = "cobra_teleop_"


class MeasuredRobot(Protocol):
    """A robot as far as it is measured here."""

    @property
    def present(self) -> bool: ...

    @property
    def event_counts(self) -> Mapping[str, int]: ...

    def latest(self) -> RobotState | None: ...

    def age(self) -> float: ...


class Metrics(Collector):
    """Collected when somebody scrapes; costs nothing in between.

    Args:
        robots: the robots by name, asked at each scrape.
        describe: a robot's description, which names its drives; None while it is not known.
        counts: what was refused or dropped by this console, by reason.
        people: how many are connected, by what they look at ("pages", "views", "walls").
        trips: round trips of commands to robots that are driven from here, by their names [s].
    """

    def __init__(
        self,
        robots: Callable[[], Mapping[str, MeasuredRobot]],
        describe: Callable[[str], RobotDescription | None],
        counts: Callable[[], Mapping[str, int]],
        people: Callable[[], Mapping[str, int]],
        trips: Callable[[], Mapping[str, float]] = dict,
    ) -> None:
        self._robots = robots
        self._describe = describe
        self._counts = counts
        self._people = people
        self._trips = trips
        self._registry = CollectorRegistry()
        self._registry.register(self)

    def text(self) -> bytes:
        """The answer to a scrape, in Prometheus' text format."""
        return generate_latest(self._registry)

    def collect(self) -> Iterable[Metric]:
        families = _Families()
        for at, number in self._people().items():
            families.gauge("connected", "People connected, by what they look at.", number, at=at)
        for reason, number in self._counts().items():
            families.counter("refused", "What this console refused or dropped.", number, reason=reason)
        for name, seconds in self._trips().items():
            families.gauge("command_round_trip_seconds", "From console to robot and back.", seconds, robot=name)
        for name, robot in self._robots().items():
            state, age = robot.latest(), robot.age()
            families.gauge("robot_up", "1 while the robot process is there.", robot.present, robot=name)
            families.gauge("state_age_seconds", "Since the newest state arrived.", age, robot=name)
            for level, number in tuple(robot.event_counts.items()):
                families.counter("events", "Events of the robot, by level.", number, robot=name, level=level)
            if state is not None:
                _robot(families, name, state, self._describe(name))
        return families.all()


class _Families:
    """Metric families, made when the first sample comes; labels are those of the first one."""

    def __init__(self) -> None:
        self._families: dict[str, GaugeMetricFamily | CounterMetricFamily] = {}

    def gauge(self, name: str, what: str, value: float, **labels: str) -> None:
        self._add(GaugeMetricFamily, name, what, value, labels)

    def counter(self, name: str, what: str, value: float, **labels: str) -> None:
        self._add(CounterMetricFamily, name, what, value, labels)

    def all(self) -> Iterable[Metric]:
        return self._families.values()

    def _add(
        self,
        kind: type[GaugeMetricFamily | CounterMetricFamily],
        name: str,
        what: str,
        value: float,
        labels: dict[str, str],
    ) -> None:
        family = self._families.get(name)
        if family is None:
            family = self._families[name] = kind(PREFIX + name, what, labels=tuple(labels))
        if not math.isnan(value):  # not known is no sample
            family.add_metric(list(labels.values()), float(value))


def _robot(families: _Families, robot: str, state: RobotState, description: RobotDescription | None) -> None:
    gauge, counter, timing = families.gauge, families.counter, state.timing
    gauge("phase", "1 for the phase that the robot is in.", 1, robot=robot, phase=state.phase)
    gauge("homed", "1 while the robot knows where straight is.", state.homed, robot=robot)
    gauge("driven", "1 while somebody holds the lease.", bool(state.lease.holder), robot=robot)
    counter("ticks", "Cycles of the control loop.", state.tick, robot=robot)
    gauge("loop_rate_hertz", "Rate of the control loop.", timing.rate_Hz, robot=robot)
    for quantile, period in (("0.5", timing.period_p50), ("0.99", timing.period_p99), ("1", timing.period_max)):
        gauge("loop_period_seconds", "Time between cycles.", period, robot=robot, quantile=quantile)
    gauge("loop_compute_p99_seconds", "Computation in a cycle.", timing.compute_p99, robot=robot)
    gauge("loop_late", "Late cycles of the last seconds.", timing.late, robot=robot)
    gauge("realtime", "1 with real-time scheduling.", timing.realtime, robot=robot)
    for reason, number in state.drops.items():
        counter("commands_dropped", "Commands that were not obeyed.", number, robot=robot, reason=reason)
    for reason, number in state.bus.items():
        counter("frames_unusable", "Frames on the motor bus that were not usable.", number, robot=robot, reason=reason)
    for channel in state.channels:
        gauge("bus_load_ratio", "Part of a CAN bus's bit rate in use.", channel.load, robot=robot, bus=channel.name)
        gauge("bus_trouble", "1 while a CAN bus is in trouble.", bool(channel.trouble), robot=robot, bus=channel.name)
    for cell in state.cells:
        labels = {"robot": robot, "tendon": cell.tendon}
        gauge("load_cell_newtons", "Tension by a tendon's load cell; NaN while not believed.", cell.tension, **labels)
        gauge("load_cell_current_newtons", "What the motor's current says beside it.", cell.from_current, **labels)
        gauge("load_cell_trouble", "1 while a load cell cannot be believed.", bool(cell.trouble), **labels)
    if description is not None:
        _drives(families, robot, state, description)


def _drives(families: _Families, robot: str, state: RobotState, description: RobotDescription) -> None:
    drives = state.drives
    for i, drive in enumerate(description.drives):
        labels = {"robot": robot, "drive": drive.name}
        if drive.moves == "tendon":
            families.gauge(
                "tension_newtons", "Tension of a tendon.", drives.load[i], robot=robot, tendon=drive.tendon or ""
            )
        families.gauge("drive_temperature_celsius", "Temperature of a drive.", drives.temperature[i], **labels)
        families.gauge("drive_voltage_volts", "Supply of a drive.", drives.voltage[i], **labels)
        families.gauge("drive_age_seconds", "Since a drive's last reply.", drives.age[i], **labels)
        if drives.current:
            families.gauge("drive_current_amperes", "Current of a drive's motor.", drives.current[i], **labels)
            families.gauge("drive_missed_replies", "Replies missed in a row.", drives.missed[i], **labels)
            families.gauge("drive_warning", "1 while a drive is near a limit.", bool(drives.warning[i]), **labels)
        families.gauge("drive_fault", "1 while a drive reports a fault.", bool(drives.fault[i]), **labels)
