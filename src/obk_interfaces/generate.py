"""Run the rosidl generators on one package, in this process.

The generators write the translated definitions and the C, C++ and Python sources to the package's
build tree; nothing is compiled. If a definition is invalid, the generators name at most the file.
The invalid line is then found by parsing each line separately. Each IDL file is parsed once instead
of six times, which saves a third of the time: the generators' modules get a cache that is removed
afterwards.
"""

import contextlib
import importlib
import io
import json
import re
import shutil
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from obk_interfaces.errors import BuildToolError, CommandError, DefinitionError, DefinitionProblem
from obk_interfaces.package import C_GENERATORS, TYPE_SUPPORTS, Interface, PackageTree
from obk_interfaces.prefix import Prefixes

__all__ = ["generate"]

_PARSE_FUNCTION = "parse_idl_file"
_PARSING_MODULES = (
    "rosidl_pycommon",
    "rosidl_generator_type_description",
    "rosidl_generator_py.generate_py_impl",
)


@contextmanager
def _parsing_each_idl_once() -> Iterator[None]:
    """Make the generators cache parsed IDL files within the block."""
    parse = getattr(importlib.import_module("rosidl_parser.parser"), _PARSE_FUNCTION)
    parsed: dict[str, Any] = {}

    def parse_once(locator: Any) -> Any:
        key = str(locator.get_absolute_path())
        if key not in parsed:
            parsed[key] = parse(locator)
        return parsed[key]

    users = [importlib.import_module(name) for name in _PARSING_MODULES]
    for module in users:
        setattr(module, _PARSE_FUNCTION, parse_once)
    try:
        yield
    finally:
        for module in users:
            setattr(module, _PARSE_FUNCTION, parse)


_BEFORE_VALUE = re.compile(r"\s*\S+\s+[^\s=]+\s*=?\s*")


def _first_rejected_line(path: Path, package: str) -> DefinitionProblem | None:
    """Return the first line that is invalid on its own; None if every line is valid."""
    parse = importlib.import_module("rosidl_adapter.parser").parse_message_string
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if line.strip() == "---":
            continue
        try:
            with contextlib.redirect_stderr(io.StringIO()):
                parse(package, "Message", line.strip())
        except Exception as error:  # the parser raises many types
            before = _BEFORE_VALUE.match(line)
            column = before.end() + 1 if before and before.end() < len(line) else 1
            return DefinitionProblem(path=path, line=number, column=column, sentence=str(error))
    return None


_PY = "rosidl_generator_py"
_HASH = "rosidl_generator_type_description"


def generate(tree: PackageTree, prefixes: Prefixes) -> None:
    """Generate every source of a package.

    Raises:
        BuildToolError: a generator is not installed.
        DefinitionError: a generator rejected a line of a definition.
        CommandError: a generator failed for another reason.
    """
    _make_folders(tree)
    with warnings.catch_warnings(action="ignore"):  # users cannot fix the generators' warnings
        for interface in tree.package.interfaces:
            _translate(tree, interface)
        with _parsing_each_idl_once():
            _describe_types(tree, prefixes)
            _generate_c(tree, prefixes)
            _generate_python(tree, prefixes)
    _write_visibility_headers(tree, prefixes)
    shutil.copyfile(tree.package.root / "package.xml", tree.share / "package.xml")


def _make_folders(tree: PackageTree) -> None:
    # The generators expect their output folders; the visibility headers always go to msg/.
    for kind in {*tree.package.kinds, "msg"}:
        for generator in C_GENERATORS:
            (tree.code_of(generator) / kind / "detail").mkdir(parents=True, exist_ok=True)
    for kind in tree.package.kinds:
        (tree.python / kind).mkdir(parents=True)
        (tree.share / kind).mkdir(parents=True)


def _translate(tree: PackageTree, interface: Interface) -> None:
    """Copy one definition and write its IDL beside it."""
    source = tree.package.root / interface.file
    shutil.copyfile(source, tree.share / interface.file)
    convert = _function("rosidl_adapter", "convert_to_idl")
    try:
        _quietly(
            f"{source}: cannot be translated",
            lambda: convert(tree.package.root, tree.package.name, Path(interface.file), tree.share),
        )
    except CommandError as error:
        problem = _first_rejected_line(source, tree.package.name)
        if problem is None:
            raise
        raise DefinitionError([problem]) from error


