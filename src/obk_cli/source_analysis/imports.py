"""Find imports that fail: of a missing module, or of a name that its module does not define.

Only imports that always run when the node starts are checked. Those in `try`, `if`, `with` and in
functions other than the entry point are optional or conditional.
"""

import ast
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from obelisk_spec.names import OBELISK_MESSAGES, ROS_MESSAGES
from obelisk_spec.suggestions import ask_for, near_names, sure_name
from obk_cli.diagnostics.diagnostic import Diagnostic, found
from obk_cli.diagnostics.source import Span
from obk_cli.source_analysis.modules import (
    Module,
    ModuleLibrary,
    UnreadableSourceError,
    import_origin,
    span_of,
)

__all__ = ["EntryFunction", "ImportPlaces", "check_imports", "imported_modules"]

EntryFunction = tuple[Module, list[ast.stmt]]
"""The function that an entry point calls: its module and its statements."""

_MOST_MODULES = 500
"""Maximum number of modules of one node that are read for their imports."""
# Messages need numpy, so every ROS installation has it.
_OTHERS_OF_ROS = (
    *("cv_bridge", "image_geometry", "laser_geometry", "launch", "message_filters", "numpy"),
    *("rclpy", "rosbag2_py", "rpyutils", "sensor_msgs_py", "tf_transformations", "xacro"),
)
_ROS_PACKAGES = frozenset((*OBELISK_MESSAGES, *ROS_MESSAGES, *_OTHERS_OF_ROS))
_ROS_STARTS = ("ament_", "launch_", "ros2", "rosidl_", "tf2_")
_ROS_ENDINGS = ("_msgs", "_srvs", "_interfaces")
_MESSAGE_MODULES = ("action", "msg", "srv")
_ROS = "ROS 2"
_CHANGE_THE_PATH = ("sys.path", "sys.modules", "sys.meta_path", "addsitedir", "import_module")


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportPlaces:
    """Where modules are searched for."""

    may_exist: Callable[[str], bool]
    """Whether an import of a dotted name may succeed; False only if it must fail."""
    siblings: Callable[[str], Sequence[str]]
    """The dotted names of the modules next to a module."""
    is_read: Callable[[str], bool]
    """Whether the readable source of a module is what the node will import."""
    is_own: Callable[[str], bool]
    """Whether a module belongs to the workspace, so that its imports are checked."""
    message_names: Callable[[str], Sequence[str] | None]
    """The messages of a module such as `sensor_msgs.msg`; None if unknown."""
    missing_ros: Callable[[], str | None] = lambda: None
    """How to install ROS 2 if it is not installed at all; otherwise None."""


@dataclass(frozen=True, slots=True)
class _Import:
    module: str
    name: str | None
    """The imported name; None for `import module` and for `*`."""
    span: Span
    """Location of the name."""
    written: str
    """The module as written in the statement."""


def imported_modules(
    entry: Module, function: EntryFunction, library: ModuleLibrary, places: ImportPlaces
) -> tuple[Module, ...]:
    """The workspace's modules that run when the node starts, that of the entry point first."""
    reached = {entry.name: entry}
    pending = [entry]
    while pending and len(reached) < _MOST_MODULES:
        module = pending.pop(0)
        for one in _imports(_body(module, function), module):
            names = [one.module] + ([f"{one.module}.{one.name}"] if one.name else [])
            for name in names:
                for package in _with_packages(name):
                    found_module = _readable(package, library) if places.is_own(package) else None
                    if found_module is not None and package not in reached:
                        reached[package] = found_module
                        pending.append(found_module)
    return tuple(reached.values())


def _body(module: Module, function: EntryFunction) -> list[ast.stmt]:
    return [*module.tree.body, *(function[1] if module is function[0] else ())]


def _with_packages(name: str) -> Iterator[str]:
    """`a`, `a.b`, `a.b.c`: everything that an import runs."""
    parts = name.split(".")
    yield from (".".join(parts[: end + 1]) for end in range(len(parts)))


def _readable(name: str, library: ModuleLibrary) -> Module | None:
    try:
        return library.module(name)
    except UnreadableSourceError:
        return None  # reported separately if it is needed


