"""Links in the documents lead to existing files and headings."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(
    [
        *DOCS.rglob("*.md"),
        *ROOT.glob("*.md"),
        *ROOT.glob("examples/*/README.md"),
        ROOT / "benchmarks" / "README.md",
    ]
)
CODE = re.compile(r"^```.*?^```$|(`+).+?\1", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\((?P<target>[^)\s]+)\)")
HEADING = re.compile(r"^#+ (?P<text>.+)$", re.MULTILINE)


def prose(page: Path) -> str:
    """A page without its code, in which brackets are not links."""
    return CODE.sub("code", page.read_text(encoding="utf-8"))


def anchors(page: Path) -> set[str]:
    """Anchors of headings, as GitHub and MkDocs derive them from plain words."""
    without_listings = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    texts = (heading["text"].lower() for heading in HEADING.finditer(without_listings))
    return {re.sub(r"[^\w\s-]", "", text).strip().replace(" ", "-") for text in texts}


def links(page: Path) -> Iterator[str]:
    found = (link["target"] for link in LINK.finditer(prose(page)))
    return (target for target in found if not target.startswith(("http://", "https://")))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_link_has_a_target(page: Path) -> None:
    for target in links(page):
        path, _, anchor = target.partition("#")
        aim = (page.parent / path).resolve() if path else page
        assert aim.exists(), target
        # Pages made of docs/ alone cannot link to files outside docs/.
        assert not page.is_relative_to(DOCS) or aim.is_relative_to(DOCS), target
        assert not anchor or anchor in anchors(aim), target


def test_every_document_is_led_to() -> None:
    site = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    shown = set(re.findall(r"[\w/-]+\.md", str(site["nav"])))
    pages = {str(page.relative_to(DOCS)) for page in DOCS.rglob("*.md")}
    rules = {page for page in pages if re.fullmatch(r"reference/rules/OBK\d{3}\.md", page)}
    assert shown == pages - rules
    index = set(links(DOCS / "index.md"))
    assert pages - rules - {"index.md"} <= {link.partition("#")[0] for link in index}


def test_every_picture_is_shown() -> None:
    shown = {
        (page.parent / target).resolve()
        for page in PAGES
        for target in re.findall(r"!\[[^\]]*\]\(([^)\s]+)\)", page.read_text(encoding="utf-8"))
    }
    pictures = {*(DOCS / "pictures").iterdir()}
    assert pictures <= shown
    assert sum(picture.stat().st_size for picture in pictures) < 2_000_000
