"""Claims about who may drive: one lease, and every command that is not to be obeyed is dropped and counted by its reason."""

import math

import pytest

from cobra.control.authority import ASK_S, KEPT_S, LEASE_STALE_S, MAX_ASKING, Authority
from cobra.control.requests import Requests
from cobra.control.supervisor import Health
from cobra.messages import Command, Event, Intent, Request, encode


@pytest.fixture
def held() -> tuple[Authority, str]:
    authority = Authority()
    lease = authority.acquire("alice", 10.0)
    assert lease is not None
    return authority, lease


def command(authority: Authority, held_lease: str, number: int = 1, **changes) -> Command:
    good = {"lease": held_lease, "epoch": authority.epoch, "sequence": number, "echo": 10.0, "held": True}
    return Command(**good | changes)


def test_a_good_command_is_obeyed_and_keeps_the_lease_fresh(held):
    authority, lease = held
    assert authority.accept(command(authority, lease), 10.1) is None
    assert authority.fresh(10.1 + LEASE_STALE_S)
    assert not authority.drops


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"lease": "stolen"}, "wrong lease"),
        ({"lease": ""}, "wrong lease"),
        ({"epoch": 0}, "old epoch"),
        ({"sequence": 0}, "repeated or older sequence"),
        ({"echo": 9.5}, "too old"),
        ({"echo": 10.2}, "stamped in the future"),
        ({"echo": math.nan}, "not finite or out of range"),
        ({"intent": Intent(primary=(math.nan, 0.0))}, "not finite or out of range"),
        ({"intent": Intent(feed=math.inf)}, "not finite or out of range"),
        ({"intent": Intent(twist=1.5)}, "not finite or out of range"),
        ({"intent": Intent(speed=-0.1)}, "not finite or out of range"),
    ],
)
def test_a_bad_command_is_dropped_and_counted_by_its_reason(held, changes, reason):
    authority, lease = held
    assert authority.accept(command(authority, lease, **changes), 10.1) == reason
    assert authority.drops == {reason: 1}


def test_a_repeated_command_is_dropped(held):
    authority, lease = held
    assert authority.accept(command(authority, lease, 5), 10.1) is None
    assert authority.accept(command(authority, lease, 5), 10.1) == "repeated or older sequence"
    assert authority.accept(command(authority, lease, 4), 10.1) == "repeated or older sequence"


def test_a_fresh_lease_cannot_be_acquired_but_a_stale_one_can(held):
    authority, lease = held
    assert authority.acquire("bob", 10.0 + LEASE_STALE_S) is None
    assert authority.acquire("bob", 10.01 + LEASE_STALE_S) is not None
    assert authority.accept(command(authority, lease), 10.1) == "wrong lease"


def test_revoking_fences_off_commands_on_their_way(held):
    authority, lease = held
    late = command(authority, lease)
    authority.revoke()
    assert authority.accept(late, 10.1) == "wrong lease"
    assert not authority.retain(lease, 10.1)
    assert authority.lease(10.1).holder == ""


def test_taking_over_ends_the_former_lease(held):
    authority, lease = held
    epoch = authority.epoch
    taken = authority.take("admin", 10.1)
    assert authority.epoch > epoch
    assert not authority.holds(lease)
    assert authority.holds(taken)
    assert authority.lease(10.1).holder == "admin"


# ---------------------------------------------------------------- asking, giving, taking over


class Robot:
    """Requests as the robot answers them; `told` is what everybody hears."""

    def __init__(self):
        self.authority = Authority()
        self.told: list[Event] = []
        self.lost = 0
        self.requests = Requests(self.authority, self._lose, self.told.append)

    def _lose(self):
        self.lost += 1

    def ask(self, what: str, now_s: float = 10.0, **fields):
        return self.requests.answer(encode(Request(what=what, **fields)), now_s, Health())


@pytest.fixture
def robot() -> Robot:
    return Robot()


def test_the_controls_pass_from_hand_to_hand(robot):
    anna = robot.ask("acquire", who="anna")
    ticket = robot.ask("ask", who="bob").lease
    assert robot.authority.lease(10.0).asking == ("bob",)
    assert robot.ask("grant", who="anna", lease=anna.lease, name="bob").ok
    assert robot.lost == 2, "whatever drove has ended"
    assert robot.authority.lease(10.0).kept_for == "bob"
    assert not robot.ask("acquire", who="carl").ok, "nobody snatches them on the way"
    bob = robot.ask("acquire", who="bob", lease=ticket)
    assert bob.ok
    assert bob.epoch > anna.epoch
    assert robot.authority.lease(10.0).holder == "bob"
    assert robot.authority.lease(10.0).asking == ()
    old = Command(lease=anna.lease, epoch=anna.epoch, sequence=99, echo=10.0, held=True)
    assert robot.authority.accept(old, 10.0) == "wrong lease"
    told = [event.text for event in robot.told]
    assert told == [
        "anna took the controls",
        "bob asks anna for the controls",
        "anna gave the controls to bob",
        "bob took the controls",
    ]


def test_a_gift_that_is_not_fetched_is_free_again(robot):
    anna = robot.ask("acquire", who="anna")
    robot.ask("ask", who="bob")
    robot.ask("grant", lease=anna.lease, name="bob")
    assert not robot.ask("acquire", 10.0 + KEPT_S - 0.1, who="carl").ok
    assert robot.ask("acquire", 10.0 + KEPT_S + 0.1, who="carl").ok


def test_only_the_holder_gives_and_only_to_who_asks(robot):
    anna = robot.ask("acquire", who="anna")
    robot.ask("ask", who="bob")
    assert not robot.ask("grant", lease="", name="bob").ok
    assert not robot.ask("grant", lease="stolen", name="bob").ok
    assert not robot.ask("grant", lease=anna.lease, name="carl").ok
    assert not robot.ask("refuse", lease="stolen", name="bob").ok
    assert robot.authority.lease(10.0).holder == "anna"
    assert robot.ask("refuse", lease=anna.lease, name="bob").ok
    assert not robot.ask("grant", lease=anna.lease, name="bob").ok


def test_asking_is_forgotten_and_bounded_and_pointless_when_nobody_drives(robot):
    assert "nobody drives" in robot.ask("ask", who="bob").reasons[0]
    anna = robot.ask("acquire", who="anna")
    for number in range(20):
        robot.ask("ask", who=f"user {number}")
    assert len(robot.authority.lease(10.0).asking) == MAX_ASKING
    robot.ask("retain", 10.0 + ASK_S + 1, lease=anna.lease)
    assert robot.authority.lease(10.0 + ASK_S + 1).asking == ()


def test_taking_over_needs_a_reason_that_everybody_is_told(robot):
    anna = robot.ask("acquire", who="anna")
    for blank in ("", "  "):
        assert "needs a reason" in robot.ask("take", who="eve", reason=blank).reasons[0]
    assert robot.authority.holds(anna.lease)
    assert robot.ask("take", who="eve", reason="anna fell asleep").ok
    assert not robot.authority.holds(anna.lease)
    assert (robot.told[-1].level, robot.told[-1].text) == (
        "warning",
        "eve took the controls from anna: anna fell asleep",
    )
