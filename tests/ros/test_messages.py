"""The compiled messages under rclpy, across processes, and their definitions in the ament index."""

import importlib.metadata
import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

PEER = Path(__file__).with_name("message_peer.py")
INTERFACES = Path(__file__).resolve().parents[2] / "interfaces"
NAMES = sorted(f"{f.parents[1].name}/{f.stem}" for f in INTERFACES.glob("obelisk_*/msg/*.msg"))


@pytest.fixture(scope="module")
def peer() -> ModuleType:
    spec = importlib.util.spec_from_file_location("message_peer", PEER)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.ros
def test_every_message_arrives_in_another_process_with_every_field_equal(peer: ModuleType) -> None:
    sender = [sys.executable, str(PEER), "send", *NAMES]
    receiver = [sys.executable, str(PEER), "receive", *NAMES]
    with subprocess.Popen(sender, stdin=subprocess.PIPE) as process:
        output = subprocess.run(
            receiver, stdout=subprocess.PIPE, text=True, check=True, timeout=120
        ).stdout
        process.stdin.close()
        assert process.wait(timeout=60) == 0
    assert json.loads(output) == {name: peer.plain(peer.filled(name)) for name in NAMES}


@pytest.mark.ros
@pytest.mark.parametrize("name", NAMES)
def test_the_fields_of_the_exchanged_message_are_all_distinct(peer: ModuleType, name: str) -> None:
    def leaves(value: object) -> list[object]:
        if isinstance(value, dict | list):
            items = value.values() if isinstance(value, dict) else value
            return [leaf for item in items for leaf in leaves(item)]
        return [value]

    values = leaves(peer.plain(peer.filled(name)))
    assert len(set(values)) == len(values) > 0


@pytest.mark.ros
@pytest.mark.parametrize("name", NAMES)
def test_the_definition_is_found_through_the_ament_index(name: str) -> None:
    from ament_index_python.packages import get_package_share_directory

    package, _, message = name.partition("/")
    installed = Path(get_package_share_directory(package), "msg", f"{message}.msg")
    source = INTERFACES / package / "msg" / f"{message}.msg"
    assert installed.read_text() == source.read_text()


@pytest.mark.ros
@pytest.mark.parametrize("name", NAMES)
def test_the_message_reports_its_name(peer: ModuleType, name: str) -> None:
    reported = peer.message_type(name).MESSAGE_NAME
    assert reported == name.partition("/")[2]


@pytest.mark.ros
def test_no_installed_file_contains_the_build_path(repository: Path) -> None:
    installed = importlib.metadata.files("obelisk-interfaces") or []
    carried = [f for f in installed if f.suffix != ".pyc" and "dist-info" not in str(f)]
    build = str(repository / "interfaces").encode()
    assert len(carried) > 100
    assert [str(f) for f in carried if build in f.locate().read_bytes()] == []
