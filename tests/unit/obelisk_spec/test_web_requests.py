import pytest

from obelisk_spec.runtime_protocol import is_of_the_page, names_this_host


@pytest.mark.parametrize("host", ["localhost:8080", "127.0.0.1", "[::1]:8080", "LOCALHOST:1"])
def test_this_host_has_several_names_on_any_port(host: str) -> None:
    assert names_this_host(host)


@pytest.mark.parametrize(
    "host",
    ["", "robot.example:8080", "127.0.0.1.example", "localhost@evil.example", "10.0.0.2", "[::1"],
)
def test_other_names_are_not_of_this_host(host: str) -> None:
    assert not names_this_host(host)


def test_a_page_is_the_one_that_is_asked_by_name_scheme_and_port() -> None:
    assert is_of_the_page("http://127.0.0.1:8080", "127.0.0.1:8080")
    for other in ("http://127.0.0.1:8081", "https://127.0.0.1:8080", "http://localhost:8080"):
        assert not is_of_the_page(other, "127.0.0.1:8080")
    for none in ("", "null"):
        assert not is_of_the_page(none, "127.0.0.1:8080")
