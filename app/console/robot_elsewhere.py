"""A robot whose process runs on another machine: it is found on the link, and neither started nor ended from here."""

import msgspec
import zenoh

from app.link.access import LinkAccess, LinkError, open_session
from app.link.keys import ask, key
from cobra.description import RobotDescription
from cobra.loading import parse_description
from cobra.messages import Meta, decode

LOOK_S = 3.0
"""So long a robot that is there takes at most to be heard of."""


class RobotElsewhere:
    """Stands where `RobotKeeper` stands for a robot of this machine.

    Args:
        endpoint: a router, or the robot process's own link.
        access: account and certificate for it.
        name: the robot's; needed only where several are heard.
    """

    adopted = True

    def __init__(self, endpoint: str, access: LinkAccess, name: str = "") -> None:
        self.access = access
        self._endpoint = endpoint
        self._name = name

    @property
    def no_restart(self) -> str:
        """Why it cannot be restarted."""
        return f"the robot process runs elsewhere, behind {self._endpoint}: restart it on its own machine"

    def find(self) -> RobotDescription:
        """Look who is there, and ask it what robot it is.

        Raises:
            LinkError: nobody lets us in there, the robot is not heard, or another name is needed.
            DescriptionError: it is of a kind that this program does not know.
        """
        with open_session("client", connect=(self._endpoint,), access=self.access) as session:
            self._name = self._chosen(_heard(session))
            data = ask(session, key(self._name, "meta"), b"")
        try:
            meta = decode(data or b"", Meta)
        except msgspec.MsgspecError:
            raise LinkError(
                f"robot {self._name!r} is heard at {self._endpoint} and does not say what it is: another version of "
                "cobra-teleop may run there"
            ) from None
        return parse_description(meta.description, f"robot {self._name!r}")

    def _chosen(self, heard: list[str]) -> str:
        if not heard:
            raise LinkError(
                f"no robot is heard at {self._endpoint}: start one there with `cobra-teleop robot --router …`"
            )
        if self._name in heard:
            return self._name
        there = ", ".join(heard)
        if self._name:
            raise LinkError(f"robot {self._name!r} is not heard at {self._endpoint}; there: {there}")
        if len(heard) > 1:
            raise LinkError(f"several robots are heard at {self._endpoint}: choose one of {there} with --robot")
        return heard[0]

    def launch(self) -> None:
        """It runs without us."""

    def wait(self) -> str:
        """Where its link is."""
        return self._endpoint

    def end(self) -> None:
        """It goes on without us: it holds, and takes its final action when nobody comes."""


def _heard(session: zenoh.Session) -> list[str]:
    """Names of the robots whose processes are there."""
    replies = session.liveliness().get("cobra/*/alive", timeout=LOOK_S)
    return sorted({str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok is not None})
