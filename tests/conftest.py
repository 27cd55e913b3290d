"""Fixtures that several rooms need. This file also puts the checkout on the import path: `from tests.… import …`."""

import os
from collections.abc import Callable, Iterator

import pytest
from hypothesis import settings

from tests.virtual_pad import VirtualPad

# CI tries the same examples every time; at the desk every run looks for new ones. On a busy machine an example may take
# long: how long is not what these tests are about.
settings.register_profile("desk", deadline=None)
settings.register_profile("ci", derandomize=True, deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "desk")


@pytest.fixture(scope="session", autouse=True)
def folders_of_their_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Users, profiles and audit trails of whoever runs the tests stay out of them."""
    for kind in ("CONFIG", "STATE", "DATA"):
        os.environ[f"COBRA_TELEOP_{kind}_DIR"] = str(tmp_path_factory.mktemp(kind.lower()))


@pytest.fixture(autouse=True)
def scheduled_as_before() -> Iterator[None]:
    """Real-time scheduling that a test leaves behind is inherited by every browser that is started later."""
    scheduling = getattr(os, "sched_getscheduler", lambda pid: None)  # Linux only
    before = scheduling(0)
    yield
    assert scheduling(0) == before, "this test left the process with another scheduling"


@pytest.fixture
def plug() -> Iterator[Callable[..., VirtualPad]]:
    """Plug virtual pads into this process; they are pulled out when the test ends."""
    pads: list[VirtualPad] = []

    def plug_in(name: str = "Test Pad", *, axes: int = 6, mapped: bool = True) -> VirtualPad:
        pads.append(VirtualPad(name, axes=axes, mapped=mapped))
        return pads[-1]

    yield plug_in
    for pad in pads:
        pad.detach()


WHOLE_PROGRAM = ("/faults/", "test_worlds.py", "test_src_bot_program.py", "test_deployments.py", "test_drive_from.py")
IN_REAL_TIME = (
    *WHOLE_PROGRAM,
    "/browser/",
    "/recording/",
    "test_commission.py",
    "test_panels.py",
    "test_precedence.py",
    "test_router.py",
    "test_watching.py",
)
"""They start processes or a browser, and what these do takes its time: one after the other, whatever runs beside them."""


def pytest_itemcollected(item):
    """The whole program in real time on two cores: a stall ends a drive, as it must, so such a test is run anew."""
    path = item.path.as_posix()
    if any(part in path for part in WHOLE_PROGRAM):
        item.add_marker(pytest.mark.flaky(reruns=2))
    if any(part in path for part in IN_REAL_TIME):
        item.add_marker(pytest.mark.xdist_group("in real time"))