def _imports(body: Iterable[ast.stmt], module: Module) -> Iterator[_Import]:
    for statement in body:
        match statement:
            case ast.Import(names=aliases):
                for alias in aliases:
                    yield _Import(alias.name, None, span_of(alias, module.source), alias.name)
            case ast.ImportFrom(names=aliases):
                origin = import_origin(statement, module.name, module.is_package)
                for alias in aliases if origin else ():
                    name = None if alias.name == "*" else alias.name
                    place = span_of(alias, module.source)
                    yield _Import(origin, name, place, statement.module or "")


def check_imports(
    modules: Sequence[Module],
    function: EntryFunction,
    library: ModuleLibrary,
    places: ImportPlaces,
) -> Iterator[Diagnostic]:
    """OBK421: every failing import, each missing thing once.

    Without ROS 2, one info stands for all imports of its packages.

    Args:
        modules: the result of `imported_modules`.
        function: the entry point's function.
        library: returns the modules that can be read.
        places: where modules are searched for.
    """
    if any(word in module.source.text for module in modules for word in _CHANGE_THE_PATH):
        return
    seen: set[str] = set()
    for module in modules:
        for one in _imports(_body(module, function), module):
            dotted = f"{one.module}.{one.name}"
            missing = next((p for p in _with_packages(one.module) if not places.may_exist(p)), None)
            if missing is not None and missing not in seen:
                seen.add(missing)
                install = places.missing_ros() if _is_of_ros(missing, one.module) else None
                if install is None:
                    yield _no_module(missing, one, places)
                elif _ROS not in seen:
                    seen.add(_ROS)
                    yield _no_ros(one, install)
            elif missing is None and one.name and dotted not in seen:
                names = _names_without(one.module, one.name, library, places)
                if names is not None:
                    seen.add(dotted)
                    yield _no_name(one.module, one.name, names, one.span)


def _is_of_ros(missing: str, imported: str) -> bool:
    """Whether a missing top-level package is one of ROS 2, or a message package."""
    _, _, submodule = imported.partition(".")
    is_message = missing.endswith(_ROS_ENDINGS) or submodule in _MESSAGE_MODULES
    is_library = missing in _ROS_PACKAGES or missing.startswith(_ROS_STARTS)
    return "." not in missing and (is_library or is_message)


def _no_ros(one: _Import, install: str) -> Diagnostic:
    """The message is the same for all modules, so that a config has one such finding."""
    return found(
        "OBK421",
        "ROS 2 is not installed in `obk`'s Python environment, so imports of its packages and of "
        "message packages are not checked",
        _module_span(one),
        severity="info",
        help=install,
    )


def _names_without(
    name: str, imported: str, library: ModuleLibrary, places: ImportPlaces
) -> frozenset[str] | None:
    """The names that a module defines, if they are known and do not include `imported`."""
    messages = places.message_names(name)
    if messages is not None:
        return None if imported in messages or imported.startswith("_") else frozenset(messages)
    module = _readable(name, library) if places.is_read(name) else None
    names = None if module is None else module.bound_names
    if module is None or names is None or imported in names or imported.startswith("__"):
        return None
    is_module = module.is_package and places.may_exist(f"{name}.{imported}")
    return None if is_module else names


def _no_name(module: str, name: str, names: Iterable[str], span: Span) -> Diagnostic:
    return found(
        "OBK421",
        f"module `{module}` does not define `{name}`",
        span,
        help=_near(name, names) or f"define `{name}` there, or correct the name",
    )


def _no_module(missing: str, one: _Import, places: ImportPlaces) -> Diagnostic:
    package, _, _ = missing.rpartition(".")
    span = _module_span(one)
    near = _near(missing, places.siblings(missing))
    if package:
        message = f"package `{package}` has no module `{missing}`"
        return found("OBK421", message, span, help=near or "correct the name, or add the module")
    return found(
        "OBK421",
        f"package `{missing}` is not installed in `obk`'s Python environment",
        span,
        help=near
        or "install it there; if the node can run without it, wrap the import in "
        "`try: ... except ImportError: ...`",
    )


def _module_span(one: _Import) -> Span:
    """Location of the module; that of the imported name if they are on different lines."""
    start = one.span.source.line(one.span.line).find(one.written)
    if start < 0 or one.name is None:
        return one.span
    return Span.at(one.span.source, one.span.line, start + 1, len(one.written))


def _near(name: str, known: Iterable[str]) -> str | None:
    every = tuple(known)
    meant = sure_name(name, every)
    return ask_for((meant,) if meant else near_names(name, every))
