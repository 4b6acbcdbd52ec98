"""Makes a version of what is there: `python tools/release.py 0.2.0`, as `make release` calls it.

In: the version; the place of the one that is there is `pyproject.toml`. Out: the files that repeat
it, and the changelog, where what stood under `Unreleased` gets a heading with version and date.
Never commits, tags or uploads.
"""

import re
import sys
from datetime import UTC, datetime

from generated import ROOT

__all__ = ["main"]

NUMBER = r"\d+\.\d+\.\d+"
PLACES = (
    ("pyproject.toml", r'(?m)^version = "({})"$'),
    ("pyproject.toml", r'"obelisk-interfaces==({})"'),
    ("interfaces/pyproject.toml", r'(?m)^version = "({})"$'),
    ("interfaces/*/package.xml", r"<version>({})</version>"),
    ("ros_packages/*/package.xml", r"<version>({})</version>"),
)
"""Files, and where in them the version stands."""
UNRELEASED = "## [Unreleased]\n"
FIRST = re.compile(rf"\nThe first version, to become {NUMBER}\.\n")


def with_version(text: str, pattern: str, version: str) -> str:
    """A file's text with another version."""

    def put(found: re.Match[str]) -> str:
        return found[0].replace(found[1], version)

    return re.sub(pattern.format(NUMBER), put, text)


def unreleased(changelog: str) -> str:
    """The changelog of the next version."""
    return FIRST.sub("", changelog.partition(UNRELEASED)[2].partition("\n## ")[0]).strip()


def now_released(changelog: str, version: str, date: str) -> str:
    """The changelog with what was unreleased under a heading of its own."""
    begun = FIRST.sub("", changelog)
    return begun.replace(UNRELEASED, f"{UNRELEASED}\n## [{version}] - {date}\n", 1)


def main() -> None:
    """Write the version; exits with 1 if it is invalid, not above the last, or not described."""
    version = sys.argv[1] if len(sys.argv) == 2 else ""
    changelog = ROOT / "CHANGELOG.md"
    changes = changelog.read_text(encoding="utf-8")
    released = re.findall(rf"(?m)^## \[({NUMBER})\]", changes)
    if not re.fullmatch(NUMBER, version):
        sys.exit(f"release: `{version}` is no version such as 0.2.0")
    if released and _order(version) <= max(map(_order, released)):
        sys.exit(f"release: {version} is not above {released[0]}, the last one")
    if not unreleased(changes):
        sys.exit("release: there is nothing under `Unreleased` in CHANGELOG.md")
    for glob, pattern in PLACES:
        for path in ROOT.glob(glob):
            text = path.read_text(encoding="utf-8")
            path.write_text(with_version(text, pattern, version), encoding="utf-8")
    today = datetime.now(UTC).date().isoformat()
    changelog.write_text(now_released(changes, version, today), encoding="utf-8")


def _order(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")))


if __name__ == "__main__":
    main()
