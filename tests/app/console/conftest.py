"""A front door on a free port with a fake session behind it."""

import socket
from collections.abc import Iterator

import pytest

from app.console.front_door import FrontDoor
from tests.page_fakes import FakeSession


@pytest.fixture
def session() -> FakeSession:
    return FakeSession()


@pytest.fixture
def no_viewer_port() -> Iterator[int]:
    """A port on which nothing listens; bound, so that nobody else gets it meanwhile."""
    with socket.socket() as reserved:
        reserved.bind(("127.0.0.1", 0))
        yield reserved.getsockname()[1]


@pytest.fixture
def door(session: FakeSession, no_viewer_port: int) -> Iterator[FrontDoor]:
    with FrontDoor("127.0.0.1", 0, no_viewer_port, session) as door:
        yield door
