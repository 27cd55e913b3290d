"""Claims about the router between networks: roles are enforced by it, whatever a program behind an account sends."""

import os
import re
import stat
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import trustme
import zenoh

from app.console.robot_connection import RobotConnection
from app.console.robot_elsewhere import RobotElsewhere
from app.link.access import LinkAccess, LinkError, open_session
from app.link.console_end import ConsoleLink
from app.link.keys import key
from app.link.listener import Listener
from app.link.robot_end import RobotLink
from app.router import add_account, load_accounts, routing
from app.runtime import any_free_port
from app.watching.feeds import Feed, WatchedRobot
from cobra.loading import description_text
from cobra.messages import Calibration, Command, Drives, Event, Heard, Meta, Reply, Request, RobotState, Stop, encode
from tests.stack import wait_for

STATE = RobotState(
    robot="arm",
    stamp=1.0,
    tick=1,
    phase="ready",
    drives=Drives(travel=(), setpoint=(), velocity=(), load=(), temperature=(), voltage=(), age=(), valid=(), fault=()),
)


class Net:
    """A router with a robot behind it; `got` counts what reached the robot."""

    def __init__(self, folder: Path, endpoint: str, access: dict[str, LinkAccess]) -> None:
        self.folder, self.endpoint, self.access = folder, endpoint, access
        self.got: Counter[str] = Counter()
        text = description_text("cobra-twist-feed").replace('name = "cobra-twist-feed"', 'name = "arm"', 1)
        meta = Meta(description=text, versions={}, pid=1)
        self.own = f"tcp/127.0.0.1:{any_free_port()}"
        self.robot = RobotLink("arm", self.own, meta, router=endpoint, access=access["arm"])
        self.robot.start(lambda _: self._count("command"), lambda _: self._count("stop"), self._request)
        self.wait_for_robots("arm")

    def wait_for_robots(self, *names: str) -> None:
        """Wait until the router knows of exactly these: it hears of them only after they have opened their sessions."""
        with self.session("ann") as session:

            def there() -> bool:
                replies = session.liveliness().get("cobra/*/alive")
                return {str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok} == set(names)

            wait_for(f"the router to know of {names}", there)

    def console(self, name: str, watches: bool) -> ConsoleLink:
        link = ConsoleLink("arm", self.endpoint, access=self.access[name], watches=watches)
        link.start()

        def heard() -> bool:
            self.robot.publish_state(STATE)
            return link.latest is not None

        wait_for("a state", heard)
        return link

    def session(self, name: str) -> zenoh.Session:
        """A program of its own behind an account: it may send whatever it likes."""
        return open_session("client", connect=(self.endpoint,), access=self.access[name])

    def _count(self, what: str) -> None:
        self.got[what] += 1

    def _request(self, data: bytes, answer: Any) -> None:
        self._count("request")
        answer(Reply(ok=True))


@pytest.fixture(params=["tcp", "tls"])
def net(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Net]:
    accounts = tmp_path / "accounts.json"
    ca = certificate = private = None
    if request.param == "tls":
        authority = trustme.CA()
        issued = authority.issue_cert("127.0.0.1", "localhost")
        ca, certificate, private = (tmp_path / name for name in ("ca.pem", "router.pem", "router.key"))
        authority.cert_pem.write_to_path(str(ca))
        certificate.write_bytes(b"".join(blob.bytes() for blob in issued.cert_chain_pems))
        issued.private_key_pem.write_to_path(str(private))
    access = {}
    for name, role in (("arm", "robot"), ("other", "robot"), ("ann", "driver"), ("wall", "viewer")):
        add_account(accounts, name, role, tmp_path / f"{name}.account")
        access[name] = LinkAccess(account=tmp_path / f"{name}.account", ca=ca)
    endpoint = f"{request.param}/localhost:{any_free_port()}"
    with routing((endpoint,), load_accounts(accounts), certificate, private):
        net = Net(tmp_path, endpoint, access)
        try:
            yield net
        finally:
            net.robot.stop()


def command() -> Command:
    return Command(lease="x", epoch=0, sequence=1, echo=0.0)