def _describe_types(tree: PackageTree, prefixes: Prefixes) -> None:
    include = [f"{name}:{share}" for name, share in prefixes.closure(tree.package).items()]
    arguments = _arguments(tree, prefixes, _HASH, tree.share, include_paths=include)
    describe = _function(_HASH, "generate_type_hash")
    _quietly(f"{tree.package.name}: type hashes", lambda: describe(arguments))


def _generate_c(tree: PackageTree, prefixes: Prefixes) -> None:
    described = [
        f"{i.idl}:{tree.share / Path(i.idl).with_suffix('.json')}" for i in tree.package.interfaces
    ]
    extra_keys = {"rosidl_generator_c": {"type_description_tuples": described}}
    extra_arguments = {"rosidl_typesupport_c": (list(TYPE_SUPPORTS),)}
    names = {"rosidl_typesupport_fastrtps_c": "generate_typesupport_fastrtps_c"}
    for generator in C_GENERATORS:
        run = _function(generator, names.get(generator, "generate_c"))
        arguments = _arguments(
            tree, prefixes, generator, tree.code_of(generator), **extra_keys.get(generator, {})
        )
        _run_generator(tree, generator, run, arguments, *extra_arguments.get(generator, ()))


def _generate_python(tree: PackageTree, prefixes: Prefixes) -> None:
    run = _function(f"{_PY}.generate_py_impl", "generate_py")
    arguments = _arguments(tree, prefixes, _PY, tree.python)
    _run_generator(tree, _PY, run, arguments, ["rosidl_typesupport_c"])
    (tree.python / "__init__.py").write_text("", encoding="utf-8")


def _run_generator(
    tree: PackageTree, generator: str, run: Callable[..., object], *arguments: object
) -> None:
    _quietly(f"{tree.package.name}: {generator} failed", lambda: run(*arguments))


def _arguments(
    tree: PackageTree, prefixes: Prefixes, generator: str, output: Path, **extra: list[str]
) -> str:
    """Write the argument file that every rosidl generator reads, and return its path."""
    package = tree.package
    document = {
        "package_name": package.name,
        "output_dir": str(output),
        "template_dir": str(prefixes.ros / "share" / generator / "resource"),
        "idl_tuples": [f"{tree.share}:{interface.idl}" for interface in package.interfaces],
        "ros_interface_files": [str(tree.share / i.file) for i in package.interfaces],
        "ros_interface_dependencies": [],
        "target_dependencies": [],
        **extra,
    }
    path = tree.generated / f"{generator}.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return str(path)


def _write_visibility_headers(tree: PackageTree, prefixes: Prefixes) -> None:
    name = tree.package.name
    for generator in C_GENERATORS:
        header = f"{generator}__visibility_control.h"
        template = prefixes.ros / "share" / generator / "resource" / f"{header}.in"
        if template.is_file():
            text = template.read_text(encoding="utf-8")
            text = text.replace("@PROJECT_NAME_UPPER@", name.upper())
            text = text.replace("@PROJECT_NAME@", name)
            (tree.code_of(generator) / "msg" / header).write_text(text, encoding="utf-8")


def _function(module: str, name: str) -> Callable[..., object]:
    try:
        function: Callable[..., object] = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise BuildToolError(f"the ROS 2 generator {module}.{name} is missing: {error}") from error
    return function


def _quietly(failure: str, run: Callable[[], object]) -> None:
    """Run a generator and capture its output; convert any exception to an error with the output.

    Generators print, raise exceptions of many types, and some exit the interpreter.
    """
    captured = io.StringIO()
    try:
        with contextlib.redirect_stdout(captured), contextlib.redirect_stderr(captured):
            run()
    except (Exception, SystemExit) as error:
        raise CommandError(f"{failure}: {error}", output=captured.getvalue()[-4000:]) from error
