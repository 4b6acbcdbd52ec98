"""The import rules of docs/design.md and the sizes of the house, asked of the source itself."""

import ast
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src"
MODULES = sorted(SOURCE.rglob("*.py"))

SPINE = (
    {"source", "edits", "codes"},
    {"diagnostics", "errors"},
    {"tree"},
    {"config", "node_code", "surroundings"},
    {"plan"},
)
"""Each imports only what stands left of it or beside it."""
SPINE_MODULES = frozenset().union(*SPINE)
STAGES = {"parse", "read", "code", "resolve", "check", "lower", "emit"}
SHARED_BY_STAGES = {"wiring", "yaml_faults", "silence", "cures"}
"""Modules on top of the spine that stages share, themselves importing only the spine."""
SURFACES = {"cli", "report", "adapters"}
"""Where the process itself is touched: its output, environment, exit and clock."""

LONGEST_MODULE = 400
LONGEST_FUNCTION = 60


def dotted(path: Path) -> str:
    """`src/obk_cli/read/sim.py` -> `obk_cli.read.sim`."""
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def area(module: str) -> str:
    """The part of `obk_cli` that a module belongs to: `obk_cli.read.sim` -> `read`."""
    return module.split(".")[1] if module.count(".") else ""


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path: Path) -> tuple[str, ...]:
    """Every module that a module imports, wherever in it; `from a import b` counts as `a.b`."""
    return tuple(_imports(path))


def _imports(path: Path) -> Iterator[str]:
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            yield from (f"{node.module}.{name.name}" for name in node.names)


def of(package: str) -> list[Path]:
    return [path for path in MODULES if dotted(path).split(".")[0] == package]


def in_area(*areas: str) -> list[Path]:
    return [path for path in of("obk_cli") if area(dotted(path)) in areas]


def tops(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imports(path)}


def areas_imported(path: Path) -> set[str]:
    names = [name for name in imports(path) if name.startswith("obk_cli.")]
    return {area(name) for name in names} - {area(dotted(path))}


def test_the_shared_facts_need_only_the_standard_library_and_yaml() -> None:
    for path in of("obelisk_spec"):
        foreign = tops(path) - sys.stdlib_module_names - {"obelisk_spec", "yaml"}
        assert not foreign, path


def test_tool_and_run_time_never_import_each_other() -> None:
    for path in of("obelisk_py"):
        assert not tops(path) & {"obk_cli", "obk_interfaces"}, path
    for path in of("obk_cli"):
        assert "obelisk_py" not in tops(path), path
    for path in of("obk_interfaces"):
        assert not tops(path) & {"obk_cli", "obelisk_py"}, path


def test_ros_and_mujoco_come_in_through_the_adapters() -> None:
    for path in of("obk_cli"):
        if area(dotted(path)) != "adapters":
            assert not tops(path) & {"rclpy", "mujoco", "numpy"}, path


def test_the_spine_imports_leftward_only() -> None:
    for place, names in enumerate(SPINE):
        allowed = frozenset().union(*SPINE[: place + 1])
        for path in in_area(*names):
            assert areas_imported(path) <= allowed, path


def test_stages_import_the_spine_and_never_each_other() -> None:
    allowed = SPINE_MODULES | SHARED_BY_STAGES
    for path in in_area(*STAGES):
        assert areas_imported(path) <= allowed, path
    for path in in_area(*SHARED_BY_STAGES):
        assert areas_imported(path) <= SPINE_MODULES, path
    for path in in_area("migrate"):
        assert areas_imported(path) <= SPINE_MODULES | {"cures", "parse", "read"}, path
    beside_the_pipeline = {"adapters", "cures", "migrate", "parse", "pipeline", "wiring"}
    for path in in_area("joining"):
        assert areas_imported(path) <= SPINE_MODULES | beside_the_pipeline, path
    for path in in_area("report"):
        voiced = {"launch", "rehearsal", "doctor", "recording", "looking", "monitoring"}
        assert areas_imported(path) <= SPINE_MODULES | voiced, path


def test_who_asks_running_stacks_knows_the_launchers_words_and_the_adapters() -> None:
    for path in in_area("asking"):
        assert areas_imported(path) <= SPINE_MODULES | {"launch", "adapters"}, path


def test_a_rehearsal_knows_the_launchers_words_and_the_adapters() -> None:
    for path in in_area("rehearsal"):
        assert areas_imported(path) <= SPINE_MODULES | {"launch", "adapters"}, path
    for path in in_area("rehearsal"):
        if path.stem in ("promise", "cases", "scene", "judge"):
            assert "adapters" not in areas_imported(path), path