def test_a_viewer_sees_and_stops_and_can_do_nothing_else(net):
    viewer = net.console("wall", watches=True)
    assert viewer.meta().pid == 1
    viewer.send(command())
    refused = viewer.request(Request(what="acquire"))
    assert not refused.ok
    viewer.send_stop(encode(Stop(who="wall")))
    wait_for("the stop", lambda: net.got["stop"])
    assert net.got == {"stop": 1}, "only STOP passes"
    net.robot.publish_event(Event(stamp=1.0, level="info", text="hello"))
    wait_for("the event", lambda: viewer.events)
    viewer.stop()


def test_a_driver_drives(net):
    driver = net.console("ann", watches=False)
    wait_for("the robot to count its console", lambda: net.robot.consoles == 1)
    driver.send(command())
    assert driver.request(Request(what="acquire")).ok
    wait_for("the command", lambda: net.got["command"])
    driver.stop()
    wait_for("the console to be gone", lambda: net.robot.consoles == 0)


@pytest.mark.parametrize("name", ["wall", "ann", "other"])
def test_nobody_else_speaks_for_a_robot(net, name):
    watching = net.console("ann", watches=True)
    forger = net.session(name)
    for what in ("state", "event", "meta"):
        forger.put(key("arm", what), b"forged")
    token = forger.liveliness().declare_token(key("arm", "console/forged")) if name != "ann" else None
    net.robot.publish_state(msgspec.structs.replace(STATE, tick=2))
    wait_for("the robot's own state", lambda: watching.latest.tick == 2)
    assert watching.malformed == 0
    assert net.robot.consoles == 0
    assert not watching.events
    del token
    forger.close()
    watching.stop()


def test_strangers_do_not_get_in(net, tmp_path):
    wrong = tmp_path / "wrong.account"
    wrong.touch(0o600)
    wrong.write_text("wall:not-the-password-of-the-wall\n")
    for access in (LinkAccess(ca=net.access["wall"].ca), LinkAccess(account=wrong, ca=net.access["wall"].ca)):
        with pytest.raises(LinkError, match="cannot open the link"):
            open_session(
                "client", connect=(net.endpoint,), access=access, settings={"connect/timeout_ms": 1000}
            ).close()


def test_passwords_are_for_their_owner_only(tmp_path):
    accounts, out = tmp_path / "accounts.json", tmp_path / "wall.account"
    add_account(accounts, "wall", "viewer", out)
    for file in (accounts, out):
        assert stat.S_IMODE(os.stat(file).st_mode) == 0o600
    with pytest.raises(LinkError, match="already"):
        add_account(accounts, "wall", "driver", out)
    with pytest.raises(LinkError, match="letters, digits"):
        add_account(accounts, "a/b", "viewer", out)
    accounts.chmod(0o644)
    with pytest.raises(LinkError, match="chmod 600"):
        load_accounts(accounts)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[]", "accounts.json"),
        ('{"accounts": [{"name": "a", "role": "king", "password": "0123456789abcdef"}]}', "role"),
        ('{"accounts": [{"name": "a", "role": "viewer", "password": "short"}]}', "password"),
        ('{"acounts": []}', "acounts"),
    ],
)
def test_wrong_accounts_are_one_clear_line(tmp_path, text, says):
    path = tmp_path / "accounts.json"
    path.touch(0o600)
    path.write_text(text)
    with pytest.raises(LinkError, match=says) as raised:
        load_accounts(path)
    assert len(str(raised.value).splitlines()) == 1


def test_a_router_without_accounts_or_certificate_says_what_is_missing(tmp_path):
    with pytest.raises(LinkError, match="router account"), routing(("tcp/127.0.0.1:0",), ()):
        pass
    add_account(tmp_path / "a.json", "wall", "viewer", tmp_path / "wall.account")
    with (
        pytest.raises(LinkError, match="--tls-cert"),
        routing(("tls/127.0.0.1:0",), load_accounts(tmp_path / "a.json")),
    ):
        pass


