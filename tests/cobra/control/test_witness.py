"""Claims about what the robot tells a recorder: every command with its verdict, and never a lease that could be used."""

import msgspec
import pytest

from cobra.control.authority import Authority
from cobra.control.requests import Requests
from cobra.control.supervisor import Health
from cobra.control.witness import MOST, Witness, fingerprint
from cobra.messages import Command, Event, Heard, Reply, Request, encode

SECRET = "0123456789abcdef0123456789abcdef"


@pytest.fixture
def told() -> tuple[Witness, list[Heard]]:
    heard: list[Heard] = []
    return Witness(heard.append), heard


def command(sequence: int = 1, lease: str = SECRET) -> Command:
    return Command(lease=lease, epoch=1, sequence=sequence, echo=1.0)


def test_obeyed_and_dropped_commands_are_told_with_their_verdict(told):
    witness, heard = told
    witness.command(command(7), None, 1.5)
    witness.command(command(7), "repeated or older sequence", 1.5)
    witness.tell()
    obeyed, dropped = heard[0].commands
    assert (obeyed.command.sequence, obeyed.dropped, obeyed.stamp) == (7, "", 1.5)
    assert dropped.dropped == "repeated or older sequence"


def test_a_lease_never_leaves_the_process_but_can_be_told_from_another(told):
    witness, heard = told
    witness.command(command(), None, 1.0)
    witness.request(encode(Request(what="acquire", who="a")), Reply(ok=True, lease=SECRET), 1.0)
    witness.request(encode(Request(what="arm", lease=SECRET)), Reply(ok=True), 1.0)
    witness.tell()
    assert SECRET.encode() not in msgspec.msgpack.encode(heard)
    prints = {heard[0].commands[0].command.lease, heard[0].answers[0].reply.lease, heard[0].answers[1].request.lease}
    assert prints == {fingerprint(SECRET)}
    assert fingerprint(SECRET) != fingerprint(SECRET[::-1])
    assert fingerprint("") == ""


def test_a_flood_is_counted_not_told(told):
    witness, heard = told
    for sequence in range(200):
        witness.command(command(sequence), "wrong lease", 1.0)
    witness.tell()
    assert len(heard[0].commands) == MOST
    assert heard[0].omitted == 200 - MOST


def test_a_tick_in_which_nothing_arrived_says_nothing(told):
    witness, heard = told
    witness.tell()
    witness.request(b"\xff not a request", Reply(ok=False), 1.0)
    witness.tell()
    assert heard == []


def test_anybody_may_leave_a_marker_and_it_moves_nothing():
    events: list[Event] = []
    authority = Authority()
    epoch = authority.epoch
    requests = Requests(authority, lambda: pytest.fail("a marker ends no drive"), events.append)
    reply = requests.answer(encode(Request(what="mark", who="ada", reason="blade 7 " + "x" * 500)), 3.0, Health())
    assert reply.ok
    assert authority.epoch == epoch
    (event,) = events
    assert (event.level, event.stamp) == ("marker", 3.0)
    assert event.text.startswith("blade 7")
    assert event.text.endswith("(ada)")
    assert len(event.text) < 220
