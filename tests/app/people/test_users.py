"""The users' file: tokens are kept nowhere, the file is private, and what is wrong with it is one clear line."""

import stat
import subprocess
import sys

import pytest

from app.people.rate_limit import RateLimit, network_of
from app.people.roles import may_ask
from app.people.sessions import IDLE_S, MAX_SESSIONS, Sessions
from app.people.users import Users, UsersError


@pytest.fixture
def users(tmp_path):
    return Users(tmp_path / "users.json")


def test_a_user_is_known_by_the_token_alone(users):
    token, other = users.add("anna", "driver"), users.add("bob", "viewer")
    assert users.check("anna", token).role == "driver"
    for name, wrong in (("anna", other), ("bob", token), ("anna", ""), ("", token), ("nobody", token), ("eve", token)):
        assert users.check(name, wrong) is None
    assert len(token) >= 26


def test_the_file_is_its_owners_and_holds_no_token(users):
    token = users.add("anna", "driver")
    assert stat.S_IMODE(users.path.stat().st_mode) == 0o600
    assert token not in users.path.read_text()
    again = Users(users.path)
    assert again.check("anna", token).name == "anna"


def test_the_same_token_for_two_people_would_not_show(users):
    users.add("anna", "driver")
    users.add("bob", "driver")
    hashes = {(user.salt, user.hash) for user in users.all().values()}
    assert len({salt for salt, _ in hashes}) == 2


def test_a_renewed_token_replaces_the_old_one_and_a_removed_user_is_gone(users):
    old = users.add("anna", "admin")
    new = users.renew("anna")
    assert users.check("anna", old) is None
    assert users.check("anna", new).role == "admin"
    users.remove("anna")
    assert users.check("anna", new) is None


@pytest.mark.parametrize("name", ["", "a b", "../x", "-x", "x" * 33, "ä", "a/b", "<b>", "a\n"])
def test_a_name_that_could_do_harm_is_refused(users, name):
    with pytest.raises(UsersError, match="is no name"):
        users.add(name, "viewer")
    assert not users.path.exists()


@pytest.mark.parametrize("text", ["{", "[]x", '[{"name": "a"}]', '[{"name":"a","role":"king","salt":"","hash":""}]'])
def test_a_damaged_file_lets_nobody_in_and_says_where(users, text):
    users.path.touch(mode=0o600)
    users.path.write_text(text)
    with pytest.raises(UsersError, match=r"users\.json: is no users' file"):
        users.all()


def test_a_file_that_others_may_read_is_refused(users):
    users.add("anna", "viewer")
    users.path.chmod(0o644)
    with pytest.raises(UsersError, match="chmod 600"):
        Users(users.path).all()


def test_a_stop_is_everybodys_and_taking_over_an_admins():
    assert may_ask("viewer", "stop")
    assert [what for what in ("arm", "section", "clear", "note", "quit", "take", "") if may_ask("viewer", what)] == []
    assert may_ask("driver", "clear")
    assert not may_ask("driver", "take")
    assert may_ask("admin", "take")


# ---------------------------------------------------------------- sessions


class Time:
    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def time():
    return Time()


def test_without_users_everybody_is_who_started_it_but_needs_the_cookie(users, time):
    sessions = Sessions(users, "me", time)
    assert not sessions.sign_in_needed
    host = sessions.host()
    assert (host.name, host.role) == ("me", "admin")
    assert sessions.find(host.session) == host
    assert sessions.find("") is None
    assert sessions.find(host.ticket) is None, "the view's ticket is no session"
    assert sessions.find_ticket(host.session) is None


def test_a_session_ends_with_its_user_its_token_and_by_itself(users, time):
    token = users.add("anna", "driver")
    sessions = Sessions(users, "me", time)
    assert sessions.host() is None
    assert sessions.sign_in("anna", "wrong") is None
    first, second = sessions.sign_in("anna", token), sessions.sign_in("anna", token)
    assert first.session != second.session
    sessions.sign_out(first.session)
    assert sessions.find(first.session) is None
    assert sessions.find_ticket(first.ticket) is None
    assert sessions.find_ticket(second.ticket).name == "anna"
    users.change_role("anna", "viewer")
    assert sessions.find(second.session).role == "viewer", "at once, in the session that is open"
    users.renew("anna")
    assert sessions.find(second.session) is None
    users.add("bob", "viewer")
    third = sessions.sign_in("bob", users.renew("bob"))
    time.now += IDLE_S - 1
    assert sessions.find(third.session)
    time.now += IDLE_S + 1
    assert sessions.find(third.session) is None


def test_sessions_are_bounded(users, time):
    token = users.add("anna", "viewer")
    sessions = Sessions(users, "me", time)
    opened = [sessions.sign_in("anna", token) for _ in range(MAX_SESSIONS + 1)]
    assert sessions.find(opened[0].session) is None
    assert sessions.find(opened[-1].session)


def test_tries_are_limited_for_each_network_and_memory_is_bounded(time):
    limit = RateLimit(3, 10.0, time)
    assert [limit.wait_s("a") for _ in range(4)] == [0, 0, 0, 10.0]
    assert limit.wait_s("b") == 0
    time.now += 10.0
    assert [limit.wait_s("a") > 0 for _ in range(2)] == [False, True]
    for number in range(10_000):
        limit.wait_s(str(number))
    assert len(limit._buckets) <= 4096
    assert network_of("2001:db8::1") == network_of("2001:db8::2:3") != network_of("2001:db9::1")


# ---------------------------------------------------------------- the command


def test_the_command_adds_lists_and_removes(tmp_path, monkeypatch):
    monkeypatch.setenv("COBRA_TELEOP_CONFIG_DIR", str(tmp_path))

    def users(*arguments):
        command = [sys.executable, "-m", "app", "users", *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)

    told = users("add", "anna", "--role", "driver").stdout
    token = told.split()[-1]
    assert Users(tmp_path / "users.json").check("anna", token).role == "driver"
    again = users("add", "anna")
    assert (again.returncode, len(again.stderr.splitlines())) == (2, 1)
    assert users("list").stdout.split() == ["anna", "driver"]
    assert token not in users("list").stdout
    assert users("remove", "anna").returncode == 0
    assert "no users" in users("list").stdout
