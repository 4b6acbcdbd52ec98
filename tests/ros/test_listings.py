"""The Python listings of the reference documents run unchanged."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from obelisk_py.zoo.control.example import example_position_setpoint_controller
from obelisk_py.zoo.estimation import jointencoders_passthrough_estimator

from .stack import eventually

pytestmark = pytest.mark.ros

SEEDS = Path(__file__).resolve().parents[2].parent / "shared" / "seeds"
MAINS = Path(__file__).with_name("listings")


def words(text: str) -> str:
    """Text without indentation, empty lines and comments for linters."""
    lines = (re.sub(r"\s+", " ", line).strip() for line in text.splitlines())
    return "\n".join(line for line in lines if line)


@pytest.fixture(scope="module")
def seed() -> str:
    return words("\n".join(path.read_text() for path in sorted(SEEDS.glob("*.txt"))))


@pytest.mark.parametrize(
    "path",
    [
        example_position_setpoint_controller.__file__,
        jointencoders_passthrough_estimator.__file__,
        *sorted(MAINS.glob("*.py")),
    ],
    ids=lambda path: Path(path).stem,
)
def test_a_listing_is_the_documents_literally(path: str, seed: str) -> None:
    listing = Path(path).read_text()
    # The module's own first docstring is not in the listing.
    _, _, body = listing.partition('"""\n') if listing.startswith('"""') else ("", "", listing)
    assert words(body) in seed


@pytest.mark.parametrize("path", sorted(MAINS.glob("*.py")), ids=lambda path: path.stem)
def test_a_main_listing_starts_and_ends_by_a_signal(path: Path) -> None:
    query = [Path(sys.executable).with_name("obk"), "lifecycle", "get", "listing"]
    with subprocess.Popen([sys.executable, path, "--ros-args", "-r", "__node:=listing"]) as process:
        try:
            eventually(
                lambda: (
                    "unconfigured"
                    in subprocess.run(query, capture_output=True, text=True, check=False).stdout
                ),
                "the node's state",
            )
        finally:
            process.terminate()
    assert process.returncode == 0
