"""Set the version of a release: `python tools/release.py 0.2.0`, called by `make release`.

It writes the version to `pyproject.toml` and all files that repeat it, and moves the changelog
entries under `Unreleased` to a heading with version and date. It never commits, tags or uploads.
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
"""Files that contain the version, and the patterns that match it."""
UNRELEASED = "## [Unreleased]\n"
FIRST = re.compile(rf"\nThe first version, to become {NUMBER}\.\n")


def with_version(text: str, pattern: str, version: str) -> str:
    """Replace the version in a file's text."""

    def put(found: re.Match[str]) -> str:
        return found[0].replace(found[1], version)

    return re.sub(pattern.format(NUMBER), put, text)


def unreleased(changelog: str) -> str:
    """The unreleased entries of the changelog."""
    return FIRST.sub("", changelog.partition(UNRELEASED)[2].partition("\n## ")[0]).strip()


def now_released(changelog: str, version: str, date: str) -> str:
    """Move the unreleased entries of the changelog to a heading of the version."""
    return FIRST.sub("", changelog).replace(
        UNRELEASED, f"{UNRELEASED}\n## [{version}] - {date}\n", 1
    )


def main() -> None:
    """Write the version; exit with 1 if it is invalid, not newer, or has no changelog entries."""
    version = sys.argv[1] if len(sys.argv) == 2 else ""
    changelog = ROOT / "CHANGELOG.md"
    changes = changelog.read_text(encoding="utf-8")
    released = re.findall(rf"(?m)^## \[({NUMBER})\]", changes)
    if not re.fullmatch(NUMBER, version):
        sys.exit(f"release: `{version}` is not a version such as 0.2.0")
    if released and _order(version) <= max(map(_order, released)):
        sys.exit(f"release: {version} is not newer than {released[0]}, the last release")
    if not unreleased(changes):
        sys.exit("release: CHANGELOG.md has no entries under `Unreleased`")
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
