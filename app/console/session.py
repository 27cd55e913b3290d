"""What the operator's pages see and may ask for: the console as the front door knows it."""

import asyncio
import math
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, cast

import numpy as np

from app.console.commissioning_view import cell_warnings, commissioning_request, commissioning_state
from app.console.guides import guides
from app.console.inputs import Controls, InputSource
from app.console.mapping import FRAMES
from app.console.motion_state import guide_state, motion_state
from app.console.page_socket import Asker, What
from app.console.page_state import (
    Answer,
    Bend,
    ChannelState,
    DriveState,
    EventLine,
    LockState,
    Pad,
    Person,
    RecordingState,
    Snapshot,
    TendonsState,
    Welcome,
)
from app.console.pilot import Pilot
from app.console.recording import RecorderProcess
from app.console.seat import Occupant
from app.console.seen import Seat, SeenRobot
from app.link.stopping import UNCONFIRMED
from app.people.audit import AuditTrail, Deed
from app.people.sessions import Visitor
from cobra.clock import Clock
from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, TWIST, Configuration
from cobra.messages import Reply, Request, RobotState, Tendons, tensions_of

SHOWN_EVENTS = 24
STALE_S = 0.5
DIGITS = 4
"""After the point, of numbers in mm, degrees, N, s and ms."""


