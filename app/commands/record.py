"""`cobra-teleop record`: record a robot that runs."""

from pathlib import Path
from typing import Annotated

import tyro

from app.commands.command import DIRECTLY, Command, Linked, RecordBudget, RecordFolder, RobotName


def record(
    *,
    robot: RobotName = "cobra",
    robot_name: Annotated[
        str | None, tyro.conf.arg(help="The robot's name on the link, instead of its description.")
    ] = None,
    endpoint: Annotated[
        str | None, tyro.conf.arg(help="Where the robot's link listens; found by itself on this machine.")
    ] = None,
    linked: Linked = DIRECTLY,
    wait: Annotated[
        bool, tyro.conf.arg(help="Wait for a robot that is gone, however long: its network may be cut for a while.")
    ] = False,
    record: RecordFolder = None,
    file: Annotated[Path | None, tyro.conf.arg(help="Record into this file, which must not exist yet.")] = None,
    record_budget: RecordBudget = 20.0,
    settings: Annotated[str, tyro.conf.arg(metavar="JSON", help="Kept in the recording; used by the console.")] = "{}",
    feed: Annotated[bool, tyro.conf.arg(help="Used by the console: talk JSON over standard input and output.")] = False,
) -> int:
    import json

    from app import runtime
    from app.recording import storage
    from app.recording.recorder import Recorder, RecorderError, run_recorder
    from cobra.loading import load_description

    name = robot_name or load_description(robot).name
    if endpoint is None and not feed:
        running = runtime.find("robot", name)
        if running is None:
            raise RecorderError(f"robot {name!r} does not run on this machine; start it, or give its --endpoint")
        endpoint = running.endpoint
    where = file or record or storage.default_folder()
    recorder = Recorder(
        name, endpoint or "", where, int(record_budget * 1e9), json.loads(settings), linked.access(), wait
    )
    return run_recorder(recorder, feed)


COMMAND = Command(
    "record",
    "record a robot that runs; the console does so by itself",
    record,
    "  cobra-teleop record                           the robot of this machine\n"
    "  cobra-teleop record --endpoint tls/router:7447 --account archive.account --ca ca.pem --wait --record /data/inspections",
)
