"""What a page may send, what becomes of it, and that nothing else gets through."""

import asyncio
import json
import threading
import time
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from app.console.front_door import FrontDoor
from app.console.inputs import Controls
from app.console.mapping import DEAD_MAN
from app.console.page_socket import MAX_REQUESTS, SILENCE_S
from app.console.page_state import Answer
from tests.page_fakes import FakeSession, PageClient


@pytest.fixture
def page(door: FrontDoor) -> Any:
    with PageClient(door.port) as page:
        yield page


def press(page: PageClient, session: FakeSession) -> None:
    """Let go, then hold."""
    page.drive()
    page.drive(held=True)
    session.wait(lambda: session.held)


def test_a_page_is_told_its_name_the_facts_and_then_the_state(page: PageClient) -> None:
    assert page.welcome["page"] == "page 1"
    assert page.welcome["sections"] == ["base", "middle", "tip"]
    stamps = [page.next("snapshot")["stamp"] for _ in range(4)]
    assert stamps == sorted(set(stamps))
    assert page.snapshot["tip_mm"] == [41.2, -18.7, 262.4]


def test_two_pages_have_two_names_and_see_the_same_state(door: FrontDoor, page: PageClient) -> None:
    with PageClient(door.port) as other:
        assert other.welcome["page"] == "page 2"
        assert other.snapshot["tensions"] == page.snapshot["tensions"]


def test_controls_arrive_as_the_reading_of_a_pad(page: PageClient, session: FakeSession) -> None:
    page.drive()
    page.drive(left=[0.5, -1], right=[-0.25, 0], lt=0.75, rt=1, buttons=["right_shoulder"], held=True)
    session.wait(lambda: session.held)
    name, sequence, controls = session.received[-1]
    assert (name, sequence) == ("page 1", 2)
    assert controls == Controls(
        left=(0.5, -1.0),
        right=(-0.25, 0.0),
        left_trigger=0.75,
        right_trigger=1.0,
        buttons=frozenset({"right_shoulder", DEAD_MAN}),
        stamp=controls.stamp,
    )


def test_the_dead_man_is_only_what_the_page_holds(page: PageClient, session: FakeSession) -> None:
    page.drive(buttons=["left_shoulder", "a"])
    page.settle()
    assert session.newest.buttons == {"a"}


def test_a_page_that_comes_with_its_dead_man_held_must_let_go_first(page: PageClient, session: FakeSession) -> None:
    page.drive(held=True)
    page.drive(held=True)
    page.settle()
    assert len(session.received) == 2
    assert not session.held
    press(page, session)


def test_a_page_that_falls_silent_while_it_drives_is_released(
    door: FrontDoor, page: PageClient, session: FakeSession
) -> None:
    press(page, session)
    session.wait(lambda: session.ended == ["page 1"])
    assert door.counts["page fell silent while driving"] == 1
    page.drive(held=True)
    page.settle()
    assert not session.held, "it must let go before it may drive again"
    press(page, session)


def test_a_stall_of_the_server_itself_is_no_silence_of_the_page(page: PageClient, session: FakeSession) -> None:
    stalled = threading.Event()

    def stall() -> None:
        session.before_snapshot = lambda: None
        stalled.set()
        time.sleep(1.5 * SILENCE_S)

    press(page, session)
    session.before_snapshot = stall
    assert stalled.wait(10)
    page.drive(held=True, echo=page.snapshot["stamp"])  # waits in the socket while the server's thread is held up
    page.settle()
    assert session.held
    assert session.ended == []


def test_malformed_messages_do_not_count_as_a_sign_of_life(page: PageClient, session: FakeSession) -> None:
    press(page, session)
    for _ in range(400):
        if session.ended:
            break
        page.drive(held=True, left=[2, 0])  # paced by the snapshots it waits for
    assert session.ended == ["page 1"]


def test_an_idle_page_may_be_silent(page: PageClient, session: FakeSession) -> None:
    page.drive()
    for _ in range(8):
        page.next("snapshot")
    assert session.ended == []


def test_a_page_that_closes_ends_its_input(page: PageClient, session: FakeSession) -> None:
    press(page, session)
    page.close()
    session.wait(lambda: "page 1" in session.ended)


VALID = {
    "type": "controls", "seq": 9, "stamp": 0, "echo": 0, "left": [0, 0], "right": [0, 0],
    "lt": 0, "rt": 0, "buttons": [], "held": False,
}  # fmt: skip


def but(**changes: Any) -> str:
    return json.dumps({**VALID, **changes})


def without(key: str) -> str:
    return json.dumps({name: value for name, value in VALID.items() if name != key})