class ConsoleSession:
    """Implements `PageSession` on the robot's newest state, the pilot and the driver."""

    def __init__(
        self,
        *,
        description: RobotDescription,
        robot: SeenRobot,
        pilot: Pilot,
        driver: Seat,
        pad: InputSource | None,
        versions: dict[str, str],
        quit_console: Callable[[], None],
        clock: Clock,
        danger: str = "",
        elsewhere: str = "",
        recorder: RecorderProcess | None = None,
        trail: AuditTrail | None = None,
    ) -> None:
        """`danger`: what everybody has to know about how the page is served; empty when it is as it should be.

        `elsewhere`: through what the robot process is reached that is not started and ended from here; empty where it is.
        """
        self._description = description
        self._layout = Configuration(description)
        self._backbone = Backbone(description)
        self._robot = robot
        self._pilot = pilot
        self._driver = driver
        self._pad = pad
        self._trail = trail
        self._people: dict[str, Visitor] = {}
        self._versions = versions
        self._quit = quit_console
        self._clock = clock
        self._danger = danger
        self._elsewhere = elsewhere
        self._recorder = recorder
        # Requests wait for the robot process; the front door's thread must not.
        self._workers = ThreadPoolExecutor(4, thread_name_prefix="request")

    def stop(self) -> None:
        self._workers.shutdown(wait=False, cancel_futures=True)

    def welcome(self) -> Welcome:
        d = self._description
        return Welcome(
            robot=d.name,
            title=d.title,
            summary=d.summary,
            sections=[section.name for section in d.sections],
            bending=list(d.active_sections),
            limits={
                "twist_deg": d.twist.range_deg if d.twist else None,
                "feed_mm": (d.feed.range_m[0] * 1e3, d.feed.range_m[1] * 1e3) if d.feed else None,
                "length_mm": self._length_range(),
            },
            speed_levels=list(d.teleop.speed_levels),
            tendons=list(d.tendon_names),
            max_tension_N=d.tendon.max_tension_N if d.tendon else 0.0,
            modes=[guide_state(guide) for guide in guides(d)],
            frames=list(FRAMES),
            active_length_mm=d.active_length_m * 1e3 if d.active_sections else None,
            hand_fed=d.hand_fed,
            versions=self._versions,
            danger=self._danger,
            elsewhere=self._elsewhere,
        )

    def snapshot(self) -> Snapshot:
        state, age = self._robot.latest(), self._robot.age()
        pilot = self._pilot.status(self._clock.now())
        present = self._robot.present
        facts: dict[str, Any] = {
            "phase": state.phase if state and present else "fault",
            "cause": self._cause(state, present),
            "reasons": [*state.reasons] if state else [],
            "hints": pilot.words,
            "homed": bool(state and state.homed),
            "link": {
                "ok": present and age < STALE_S,
                "robot": present,
                "age_ms": _number(age * 1e3),
                "trip_ms": _number(self._driver.lag_s * 1e3),
            },
            "lease": {
                "holder": state.lease.holder if state else "",
                "since_s": _number(state.stamp - state.lease.since) if state and state.lease.holder else None,
                "fresh": bool(state and state.lease.fresh),
                "asking": list(state.lease.asking) if state else [],
            },
            "seat": self._driver.seat_state(),
            "people": self._present(),
            "driver": pilot.driver,
            "pad": self._pad_state(),
            "mode": pilot.selection.mode,
            "frame": pilot.selection.frame,
            "motion": motion_state(state, pilot.selection),
            "section": pilot.selection.section,
            "speed": pilot.selection.level,
            "drops": {**(state.drops if state else {}), **pilot.counts, **self._driver.errors},
            "channels": _channels(state),
            "tendons": _tendons(state),
            "notes": [*state.notes] if state else [],
            "bus": state.bus if state else {},
            "timing": {name: getattr(state.timing, name) for name in state.timing.__struct_fields__} if state else {},
            "events": self._events(state),
            "console_rate": self._robot.rate(),
            "recording": self._recording(),
            "commissioning": commissioning_state(state),
        }
        return cast(
            Snapshot,
            facts | self._shape(state, pilot.selection.section) | self._drives(state),
        )

    def controls(self, page: str, sequence: int, controls: Controls) -> None:
        self._pilot.update(page, controls)
        self._driver.wake()

    def gone(self, page: str) -> None:
        self._pilot.detach(page)
        self._driver.wake()

    def opened(self, asker: Asker) -> None:
        self._people[asker.page] = asker.visitor

    def closed(self, page: str) -> None:
        self._people.pop(page, None)
        self._workers.submit(self._driver.vacate, page)

    def act(self, asker: Asker, what: What, value: int | None, text: str) -> Answer | Awaitable[Answer]:
        page = asker.page
        match what:
            case "stop":
                return self._stop(asker)
            case "section":
                return _answer(self._pilot.select(page, section=value))
            case "speed":
                return _answer(self._pilot.select(page, level=value))
            case "mode":
                return _answer(self._pilot.choose(page, mode=value))
            case "frame":
                return _answer(self._pilot.choose(page, frame=value))
            case "pose":
                return _answer(self._pilot.choose(page, pose=text))
            case "save_pose" | "delete_pose":
                return self._ask(Request(what=what, name=text), asker)
            case "hand_feed":
                return self._hand_feed(text, asker)
            case "quit":
                threading.Thread(target=self._quit, daemon=True).start()
                return _yes()
            case "restart_robot":
                return self._later(self._robot.restart)
            case "acquire" | "release" | "take" | "ask" | "withdraw" | "grant" | "refuse" | "console_pad":
                who = Occupant(asker.visitor.name, page)
                return self._later(lambda: self._driver.change(who, what, text, bool(value)))
            case "identify" | "test" | "home_repeatedly" | "tare" | "calibrate_cell" | "abort" | "resume":
                request, refusal = commissioning_request(what, value, text)
                return _answer(refusal) if request is None else self._ask(request, asker)
            case "compensation":
                return self._ask(Request(what=what, value=float(bool(value))), asker)
            case _:
                return self._ask(Request(what=what, reason=text), asker)

    async def _stop(self, asker: Asker) -> Answer:
        confirmed = self._driver.halt(asker.visitor.name, f"pressed on {asker.page}")
        return _yes() if await asyncio.wrap_future(confirmed) else _answer(UNCONFIRMED)

    def _ask(self, request: Request, asker: Asker) -> Awaitable[Answer]:
        who = Occupant(asker.visitor.name, asker.page)
        return self._later(lambda: self._driver.ask(request, who))

    def _present(self) -> list[Person]:
        """Everybody who has a page open, once."""
        everybody = {visitor.name: visitor.role for visitor in list(self._people.values())}
        return [Person(name=name, role=role) for name, role in sorted(everybody.items())]

    def audit(self) -> Awaitable[list[Deed]]:
        return asyncio.get_running_loop().run_in_executor(self._workers, self._robot.audit)

    def _hand_feed(self, text: str, asker: Asker) -> Answer | Awaitable[Answer]:
        """The exposed length in millimetres, as somebody typed it."""
        try:
            length_m = float(text.strip().replace(",", ".")) * 1e-3
        except ValueError:
            return _answer(f"{text!r} is not a length: give the exposed length in millimetres")
        return self._ask(Request(what="hand_feed", value=length_m), asker)

    def note_session(self, what: str, name: str, address: str) -> None:
        if self._trail:
            self._trail.note(name, what, f"from {address}")

    async def _later(self, ask: Callable[[], Reply]) -> Answer:
        reply = await asyncio.get_running_loop().run_in_executor(self._workers, ask)
        return Answer(ok=reply.ok, reasons=list(reply.reasons))

    def _recording(self) -> RecordingState:
        recorder = self._recorder
        report = recorder.report if recorder else None
        state = report.state if report else None
        return RecordingState(
            name=recorder.path.name if recorder else "",
            problem=recorder.problem if recorder else "",
            megabytes=state.size_bytes / 1e6 if state else 0.0,
            lost=state.dropped + state.missed + recorder.lost_inputs if recorder and state else 0,
        )

    def _pad_state(self) -> Pad:
        controls = self._pad.read() if self._pad else Controls(connected=False)
        return Pad(
            name=self._pad.name if self._pad else "",
            connected=controls.connected,
            controls={
                "left": controls.left,
                "right": controls.right,
                "lt": controls.left_trigger,
                "rt": controls.right_trigger,
                "buttons": sorted(controls.buttons),
            },
        )

    def _cause(self, state: RobotState | None, present: bool) -> str:
        if present:
            return state.cause if state else "Waiting for the robot process."
        if self._elsewhere:
            return f"The robot is not heard through {self._elsewhere}. It holds by itself when its driver is lost. Trying again."
        return "The robot process is gone. The motors hold where they stand. Restart it, then arm again."

    def _shape(self, state: RobotState | None, section: int) -> dict[str, Any]:
        """Bends, twist, feed and tip from the measured configuration; nothing is known of a robot that is not homed."""
        known = state is not None and state.homed
        q = np.array(state.measured) if state is not None and known else np.full(self._layout.rest().shape, np.nan)
        sections = zip(self._description.sections, self._layout.bends, strict=True)
        bends = [
            Bend(
                name=section.name,
                deg=_number(math.degrees(math.hypot(*q[where]))),
                dir_deg=_number(math.degrees(math.atan2(q[where][1], q[where][0]))),
                limit_deg=section.max_bend_deg,
            )
            for section, where in sections
        ]
        tip = self._backbone.tip(q)[:3, 3] * 1e3 if known else np.full(3, np.nan)
        return {
            "bends": bends,
            "twist_deg": _number(math.degrees(q[TWIST])),
            "feed_mm": _number(q[FEED] * 1e3),
            "length_mm": None if (index := self._length_index(section)) is None else _number(q[index] * 1e3),
            "lock": LockState(status=state.lock.status, words=state.lock.words)
            if state
            else LockState(status="none", words=""),
            "tip_mm": [_number(x) for x in tip],
        }

    def _length_index(self, section: int) -> int | None:
        """Where the length stands in q that the page shows: of the chosen section, else of the first that has one."""
        chosen = self._layout.lengths[section]
        return chosen if chosen is not None else next((i for i in self._layout.lengths if i is not None), None)

    def _length_range(self) -> tuple[float, float] | None:
        part = next((section.elongation for section in self._description.sections if section.elongation), None)
        return (part.range_m[0] * 1e3, part.range_m[1] * 1e3) if part else None

    def _drives(self, state: RobotState | None) -> dict[str, Any]:
        drives = state.drives if state else None
        d = self._description
        limits = (
            {"min": d.tendon.min_tension_N, "max": d.tendon.max_tension_N} if d.tendon else {"min": 0.0, "max": 0.0}
        )
        if state is None or drives is None:
            return {"drives": [], "tensions": [], "profiles": [], "tension_limits": limits}
        return {
            "drives": [
                DriveState(
                    name=drive.name,
                    moves=drive.moves,
                    temperature=_number(drives.temperature[i]),
                    voltage=_number(drives.voltage[i]),
                    load=_number(drives.load[i]),
                    age_ms=_number(drives.age[i] * 1e3),
                    current=_number(drives.current[i]) if drives.current else None,
                    missed=drives.missed[i] if drives.missed else 0,
                    warning=drives.warning[i] if drives.warning else "",
                    fault=drives.fault[i],
                )
                for i, drive in enumerate(d.drives)
            ],
            "tensions": [_number(tension) for tension in tensions_of(d, state)],
            "profiles": [[round(n, 1) for n in row if math.isfinite(n)] for row in state.tendons.profile],
            "tension_limits": limits,
        }

    def _events(self, state: RobotState | None) -> list[EventLine]:
        now = state.stamp if state else 0.0
        newest = list(self._robot.events)[-SHOWN_EVENTS:]
        return [
            EventLine(level=e.level, text=e.text, ago=max(now - e.stamp, 0.0), stamp=e.stamp) for e in reversed(newest)
        ]


def _number(value: float) -> float | None:
    """JSON has no NaN: what is not known is null. Nobody reads more digits, and they would be half of what is sent."""
    return round(float(value), DIGITS) if math.isfinite(value) else None


def _yes() -> Answer:
    return Answer(ok=True, reasons=[])


def _answer(refusal: str) -> Answer:
    return Answer(ok=not refusal, reasons=[refusal] if refusal else [])


def _channels(state: RobotState | None) -> list[ChannelState]:
    return [ChannelState(name=c.name, load=c.load, trouble=c.trouble) for c in state.channels] if state else []


def _tendons(state: RobotState | None) -> TendonsState:
    known = state.tendons if state else Tendons()
    words = {"none": "", "off": "Compensation off", "on": "Compensation on"}[known.compensation]
    if known.compensation == "on" and known.deviation:
        sure = math.degrees(max(known.deviation))
        words += f": bends known to ±{sure:.0f}°, with numbers from {known.parameters}"
    cells = cell_warnings(state.cells if state else ())
    return TendonsState(compensation=known.compensation, words=words, warnings=[*known.warnings, *cells])
