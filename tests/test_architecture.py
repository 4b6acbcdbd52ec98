"""The import rules (docs/design.md), checked in the source."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from .parsed import parsed

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src"
MODULES = sorted(SOURCE.rglob("*.py"))

LAYERS = (
    ("diagnostics",),
    ("errors", "clock", "install_source", "optional_deps", "files", "terminal"),
    ("config",),
    ("source_analysis", "plan", "check", "scaffold", "report", "process"),
    ("emit", "workspace"),
    ("compiler", "ros"),
    ("configedit", "runs"),
    ("introspect", "record", "doctor"),
    ("launch",),
    ("monitor", "faultinject"),
    ("web",),
    ("cli",),
)
"""The packages and top modules of `obk_cli`; each imports only those listed before it."""
ORDER = [package for layer in LAYERS for package in layer]

TEXT_FORMATS = "cpp css h html jinja js json lock md msg py toml txt xml yaml"

LIBRARIES = {
    "rclpy": ("ros", "launch", "record", "doctor"),
    "mujoco": ("workspace", "doctor"),
    "mcap": ("record",),
    "matplotlib": ("record",),
    "pyarrow": ("record",),
    "textual": ("monitor",),
    "starlette": ("web",),
    "uvicorn": ("web",),
    "anyio": ("web",),
}
"""The packages of `obk_cli` that may import a library; in the doctor, only its child programs."""


def dotted(path: Path) -> str:
    """`src/obk_cli/check/topics.py` -> `obk_cli.check.topics`."""
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def package(module: str) -> str:
    """The part of `obk_cli` to which a module belongs: `obk_cli.check.topics` -> `check`."""
    return module.split(".")[1]


def modules_of(distribution: str) -> list[Path]:
    return [path for path in MODULES if path.relative_to(SOURCE).parts[0] == distribution]


@cache
def imports(path: Path) -> tuple[str, ...]:
    """All modules that a module imports anywhere; `from a import b` counts as `a.b`."""
    return tuple(_imports(path))


def _imports(path: Path) -> Iterator[str]:
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            yield from (f"{node.module}.{name.name}" for name in node.names)


def libraries(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imports(path)}


def test_every_package_of_the_tool_is_in_the_order() -> None:
    there = {package(dotted(path)) for path in modules_of("obk_cli") if "." in dotted(path)}
    assert there == set(ORDER)


def test_a_package_imports_only_packages_before_it() -> None:
    places = {name: place for place, name in enumerate(ORDER)}
    last = len(ORDER)
    found = set()
    for path in modules_of("obk_cli"):
        importer = dotted(path)
        if "." not in importer:
            continue
        for name in imports(path):
            if not name.startswith("obk_cli.") or package(name) == package(importer):
                continue
            if places.get(package(name), last) >= places.get(package(importer), -1):
                found.add(f"{package(importer)} -> {package(name)}")
    assert not found


@pytest.mark.parametrize(("library", "allowed"), LIBRARIES.items(), ids=LIBRARIES)
def test_a_library_is_imported_only_by_its_packages(library: str, allowed: tuple[str, ...]) -> None:
    for path in modules_of("obk_cli"):
        if library not in libraries(path):
            continue
        importer = dotted(path)
        assert package(importer) in allowed, path
        assert package(importer) != "doctor" or path.stem == "child_programs", path


def test_the_shared_facts_need_only_the_standard_library_and_yaml() -> None:
    for path in modules_of("obelisk_spec"):
        # onnxruntime is imported only to load a network.
        allowed = {"obelisk_spec", "onnxruntime", "yaml"}
        foreign = libraries(path) - sys.stdlib_module_names - allowed
        assert not foreign, path


def test_the_reader_of_recordings_needs_neither_ros_nor_the_tool() -> None:
    own = {"obelisk_recordings", "obelisk_spec"}
    allowed = sys.stdlib_module_names | own | {"mcap", "numpy", "platformdirs"}
    for path in modules_of("obelisk_recordings"):
        assert not libraries(path) - allowed, path


def test_no_two_public_classes_have_the_same_name() -> None:
    names = [
        node.name
        for path in MODULES
        for node in parsed(path).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]
    assert not {name for name in names if names.count(name) > 1}


def test_tool_and_run_time_never_import_each_other() -> None:
    for path in modules_of("obelisk_py"):
        assert not libraries(path) & {"obk_cli", "obk_interfaces"}, path
    for path in modules_of("obk_cli"):
        assert "obelisk_py" not in libraries(path), path
    for path in (*modules_of("obelisk_py"), *modules_of("obk_cli"), *modules_of("obelisk_spec")):
        assert "obk_testing" not in libraries(path), path
    for path in modules_of("obk_interfaces"):
        assert not libraries(path) & {"obk_cli", "obelisk_py"}, path


def test_no_file_names_a_registry_or_a_path_of_one_machine() -> None:
    # Composed here, so that this file does not contain them either.
    words = (
        "py" + r"pi\.org",
        "files.python" + "hosted",
        "/" + "work/",
        "/" + "root/",
        "/tmp/" + "w/",
    )
    forbidden = re.compile("|".join(words))
    suffixes = {f".{name}" for name in TEXT_FORMATS.split()} | {""}
    for path in files_of_the_project():
        if path.suffix in suffixes and path.is_file():
            found = forbidden.search(path.read_text(encoding="utf-8", errors="replace"))
            assert found is None, f"{path} names {found}"


def files_of_the_project() -> list[Path]:
    """The files in git; without git, all files that are neither built nor hidden."""
    if (ROOT / ".git").exists():
        kept = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False
        )
        if kept.returncode == 0:
            return [ROOT / name for name in kept.stdout.split("\0") if name]
    parts = ((path, path.relative_to(ROOT).parts) for path in ROOT.rglob("*"))
    made = {"build", "dist", "__pycache__"}
    return [
        path
        for path, names in parts
        if not made.intersection(names) and not any(name.startswith(".") for name in names)
    ]