def test_a_wall_hears_all_robots_through_the_router(net: Net) -> None:
    robots: dict[str, WatchedRobot] = {}
    feed = Feed(net.endpoint, robots, net.access["wall"])
    feed.start()

    def heard() -> bool:
        net.robot.publish_state(STATE)
        return "arm" in robots and robots["arm"].present and robots["arm"].latest() == STATE

    try:
        wait_for("the robot's state", heard)
        net.robot.publish_event(Event(stamp=1.0, level="alarm", text="slack"))
        wait_for("its event", lambda: [event.text for event in robots["arm"].events] == ["slack"])
        robots["arm"].stop("wall", "pressed")
        wait_for("the stop", lambda: net.got["stop"])
    finally:
        feed.stop()


def test_a_console_elsewhere_finds_the_robot_and_cannot_restart_it(net: Net) -> None:
    elsewhere = RobotElsewhere(net.endpoint, net.access["ann"])
    assert elsewhere.find().name == "arm"
    robot = RobotConnection(elsewhere, "arm")
    publishing = threading.Event()

    def publish() -> None:
        while not publishing.wait(0.02):
            net.robot.publish_state(STATE)

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        assert robot.start().pid == 1
        wait_for("the robot to count its console", lambda: net.robot.consoles == 1)
        refused = robot.restart()
        assert refused.reasons == (
            f"the robot process runs elsewhere, behind {net.endpoint}: restart it on its own machine",
        )
        assert robot.present, "and nothing was ended for it"
    finally:
        publishing.set()
        thread.join()
        robot.stop()


def test_who_records_through_the_router_hears_all_that_is_recorded(net: Net) -> None:
    heard: Counter[str] = Counter()
    hear = {
        name: (lambda data, name=name: heard.update([name])) for name in ("history", "event", "heard", "calibration")
    }
    listener = Listener("arm", net.endpoint, hear, access=net.access["wall"])
    listener.start()
    calibration = Calibration(stamp=1.0, homed=False, drives={})

    def told() -> bool:
        net.robot.publish_state(STATE)
        net.robot.publish_state(msgspec.structs.replace(STATE, stamp=2.0))
        net.robot.publish_event(Event(stamp=1.0, level="info", text="hello"))
        net.robot.publish_heard(Heard())
        net.robot.publish_calibration(calibration)
        return set(heard) == set(hear)

    wait_for("all of it", told)
    assert listener.calibration() == encode(calibration)
    listener.stop()


def test_an_account_for_the_router_shuts_out_nobody_beside_the_robot(net: Net) -> None:
    beside = ConsoleLink("arm", net.own)
    beside.start()
    assert beside.meta().pid == 1
    wait_for("both ways to it", lambda: net.robot.consoles == 1)
    beside.send(command())
    wait_for("the command", lambda: net.got["command"])
    beside.stop()


@pytest.mark.parametrize(
    ("account", "name", "says"),
    [
        ("ann", "borescope", "robot 'borescope' is not heard at {endpoint}; there: arm"),
        (None, "", "cannot open the link on {endpoint}"),
    ],
)
def test_what_is_wrong_with_a_robot_elsewhere_is_one_line(net: Net, account: str | None, name: str, says: str) -> None:
    access = net.access[account] if account else LinkAccess(ca=net.access["ann"].ca)
    with pytest.raises(LinkError, match=re.escape(says.format(endpoint=net.endpoint))) as raised:
        RobotElsewhere(net.endpoint, access, name).find()
    assert len(str(raised.value).splitlines()) == 1


def test_several_robots_or_none_are_told_apart(net: Net) -> None:
    text = description_text("cobra-twist-feed").replace('name = "cobra-twist-feed"', 'name = "other"', 1)
    meta = Meta(description=text, versions={}, pid=2)
    other = RobotLink(
        "other", f"tcp/127.0.0.1:{any_free_port()}", meta, router=net.endpoint, access=net.access["other"]
    )
    other.start(lambda _: None, lambda _: None, lambda data, answer: None)
    net.wait_for_robots("arm", "other")
    with pytest.raises(LinkError, match="choose one of arm, other with --robot"):
        RobotElsewhere(net.endpoint, net.access["ann"]).find()
    assert RobotElsewhere(net.endpoint, net.access["ann"], "other").find().name == "other"
    other.stop()
    net.robot.stop()
    net.wait_for_robots()
    with pytest.raises(LinkError, match="no robot is heard"):
        RobotElsewhere(net.endpoint, net.access["ann"]).find()
