"""Claims about what arrives damaged: it is counted, dropped and named in the page, and nothing moves."""

import math

import msgspec
import pytest

from app.link.keys import key
from cobra.loading import load_description
from cobra.mechanics.losses import described, to_text
from cobra.messages import Command, Intent, Request
from tests.stack import Page, running, wait_for


@pytest.fixture(scope="module")
def stack(tmp_path_factory):
    with running(tmp_path_factory.mktemp("stack")) as stack:
        yield stack


def drops(stack) -> dict[str, int]:
    return stack.observer.state.drops


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "malformed message"),
        (b"\xc1 not MessagePack", "malformed message"),
        (msgspec.msgpack.encode({"lease": 3}), "malformed message"),
        (msgspec.msgpack.encode([1, 2, 3]), "malformed message"),
        (msgspec.msgpack.encode(Command(lease="forged", epoch=1, sequence=1, echo=0.0, held=True)), "wrong lease"),
    ],
)
def test_a_bad_command_is_counted_and_named_in_the_page(stack, data, reason):
    before = drops(stack).get(reason, 0)
    session = stack.observer.link._session
    session.put(key("cobra", "command"), data)
    stack.observer.wait(reason, lambda state: state.drops.get(reason, 0) == before + 1)
    with Page(stack.url) as page:
        wait_for("the page's word", lambda: page.snapshot["drops"].get(reason, 0) >= before + 1)
    assert stack.observer.state.phase == "disarmed"


def test_a_request_that_cannot_be_read_is_refused(stack):
    session = stack.observer.link._session
    replies = list(session.get(key("cobra", "request"), payload=b"\xc1", timeout=2.0))
    assert msgspec.msgpack.decode(replies[0].ok.payload.to_bytes())["ok"] is False
    stack.observer.wait("the count", lambda state: state.drops.get("malformed request", 0) >= 1)


@pytest.mark.parametrize("what", ["arm", "disarm", "home", "clear", "quit"])
def test_only_the_driver_may_act(stack, what):
    reply = stack.observer.link.request(Request(what=what, lease="forged"))
    assert not reply.ok
    assert "driver" in reply.reasons[0]
    assert stack.observer.state.phase == "disarmed"


LOSSES = to_text(described(load_description("cobra")))


CANNOT_BE = {
    LOSSES.replace("axial_stiffness_N = ", "axial_stiffness_N = -", 1): "losses.axial_stiffness_N = -10180.0: must",
    LOSSES.replace("hole_friction = 0.1", "hole_friction = nan", 1): "losses.hole_friction = nan: must be finite",
    LOSSES.replace("settling_s", "setling_s", 1): "losses: unknown key 'setling_s'; there are axial_stiffness_N",
    "not = = TOML": "not valid TOML",
}


def test_loss_parameters_that_cannot_be_are_refused_by_the_running_robot_with_the_reason(stack):
    link = stack.observer.link
    with Page(stack.url) as page:

        def controls() -> str:
            # The console may take them back before we come: then it is asked again.
            page.ask("release")
            return link.request(Request(what="acquire", who="test")).lease

        lease = wait_for("the controls", controls)
        for text, says in CANNOT_BE.items():
            reply = link.request(Request(what="parameters", name=text, lease=lease))
            assert not reply.ok
            assert says in reply.reasons[0]
        assert link.request(Request(what="parameters", name=LOSSES, lease=lease)).ok
        assert link.request(Request(what="release", lease=lease)).ok
        wait_for("the page's controls", lambda: page.ask("acquire")["ok"])


@pytest.mark.parametrize("value", [math.nan, math.inf, 1.5])
def test_a_stick_that_is_not_finite_or_out_of_range_is_dropped(stack, value):
    from cobra.control.authority import Authority

    authority = Authority()
    lease = authority.acquire("me", 1.0)
    command = Command(lease=lease, epoch=authority.epoch, sequence=1, echo=1.0, intent=Intent(primary=(value, 0.0)))
    sent = msgspec.msgpack.decode(msgspec.msgpack.encode(command), type=Command)
    assert authority.accept(sent, 1.0) == "not finite or out of range"


def test_a_stop_that_cannot_be_read_still_stops(stack):
    stack.observer.link._session.put(key("cobra", "stop"), b"\xc1")
    stack.observer.wait("stopped", lambda state: state.phase == "stopped")
    assert drops(stack)["malformed stop (obeyed)"] == 1
    with Page(stack.url) as page:
        assert page.ask("clear")["ok"]
        page.until_phase("disarmed")
