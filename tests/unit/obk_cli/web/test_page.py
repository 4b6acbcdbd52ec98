"""The page's files reference only each other, and text is never interpreted as HTML."""

import re
import socket
from html.parser import HTMLParser
from pathlib import Path

import pytest

import obk_cli.web
from obk_cli.errors import CommandFailedError

pytest.importorskip("starlette", reason="starlette is in the `web` extra")

from obk_cli.web.app import FILES

PAGE = Path(obk_cli.web.__file__).with_name("page")
SCRIPTS = sorted(PAGE.glob("*.js"))


class Tags(HTMLParser):
    """The tags of a page with their attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


HTML = (PAGE / "index.html").read_text()
TAGS = Tags(HTML).tags


def test_the_page_contains_nothing_forbidden_by_its_policy() -> None:
    for tag, attributes in TAGS:
        assert tag != "style"
        assert "style" not in attributes
        assert not [name for name in attributes if name.startswith("on")]
        assert tag != "script" or attributes["src"]


def test_requested_files_exist() -> None:
    named = [a.get("src") or a.get("href") for tag, a in TAGS if tag in ("script", "link")]
    assert named
    for script in SCRIPTS:
        named += re.findall(r'from "\.(/[^"]+)"', script.read_text())
    for name in named:
        assert name
        assert FILES[name.removeprefix("/")].is_file(), name


@pytest.mark.parametrize("path", sorted(PAGE.iterdir()), ids=lambda path: path.name)
def test_no_other_host_is_contacted(path: Path) -> None:
    text = path.read_text().replace('xmlns="http://www.w3.org/2000/svg"', "")
    assert not re.search(r"(?:https?:)?//[a-z0-9.-]+\.[a-z]", text)
    assert "@import" not in text


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_text_is_never_taken_for_html(script: Path) -> None:
    text = script.read_text()
    for word in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval("):
        assert word not in text


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_every_element_that_a_script_names_is_in_the_page(script: Path) -> None:
    ids = {attributes["id"] for _, attributes in TAGS if "id" in attributes}
    assert set(re.findall(r'byId\("([^"]+)"\)', script.read_text())) <= ids


def test_a_port_that_is_taken_is_reported() -> None:
    pytest.importorskip("uvicorn", reason="uvicorn is in the `web` extra")
    from obk_cli.web.app import take_port

    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(CommandFailedError, match=f"port {port} on 127.0.0.1 cannot be used"):
            take_port(port)
    with take_port(0) as taken:
        assert taken.getsockname()[0] == "127.0.0.1"
