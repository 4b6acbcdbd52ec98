"""Access control of the pages of `obk`: a running stack, and the viewer of a simulation."""

import pytest

from obelisk_spec.page_access import WebRequest, new_token, refusal

TOKEN = new_token()


def status(
    method: str = "GET",
    host: str = "127.0.0.1:8420",
    origin: str | None = None,
    tokens: tuple[str, ...] = (TOKEN,),
) -> int | None:
    why = refusal(WebRequest(method=method, host=host, origin=origin, tokens=tokens), TOKEN, "it")
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


@pytest.mark.parametrize(
    "origin", ["http://127.0.0.1:8421", "https://127.0.0.1:8420", "http://localhost:8420", "null"]
)
def test_a_page_is_compared_by_scheme_name_and_port(origin: str) -> None:
    assert status(origin="http://127.0.0.1:8420") is None
    assert status(origin=origin) == 403
