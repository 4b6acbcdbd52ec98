"""Access control of the page of a running stack."""

import pytest

from obk_cli.web.auth import HEADERS, WebRequest, new_token, refusal

TOKEN = new_token()


def status(
    method: str = "GET",
    host: str = "127.0.0.1:8420",
    origin: str | None = None,
    tokens: tuple[str, ...] = (TOKEN,),
) -> int | None:
    why = refusal(WebRequest(method=method, host=host, origin=origin, tokens=tokens), TOKEN)
    return why.status if why else None


def test_a_request_with_the_token_is_accepted() -> None:
    assert status() is None
    assert status(tokens=("another one", TOKEN)) is None


@pytest.mark.parametrize("tokens", [(), ("",), ("wrong",), (TOKEN[:-1],), ("ü",)])
def test_a_request_without_the_token_is_rejected(tokens: tuple[str, ...]) -> None:
    assert status(tokens=tokens) == 401


def test_tokens_are_long_and_unique() -> None:
    assert len(TOKEN) >= 32
    assert new_token() != new_token()


@pytest.mark.parametrize("host", ["localhost:8420", "127.0.0.1", "[::1]:8420", "LOCALHOST:1"])
def test_this_host_has_several_names_and_a_tunnel_another_port(host: str) -> None:
    assert status(host=host) is None


@pytest.mark.parametrize(
    "host",
    ["", "robot.example:8420", "127.0.0.1.example", "localhost@evil.example", "10.0.0.2", "[::1"],
)
def test_a_rebound_host_name_is_rejected(host: str) -> None:
    assert status(host=host) == 403


def test_changes_are_accepted_from_the_page_itself() -> None:
    assert status("POST", origin="http://127.0.0.1:8420") is None
    assert status("POST", host="localhost:9000", origin="http://localhost:9000") is None


@pytest.mark.parametrize(
    "origin",
    [None, "", "null", "https://127.0.0.1:8420", "http://127.0.0.1:8080", "http://evil.example"],
)
def test_a_change_requested_by_another_page_is_rejected(origin: str | None) -> None:
    assert status("POST", origin=origin) == 403
    assert status("DELETE", origin=origin) == 403


def test_another_page_may_not_even_read() -> None:
    assert status(origin="http://evil.example") == 403


def test_only_code_from_the_page_itself_is_run() -> None:
    policy = dict(part.split(" ", 1) for part in HEADERS["Content-Security-Policy"].split("; "))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == "'self'"
    assert policy["frame-ancestors"] == "'none'"
    assert "unsafe" not in HEADERS["Content-Security-Policy"]
