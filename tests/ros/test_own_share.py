"""Nodes that run from source find the files of their packages."""

from pathlib import Path

import pytest

from .stack import obk
from .workspace import MANIFEST, write_files

pytestmark = pytest.mark.ros

PACKAGE = {
    "demo/package.xml": MANIFEST.format("demo", ""),
    "demo/setup.py": """\
from glob import glob
from setuptools import setup

setup(
    name="demo",
    data_files=[("share/demo/policies", glob("resource/*.txt"))],
    entry_points={"console_scripts": ["a = demo.node:main", "b = demo.node:main"]},
)
""",
    "demo/resource/policy.txt": "walk",
    "demo/config/gains.txt": "kp",
    "demo/demo/__init__.py": "",
    "demo/demo/node.py": """\
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from obelisk_py.core.sensing import ObeliskSensor
from obelisk_py.core.utils.ros import spin_obelisk
from std_msgs.msg import String


class Reader(ObeliskSensor):
    def __init__(self, node_name="reader"):
        super().__init__(node_name)
        self.register_obk_publisher("pub_setting", key="pub", msg_type=String)

    def on_configure(self, state):
        share = Path(get_package_share_directory("demo"))
        texts = [(share / p).read_text() for p in ("policies/policy.txt", "config/gains.txt")]
        self.get_logger().info(f"files: {' '.join(texts)}")
        return super().on_configure(state)


def main():
    spin_obelisk(None, Reader)
""",
}
CONFIG = """\
config: files
obk: {ignore: [OBK2]}
sensing:
  - {pkg: demo, executable: a, publishers: [{key: pub, topic: /a, msg_type: std_msgs/String}]}
  - {pkg: demo, executable: b, publishers: [{key: pub, topic: /b, msg_type: std_msgs/String}]}
"""


@pytest.mark.parametrize("options", [(), ("--composed",)], ids=["alone", "composed"])
def test_a_node_reads_files_of_its_package(tmp_path: Path, options: tuple[str, ...]) -> None:
    write_files(tmp_path / "src", PACKAGE)
    config = tmp_path / "files.yaml"
    config.write_text(CONFIG)
    run = obk("launch", config, "--until", "active", "--duration", "1", *options)
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("files: walk kp") == 2
    (folder,) = (line for line in run.stdout.splitlines() if "logs in " in line)
    left = Path(folder.partition("logs in ")[2])
    assert left.is_dir()
    assert not (left / "prefix").exists()


@pytest.mark.slow
def test_two_packages_of_a_name_that_the_stack_does_not_use_do_not_matter(tmp_path: Path) -> None:
    write_files(tmp_path / "src", PACKAGE)
    for place, field in (("one", "float64 a"), ("two", "float64 b")):
        folder = tmp_path / "src" / place
        files = {"package.xml": MANIFEST.format("odd_msgs", ""), "msg/Odd.msg": f"{field}\n"}
        write_files(folder, files)
    config = tmp_path / "files.yaml"
    config.write_text(CONFIG)
    run = obk("launch", config, "--duration", "1")
    assert run.returncode == 0, run.stdout + run.stderr
    config.write_text(CONFIG.replace("std_msgs/String", "odd_msgs/Odd"))
    run = obk("launch", config, "--duration", "1")
    assert run.returncode == 1
    assert "odd_msgs" in run.stderr
    assert "Traceback" not in run.stderr
