"""Claims about who may drive: one lease, and every command that is not to be obeyed is dropped and counted by its reason."""

import math

import pytest

from cobra.control.authority import LEASE_STALE_S, Authority
from cobra.messages import Command, Intent


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
