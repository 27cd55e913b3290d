"""`cobra-teleop watch`: a console that only watches."""

from pathlib import Path
from typing import Annotated

import tyro

from app.commands.command import Command


def watch(
    *,
    robot: Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="ENDPOINT",
            help="Where robots are heard: a robot process's link or a router. Without it the robots of this machine.",
        ),
    ] = (),
    account: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help="Account for the router, from `cobra-teleop router account`.")
    ] = None,
    ca: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help="Certificate of the authority of tls/ endpoints (PEM).")
    ] = None,
    port: Annotated[int, tyro.conf.arg(help="Port of the page; when it is taken the next free one is used.")] = 8070,
    host: Annotated[
        str, tyro.conf.arg(help="Address to serve the page on; others than loopback need users and TLS.")
    ] = "127.0.0.1",
    tls_cert: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help="Certificate with its chain, PEM.")] = None,
    tls_key: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help="The certificate's key, PEM.")] = None,
    name: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME", help="Further host names by which browsers may come.")
    ] = (),
    insecure: Annotated[
        bool, tyro.conf.arg(help="Listen beyond loopback without users or TLS all the same; the page says so.")
    ] = False,
    frame_rate: Annotated[float, tyro.conf.arg(help="Frames per second of the 3D scenes.")] = 30.0,
) -> int:
    from app.link.access import LinkAccess
    from app.watching.watch import WatchOptions, run_watch

    return run_watch(
        WatchOptions(
            endpoints=robot,
            access=LinkAccess(account=account, ca=ca),
            host=host,
            port=port,
            names=name,
            tls_cert=tls_cert,
            tls_key=tls_key,
            insecure=insecure,
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