def test_what_is_recorded_is_decided_without_ros_and_without_the_file_format() -> None:
    for path in in_area("recording"):
        assert areas_imported(path) <= SPINE_MODULES | {"launch"}, path
    for path in of("obk_cli"):
        if area(dotted(path)) != "adapters":
            assert not tops(path) & {"mcap", "mcap_ros2", "matplotlib"}, path


def test_looking_into_a_stack_is_pure_but_for_what_finds_and_asks() -> None:
    for path in in_area("looking"):
        asking = {"adapters"} if path.stem in ("place", "nodes", "sight", "errands") else set()
        allowed = SPINE_MODULES | {"launch", "recording"} | asking
        assert areas_imported(path) <= allowed, path


def test_a_page_is_decided_without_the_libraries_that_serve_it() -> None:
    shown = {"monitoring", "launch", "looking", "recording", "emit", "report"}
    for path in in_area("web"):
        others = {"adapters"} if path.stem == "plots" else set()
        asking = {"asking"} if path.stem == "data" else set()
        assert areas_imported(path) <= SPINE_MODULES | shown | others | asking, path
    for path in of("obk_cli"):
        if area(dotted(path)) != "adapters":
            assert not tops(path) & {"starlette", "uvicorn", "anyio"}, path


def test_the_build_of_messages_knows_the_adapters_only() -> None:
    for path in in_area("building"):
        assert areas_imported(path) <= SPINE_MODULES | {"adapters"}, path


def test_the_doctor_judges_facts_that_others_look_up() -> None:
    looking = {"checks", "examination", "workspace_look"}
    for path in in_area("doctor"):
        others = {"adapters", "building"} if path.stem in looking else set()
        assert areas_imported(path) <= SPINE_MODULES | others, path


def test_nothing_imports_the_command_line() -> None:
    for path in of("obk_cli"):
        if area(dotted(path)) != "cli":
            assert "cli" not in areas_imported(path), path


def test_output_environment_exit_and_clock_stay_at_the_surface() -> None:
    for path in of("obk_cli"):
        if area(dotted(path)) in SURFACES:
            continue
        used = set(touched_of_the_process(path))
        assert not used, f"{path} uses {used}"


def touched_of_the_process(path: Path) -> Iterator[str]:
    """Calls of print and exit, and uses of the environment and the clock."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id in ("print", "exit", "quit", "input"):
                yield node.func.id
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            name = f"{node.value.id}.{node.attr}"
            clocks = ("time.time", "time.monotonic", "time.sleep", "datetime.now")
            if name in ("os.environ", "os.getenv", "sys.exit", "os._exit", *clocks):
                yield name


@pytest.mark.parametrize("path", MODULES, ids=dotted)
def test_a_module_is_short_and_says_what_it_is(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= LONGEST_MODULE
    tree = parsed(path)
    assert ast.get_docstring(tree) or not tree.body
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            # Without the signature: a command's lists its options.
            length = (node.end_lineno or 0) - node.body[0].lineno + 1
            assert length <= LONGEST_FUNCTION, node.name


def test_public_modules_say_what_they_offer() -> None:
    for path in MODULES:
        if "zoo" in path.parts:  # the examples are listings that stand word for word
            continue
        tree = parsed(path)
        defines = any(isinstance(n, ast.FunctionDef | ast.ClassDef) for n in tree.body)
        names = {
            target.id
            for node in tree.body
            if isinstance(node, ast.Assign)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        assert "__all__" in names or not defines or path.name.startswith("_"), path


def test_no_file_names_a_registry_or_a_path_of_one_machine() -> None:
    # Put together here, so that this file does not name them either.
    words = (
        "py" + r"pi\.org",
        "files.python" + "hosted",
        "/" + "work/",
        "/" + "root/",
        "/tmp/" + "w/",
    )
    forbidden = re.compile("|".join(words))
    suffixes = {".py", ".toml", ".md", ".yaml", ".json", ".txt", ".lock", ".xml", ".msg", ".j2", ""}
    made = {"build", "dist", "__pycache__"}
    for path in ROOT.rglob("*"):
        parts = path.relative_to(ROOT).parts
        if made.intersection(parts) or any(part.startswith(".") for part in parts[:-1]):
            continue
        if path.suffix in suffixes and path.is_file():
            found = forbidden.search(path.read_text(encoding="utf-8", errors="replace"))
            assert found is None, f"{path} names {found}"
