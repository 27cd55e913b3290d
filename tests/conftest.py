"""Fixtures that several rooms need. This file also puts the checkout on the import path: `from tests.… import …`."""

from collections.abc import Callable, Iterator

import pytest

from tests.virtual_pad import VirtualPad


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
