"""Message packages without compiled code, such as those for another Python."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.ros.types import find_type, opaque_type, raw_type, require_message, require_service

pytestmark = pytest.mark.ros

NUMBER = """
class _Metaclass(type):
    _TYPE_SUPPORT = None

    @classmethod
    def __import_type_support__(cls):
        raise RuntimeError("no library")


class Number(metaclass=_Metaclass): ...
"""


@pytest.fixture(autouse=True)
def _package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for section in ("msg", "srv"):
        (tmp_path / "alien_msgs" / section).mkdir(parents=True)
        (tmp_path / "alien_msgs" / section / "__init__.py").write_text(NUMBER)
    (tmp_path / "alien_msgs" / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    yield
    for name in [one for one in sys.modules if one.startswith("alien_msgs")]:
        del sys.modules[name]


def test_they_are_reported_with_a_message() -> None:
    reported = "the type alien_msgs/msg/Number cannot be used here: no library"
    with pytest.raises(CommandFailedError, match=reported):
        require_message(find_type("alien_msgs/msg/Number"))
    with pytest.raises(CommandFailedError, match=reported.replace("msg/", "srv/")):
        require_service(find_type("alien_msgs/srv/Number"))
    require_message(find_type("std_msgs/msg/Int32"))
    require_service(find_type("std_srvs/srv/Trigger"))


def test_their_messages_are_still_counted() -> None:
    assert raw_type("alien_msgs/msg/Number", ()) is opaque_type("alien_msgs/msg/Number", "")
    assert raw_type("std_msgs/msg/Int32", ()) is find_type("std_msgs/msg/Int32")
