"""`cobra-teleop watch`: a console that only watches."""

from typing import Annotated

import tyro

from app.commands.command import DIRECTLY, HERE_ONLY, Command, FrameRate, Linked, PagePort, Served


def watch(
    *,
    robot: Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="ENDPOINT",
            help="Where robots are heard: a robot process's link or a router. Without it the robots of this machine.",
        ),
    ] = (),
    linked: Linked = DIRECTLY,
    port: PagePort = 8070,
    page: Served = HERE_ONLY,
    frame_rate: FrameRate = 30.0,
) -> int:
    from app.watching.watch import WatchOptions, run_watch

    return run_watch(
        WatchOptions(
            endpoints=robot,
            access=linked.access(),
            host=page.host,
            port=port,
            names=page.name,
            tls_cert=page.tls_cert,
            tls_key=page.tls_key,
            insecure=page.insecure,
            frame_rate_Hz=frame_rate,
        )
    )


COMMAND = Command(
    "watch",
    "a console that only watches: one robot, or a wall of several",
    watch,
    "  cobra-teleop watch\n"
    "  cobra-teleop watch --robot tcp/127.0.0.1:7447\n"
    "  cobra-teleop watch --robot tls/robot-room:7447 --account control-room.account --ca ca.pem",
)
