"""Where it listens, and that it does not listen beyond this machine by accident."""

import shutil
import ssl
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from app.console.front_door import FrontDoor
from app.console.listening import ListeningError, Tls, danger, is_loopback, load_tls, own_names
from tests.page_fakes import FakeSession


@pytest.fixture(scope="session")
def tls(tmp_path_factory) -> Tls:
    if shutil.which("openssl") is None:
        pytest.skip("there is no openssl to make a certificate with")
    folder = tmp_path_factory.mktemp("tls")
    made = Tls(folder / "cert.pem", folder / "key.pem")
    wanted = "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj /CN=localhost"
    names = "subjectAltName=DNS:localhost,IP:127.0.0.1"
    command = ["openssl", *wanted.split(), "-addext", names, "-keyout", made.key, "-out", made.certificate]
    subprocess.run(command, check=True, capture_output=True)
    return made


@pytest.mark.parametrize(("users", "tls", "missing"), [(False, False, "users and TLS"), (True, False, "without TLS")])
def test_it_refuses_to_listen_beyond_loopback_without_users_and_tls(users, tls, missing):
    for host in ("0.0.0.0", "::", "192.168.1.7", "robot.lab"):
        with pytest.raises(ListeningError, match=missing):
            danger(host, users, tls, insecure=False)
    assert danger("0.0.0.0", True, True, insecure=False) == ""
    assert danger("127.0.0.1", False, False, insecure=False) == ""


def test_told_to_be_insecure_it_says_what_that_means():
    assert "Whoever reaches this address drives" in danger("0.0.0.0", False, False, insecure=True)
    assert "no users" not in danger("0.0.0.0", True, False, insecure=True)
    assert "no TLS" in danger("0.0.0.0", True, False, insecure=True)


@pytest.mark.parametrize("host", ["127.0.0.1", "127.8.9.1", "::1", "localhost"])
def test_loopback_is_known_by_any_of_its_addresses(host):
    assert is_loopback(host)
    assert not is_loopback("127.0.0.1.evil.example")


def test_on_all_addresses_browsers_may_come_by_each_of_this_machines_names():
    assert "127.0.0.1" in own_names("0.0.0.0", ())
    assert own_names("192.168.1.7", ("robot.lab",)) == ("robot.lab",)


def test_the_command_refuses_in_one_line(tmp_path):
    for arguments in (["--host", "0.0.0.0"], ["--tls-cert", "no.pem"], ["--tls-cert", __file__, "--tls-key", __file__]):
        answer = subprocess.run(
            [sys.executable, "-m", "app", "--no-open", *arguments],
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )
        assert answer.returncode == 2
        assert len(answer.stderr.strip().splitlines()) == 1


def test_a_key_without_its_certificate_is_named(tls, tmp_path):
    with pytest.raises(ListeningError, match="--tls-cert"):
        load_tls(None, tls.key)
    with pytest.raises(ListeningError, match="no such file"):
        load_tls(tls.certificate, Path("nowhere.pem"))
    with pytest.raises(ListeningError, match="no certificate and its key"):
        load_tls(tls.key, tls.key)
    assert load_tls(tls.certificate, tls.key) == tls


def test_under_tls_the_cookie_is_sent_by_tls_alone_and_is_this_hosts(tls, no_viewer_port):
    trusted = ssl.create_default_context(cafile=str(tls.certificate))
    with FrontDoor("127.0.0.1", 0, no_viewer_port, FakeSession(), tls=tls) as door:
        assert door.url == f"https://127.0.0.1:{door.port}/"
        cookie = httpx.get(door.url, verify=trusted).headers["set-cookie"]
        assert cookie.startswith(f"__Host-cobra-{door.port}=")
        assert "Secure" in cookie
        assert "Path=/" in cookie
        assert "Domain" not in cookie
        with pytest.raises(httpx.HTTPError):
            httpx.get(door.url.replace("https", "http"))