UNUSABLE = {
    "empty": "",
    "no JSON": "controls!",
    "cut off": but()[:-3],
    "two at once": but() + but(),
    "null": "null",
    "list": "[]",
    "number": "7",
    "no type": without("type"),
    "unknown type": but(type="drive"),
    "missing echo": without("echo"),
    "unknown key": but(epoch=3),
    "stick beyond 1": but(left=[1.0001, 0]),
    "stick below -1": but(right=[0, -1.0001]),
    "stick with one axis": but(left=[0]),
    "stick with three axes": but(left=[0, 0, 0]),
    "stick as text": but(left=["0", "0"]),
    "stick null": but(left=None),
    "not a number": but(left=[float("nan"), 0]),
    "infinite": but(left=[0, float("inf")]),
    "too big for a float": but().replace('"lt": 0', '"lt": 1e999'),
    "infinite echo": but(echo=float("-inf")),
    "trigger below 0": but(lt=-0.1),
    "trigger beyond 1": but(rt=1.1),
    "held as number": but(held=1),
    "held as text": but(held="true"),
    "unknown button": but(buttons=["guide"]),
    "buttons as text": but(buttons="a"),
    "negative sequence": but(seq=-1),
    "fractional sequence": but(seq=9.5),
    "huge sequence": but(seq=2**80),
    "deep": '{"x":' + "[" * 2000 + "]" * 2000 + ',"type":"ping","stamp":1}',
    "unknown request": json.dumps({"type": "act", "id": 1, "what": "format", "value": None}),
    "request without id": json.dumps({"type": "act", "what": "arm"}),
    "value as text": json.dumps({"type": "act", "id": 1, "what": "section", "value": "1"}),
    "value negative": json.dumps({"type": "act", "id": 1, "what": "section", "value": -1}),
    "value huge": json.dumps({"type": "act", "id": 1, "what": "section", "value": 10**9}),
    "value a table": json.dumps({"type": "act", "id": 1, "what": "section", "value": {}}),
    "over 4 kB": but(left=[0, 0], pad="x" * 4096),
    "over 4 kB in bytes only": json.dumps({"type": "ping", "stamp": 1, "x": "é" * 2040}, ensure_ascii=False),
    "a megabyte": "x" * 1_000_000,
    "binary": but().encode(),
    "binary zeros": bytes(64),
}


@pytest.mark.parametrize("message", UNUSABLE.values(), ids=UNUSABLE.keys())
def test_an_unusable_message_is_counted_and_dropped(
    door: FrontDoor, page: PageClient, session: FakeSession, message: str | bytes
) -> None:
    page.send_raw(message)
    page.settle()
    assert sum(door.counts.values()) == 1
    assert (session.received, session.acts) == ([], [])
    assert page.next("snapshot")["page_drops"] == dict(door.counts), "the page is told what was dropped"


def test_a_repeated_or_older_sequence_is_dropped(door: FrontDoor, page: PageClient, session: FakeSession) -> None:
    for sequence in (5, 5, 4, 6):
        page.drive(seq=sequence)
    page.settle()
    assert [number for _, number, _ in session.received] == [5, 6]
    assert door.counts["repeated or older controls"] == 2


@pytest.mark.parametrize(("offset_s", "reason"), [(-0.9, "too long on their way"), (5.0, "stamped in the future")])
def test_a_press_is_dropped_when_its_page_saw_no_recent_state(
    door: FrontDoor, page: PageClient, session: FakeSession, offset_s: float, reason: str
) -> None:
    page.drive()
    page.drive(held=True, echo=page.snapshot["stamp"] + offset_s)
    page.settle()
    assert len(session.received) == 1
    assert any(reason in counted for counted in door.counts)


def test_letting_go_is_obeyed_however_late_it_arrives(page: PageClient, session: FakeSession) -> None:
    press(page, session)
    page.drive(echo=page.snapshot["stamp"] - 60)
    session.wait(lambda: not session.held)


def test_requests_are_answered_with_their_reasons(page: PageClient, session: FakeSession) -> None:
    session.answer = lambda what, value: Answer(ok=what != "arm", reasons=["not homed"] if what == "arm" else [])
    page.send({"type": "act", "id": 7, "what": "arm"})
    assert page.next("reply") == {"type": "reply", "id": 7, "ok": False, "reasons": ["not homed"]}
    page.send({"type": "act", "id": 8, "what": "section", "value": 2})
    assert page.next("reply") == {"type": "reply", "id": 8, "ok": True, "reasons": []}
    assert session.acts == [("page 1", "arm", None), ("page 1", "section", 2)]


def test_a_request_that_takes_long_holds_up_neither_driving_nor_stop(
    door: FrontDoor, page: PageClient, session: FakeSession
) -> None:
    async def never() -> Answer:
        await asyncio.Event().wait()
        raise AssertionError

    session.answer = lambda what, value: Answer(ok=True, reasons=[]) if what == "stop" else never()
    for number in range(MAX_REQUESTS + 3):
        page.send({"type": "act", "id": number, "what": "home"})
    press(page, session)
    page.send({"type": "act", "id": 99, "what": "stop"})
    assert page.next("reply")["id"] == 99
    assert session.requests == ["home"] * MAX_REQUESTS + ["stop"]
    assert door.counts["too many requests at once"] == 3


def test_a_fault_while_answering_is_an_answer_too(
    door: FrontDoor, page: PageClient, session: FakeSession, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(what: str, value: int | None) -> Answer:
        raise RuntimeError("no robot")

    session.answer = fail
    page.send({"type": "act", "id": 1, "what": "arm"})
    reply = page.next("reply")
    assert not reply["ok"]
    assert "no robot" in reply["reasons"][0]
    assert door.counts["request failed"] == 1
    assert "arm" in caplog.text


def test_numbers_that_are_not_finite_reach_the_page_as_unknown(page: PageClient, session: FakeSession) -> None:
    session.changes["twist_deg"] = float("nan")
    session.changes["tip_mm"] = [float("inf"), 1.0, 2.0]
    while page.next("snapshot")["twist_deg"] is not None:
        pass
    assert page.snapshot["tip_mm"] == [None, 1.0, 2.0]


def test_a_faulty_snapshot_ends_that_page_and_is_counted(
    door: FrontDoor, page: PageClient, session: FakeSession, caplog: pytest.LogCaptureFixture
) -> None:
    session.changes["tip_mm"] = object()
    with pytest.raises(ConnectionClosed):
        page.read_until_closed()
    session.wait(lambda: session.ended == ["page 1"])
    assert door.counts["page failed"] == 1
    session.changes.clear()
    PageClient(door.port).close()
