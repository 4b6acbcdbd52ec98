"""Generated packages are ament_python packages: colcon and pip build them, and stacks run them.

colcon is downloaded once, into `build/`.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from xml.etree import ElementTree

import pytest

from .stack import launched, obk

pytestmark = [pytest.mark.ros, pytest.mark.slow]

ROOT = Path(__file__).resolve().parents[2]
REQUIREMENTS = Path(__file__).with_name("colcon_requirements.txt")
RUN_COLCON = "import sys; from colcon_core.command import main; sys.exit(main())"
PACKAGES = ("my_robot_controller", "my_robot_estimator", "my_ctrl")


@pytest.fixture(scope="session")
def colcon() -> Path:
    """A folder from which colcon can be imported."""
    folder = ROOT / "build" / "colcon"
    wanted = REQUIREMENTS.read_text()
    written = folder / "requirements.txt"
    if not written.is_file() or written.read_text() != wanted:
        shutil.rmtree(folder, ignore_errors=True)
        pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "-qq", "install")
        source = ("--no-deps", "-r", REQUIREMENTS, "--target", folder)
        subprocess.run([*pip, *source], check=True)
        written.write_text(wanted)
    return folder


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    return make_workspace(tmp_path)


@pytest.fixture(scope="module")
def built(colcon: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace built by colcon; tests must not change its sources."""
    workspace = make_workspace(tmp_path_factory.mktemp("built"))
    run_colcon(colcon, workspace, "build")
    return workspace


def make_workspace(folder: Path) -> Path:
    """A workspace of `obk init`, and a controller of `obk new`."""
    workspace = folder / "my_robot"
    assert obk("init", workspace).returncode == 0
    made = obk("new", "controller", "my_ctrl", "--dest", workspace / "src")
    assert made.returncode == 0, made.stderr
    return workspace


def run_colcon(colcon: Path, workspace: Path, *arguments: str) -> None:
    """Run colcon with the Python of the nodes."""
    result = subprocess.run(
        [sys.executable, "-c", RUN_COLCON, "--log-base", "log", *arguments],
        cwd=workspace,
        env={**os.environ, "PYTHONPATH": str(colcon)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, (result.stdout, result.stderr)


def sourced(workspace: Path) -> dict[str, str]:
    """The variables of a shell that has sourced the built workspace."""
    script = f'. "{workspace}/install/setup.sh" && env -0'
    shown = subprocess.run(["sh", "-c", script], capture_output=True, text=True, check=True).stdout
    return dict(pair.split("=", 1) for pair in shown.split("\0") if pair)


def is_installed(package: str, prefix: Path) -> bool:
    files = ("package.xml", f"../ament_index/resource_index/packages/{package}")
    is_there = all((prefix / "share" / package / file).is_file() for file in files)
    return is_there and os.access(prefix / "lib" / package / package, os.X_OK)


def test_colcon_builds_generated_packages_and_installs_their_nodes(built: Path) -> None:
    assert all(is_installed(package, built / "install" / package) for package in PACKAGES)


@pytest.mark.parametrize("option", ["--symlink-install", "--merge-install"])
def test_colcon_installs_their_nodes_in_its_other_ways_too(
    colcon: Path, workspace: Path, option: str
) -> None:
    run_colcon(colcon, workspace, "build", option)
    for package in PACKAGES:
        prefix = workspace / "install" / ("" if option == "--merge-install" else package)
        assert is_installed(package, prefix)


def test_colcon_runs_the_tests_of_generated_packages(colcon: Path, built: Path) -> None:
    run_colcon(colcon, built, "test", "--return-code-on-test-failure")
    for package in PACKAGES:
        results = ElementTree.parse(built / "build" / package / "pytest.xml").getroot()
        suites = results.iter("testsuite")
        assert sum(int(suite.attrib["tests"]) for suite in suites) >= 2


def test_pip_installs_a_generated_package_in_editable_mode(
    colcon: Path, workspace: Path, tmp_path: Path
) -> None:
    prefix = tmp_path / "prefix"
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "-qq", "install")
    here = ("--no-deps", "--no-build-isolation", "--use-pep517", "--prefix", prefix)
    with_setuptools = {**os.environ, "PYTHONPATH": str(colcon)}
    package = workspace / "src" / "my_ctrl"
    subprocess.run([*pip, *here, "--editable", package], env=with_setuptools, check=True)
    assert os.access(prefix / "bin" / "my_ctrl", os.X_OK)
    (package / "my_ctrl" / "__init__.py").write_text('"""Edited."""\n')
    site = sysconfig.get_path("purelib", vars={"base": str(prefix)})
    code = f"import site; site.addsitedir({site!r}); import my_ctrl; print(my_ctrl.__doc__)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout == "Edited.\n"


def test_a_stack_runs_packages_installed_by_colcon_without_sources(
    built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    shutil.copy(built / "my_robot.yaml", elsewhere)
    shutil.copytree(built / "model", elsewhere / "model")
    config = elsewhere / "my_robot.yaml"
    assert obk("validate", config).returncode == 1  # these packages do not exist
    for name, value in sourced(built).items():
        monkeypatch.setenv(name, value)
    assert obk("validate", "--strict", config).returncode == 0
    with launched(config) as run:
        assert {"control_0", "estimation_0"} <= {word.strip(": ") for word in run.text.split()}
    assert run.process.returncode == 0, run.text
