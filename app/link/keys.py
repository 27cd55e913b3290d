"""Zenoh keys of the link between a robot process and its consoles, and how they are used by either end.

cobra/<robot>/state     robot → all     RobotState, every tick; only the newest matters
cobra/<robot>/history   robot → recorders   the same states, a tenth of a second in one message: none is dropped for being late
cobra/<robot>/event     robot → all     Event
cobra/<robot>/heard     robot → recorders   Heard: commands with the robot's verdict, answered requests
cobra/<robot>/truth     twin → tests, plots and the 3D view only
cobra/<robot>/push      anybody → twin only: Push, a force on its body. On hardware nobody listens.
cobra/<robot>/command   driver → robot  Command
cobra/<robot>/stop      anybody → robot Stop
cobra/<robot>/length    anybody → robot HandFedLength: what a measuring device reads, of a robot that is fed by hand
cobra/<robot>/request   query           Request → Reply
cobra/<robot>/meta      query           Meta
cobra/<robot>/calibration   robot → recorders, and query   Calibration, whenever another one is in force
cobra/<robot>/audit     query           the newest deeds of the audit trail
cobra/<robot>/alive     liveliness token of the robot process
cobra/<robot>/console/* liveliness tokens of its consoles
"""

import zenoh

REQUEST_TIMEOUT_S = 2.0


def key(robot: str, name: str) -> str:
    return f"cobra/{robot}/{name}"


def newest_only(session: zenoh.Session, name: str) -> zenoh.Publisher:
    """For what is worthless when late: sent at once, ahead of the rest, dropped rather than queued."""
    return session.declare_publisher(
        name, priority=zenoh.Priority.INTERACTIVE_HIGH, congestion_control=zenoh.CongestionControl.DROP, express=True
    )


def put_stop(session: zenoh.Session, name: str, data: bytes) -> None:
    """Send a STOP, ahead of all else and in a queue that nothing else fills."""
    session.put(
        name, data, priority=zenoh.Priority.REAL_TIME, congestion_control=zenoh.CongestionControl.DROP, express=True
    )


def ask(session: zenoh.Session, name: str, payload: bytes) -> bytes | None:
    """The first answer to a query; None when there is none in time."""
    for reply in session.get(name, payload=payload, timeout=REQUEST_TIMEOUT_S):
        if reply.ok is not None:
            return reply.ok.payload.to_bytes()
    return None
