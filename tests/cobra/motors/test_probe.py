"""Drives are found without a description: who is there, what it speaks, and what it says of itself."""

from collections import Counter
from typing import Any

import msgspec
import pytest

from cobra.clock import ManualClock
from cobra.motors.channel import Channel
from cobra.motors.cia402_probe import find_cia402
from cobra.motors.rmd_channel import RmdChannel
from cobra.motors.rmd_probe import find_rmd
from tests.cobra.motors.handmade_drives import robot


@pytest.mark.parametrize("protocol", ["rmd-v1", "rmd-v3"])
def test_rmd_drives_are_found_with_their_dialect(protocol: str) -> None:
    d = robot(3, protocol)
    clock = ManualClock()
    options: dict[str, Any] = {"twin": "none", "stepping": "inline", "clock": clock, "description": d}
    channel = RmdChannel(d.buses[0], clock, options, Counter())
    channel.open()
    found = find_rmd(channel)
    channel.close()
    assert [(drive.address, drive.protocol) for drive in found] == [(k, protocol) for k in (1, 2, 3)]
    assert found[0].voltage_V == pytest.approx(36.0)
    assert (found[0].model, found[0].firmware) == (("SIM-RMD", "20220206") if protocol == "rmd-v3" else ("", ""))


def test_cia402_drives_are_found_with_name_state_and_supply() -> None:
    d = robot(3, "cia402")
    drives = tuple(msgspec.structs.replace(x, address=a) for x, a in zip(d.drives, (5, 17, 126), strict=True))
    d = msgspec.structs.replace(d, drives=drives)
    clock = ManualClock()
    options: dict[str, Any] = {"twin": "none", "stepping": "inline", "clock": clock, "description": d}
    channel = Channel(d.buses[0], clock, options, Counter())
    channel.open()
    found = find_cia402(channel)
    channel.close()
    assert [drive.address for drive in found] == [5, 17, 126]
    assert found[0].model == "Simulated small"
    assert found[0].firmware == "1.0"
    assert found[0].voltage_V == pytest.approx(36.0)
    assert found[0].errors == ()
    assert found[0].details == {"state": "switch on disabled"}
