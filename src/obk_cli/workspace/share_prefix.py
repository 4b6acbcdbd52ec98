"""Create an ament prefix for packages that run from source, so that nodes find their files.

`get_package_share_directory("my_pkg")` returns a folder of links: to everything in the package's
source folder, and to what its setup.py, setup.cfg or CMakeLists.txt would install below
`share/my_pkg`. If the package is also installed, the rest of its share folder and its programs are
linked as well. No code is run: expressions in a setup.py that only Python could evaluate are
skipped.
"""

import ast
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Final

from obelisk_spec.names import package_name_fault
from obk_cli.workspace.package_index import PackageIndex
from obk_interfaces import cmake_calls

__all__ = ["make_share_prefix", "with_prefix"]

_INDEX: Final = Path("share/ament_index/resource_index/packages")
_NOT_LINKED: Final = ("__pycache__", "build", "install", "log")
Links = dict[str, "Path | Links"]
"""The content of a folder: name -> target of its link, or a folder of links."""


def make_share_prefix(prefix: Path, packages: PackageIndex) -> Path | None:
    """Write the prefix of the workspaces' packages; return None if they have none.

    Args:
        prefix: a folder that does not exist; no process may search it yet.
        packages: the workspaces, and the prefixes that may have the packages installed.

    Raises:
        OSError: the prefix cannot be written.
    """
    if not packages.source_packages:
        return None
    (prefix / _INDEX).mkdir(parents=True)
    # Its manifests are links, so mark the folder: a search must not find the packages twice.
    (prefix / "COLCON_IGNORE").touch()
    for name, source in packages.source_packages.items():
        if package_name_fault(name) is not None:
            continue
        (prefix / _INDEX / name).touch()
        _write(prefix / "share" / name, _share_links(name, source, packages.prefixes))
        programs = (installed / "lib" / name for installed in packages.prefixes)
        for folder in (found for found in programs if found.is_dir()):
            (prefix / "lib").mkdir(exist_ok=True)
            (prefix / "lib" / name).symlink_to(folder)
            break
    return prefix


def with_prefix(variables: Mapping[str, str], prefix: Path | None) -> Mapping[str, str]:
    """The variables of a process that searches this prefix first."""
    if prefix is None:
        return variables
    inherited = variables.get("AMENT_PREFIX_PATH", "")
    path = f"{prefix}:{inherited}" if inherited else str(prefix)
    return {**variables, "AMENT_PREFIX_PATH": path}


def _share_links(name: str, source: Path, prefixes: Iterable[Path]) -> Links:
    links = _children(source)
    for target, file in (
        *_setup_py_files(source),
        *_setup_cfg_files(source),
        *_cmake_files(source),
    ):
        parts = PurePosixPath(target).parts
        is_below = parts[:2] == ("share", name) and ".." not in parts
        if is_below and os.path.lexists(file):
            _add(links, parts[2:], file)
    for prefix in prefixes:
        if (prefix / "share" / name).is_dir():
            _add_missing(links, _children(prefix / "share" / name))
            break
    return links


def _children(folder: Path) -> Links:
    try:
        found = sorted(folder.iterdir())
    except OSError:
        return {}
    return {
        path.name: path
        for path in found
        if not path.name.startswith(".") and path.name not in _NOT_LINKED
    }


def _add(links: Links, parts: tuple[str, ...], path: Path) -> None:
    """Link a file or folder at a path, even if a folder above it is currently a link."""
    if not parts:
        return
    name, *rest = parts
    present = links.get(name)
    if isinstance(present, Path):
        if _is_same(present.joinpath(*rest), path):
            return
        if rest or (present.is_dir() and path.is_dir()):
            present = links[name] = _children(present)
    if rest:
        inner = present if isinstance(present, dict) else {}
        links[name] = inner
        _add(inner, tuple(rest), path)
    elif isinstance(present, dict) and path.is_dir():
        for child, its_path in _children(path).items():
            if isinstance(its_path, Path):
                _add(present, (child,), its_path)
    else:
        links[name] = path


def _add_missing(links: Links, more: Links) -> None:
    """Link the additional content of a second folder of the same package."""
    for name, path in more.items():
        present = links.get(name)
        if present is None:
            links[name] = path
        elif isinstance(path, Path) and path.is_dir():
            if isinstance(present, Path) and present.is_dir():
                present = links[name] = _children(present)
            if isinstance(present, dict):
                _add_missing(present, _children(path))


def _is_same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:
        return False


def _write(folder: Path, links: Links) -> None:
    folder.mkdir()
    for name, target in links.items():
        if isinstance(target, Path):
            (folder / name).symlink_to(target)
        else:
            _write(folder / name, target)


def _cmake_files(source: Path) -> Iterator[tuple[str, Path]]:
    """What `install(FILES ...)` and `install(DIRECTORY ...)` in CMakeLists.txt put where."""
    for command, words in cmake_calls(_text_of(source / "CMakeLists.txt")):
        if command != "install" or "DESTINATION" not in words[:-1]:
            continue
        place = words.index("DESTINATION")
        kind, names, target = words[0], words[1:place], words[place + 1]
        for name in names if kind in ("FILES", "DIRECTORY") else ():
            # With a trailing slash, the content of the folder is installed, not the folder.
            is_content = kind == "DIRECTORY" and name.endswith("/")
            path = source / name
            yield (target if is_content else f"{target}/{path.name}"), path


def _setup_cfg_files(source: Path) -> Iterator[tuple[str, Path]]:
    """What `[options.data_files]` in a setup.cfg installs, and where."""
    import configparser  # rarely needed

    parser = configparser.ConfigParser(interpolation=None, delimiters=("=",))
    try:
        parser.read_string(_text_of(source / "setup.cfg"))
    except configparser.Error:
        return
    section = parser["options.data_files"] if parser.has_section("options.data_files") else {}
    for target, names in section.items():
        for pattern in names.replace(",", "\n").split():
            yield from ((f"{target}/{path.name}", path) for path in _glob(source, pattern))


def _setup_py_files(source: Path) -> Iterator[tuple[str, Path]]:
    """What `data_files` in a setup.py installs, and where."""
    try:
        tree = ast.parse(_text_of(source / "setup.py"))
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return
    values = _Values(source)
    for statement in tree.body:
        values.take(statement)
    for entry in values.data_files:
        match entry:
            case (str(target), [*names]):
                for name in names:
                    if isinstance(name, str):
                        path = source / name
                        yield f"{target}/{path.name}", path


class _Values:
    """The plain values of a setup.py's expressions; others are None."""

    def __init__(self, source: Path) -> None:
        self._source = source
        self._names: dict[str, object] = {}
        self.data_files: list[object] = []

    def take(self, statement: ast.stmt) -> None:
        """Evaluate an assignment or a call of the module."""
        match statement:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                self._names[name] = self._value(value)
            case ast.AugAssign(target=ast.Name(id=name), op=ast.Add(), value=value):
                self._grow(name, self._value(value))
            case ast.Expr(
                value=ast.Call(
                    func=ast.Attribute(value=ast.Name(id=name), attr="append" | "extend" as how),
                    args=[value],
                )
            ):
                more = self._value(value)
                self._grow(name, [more] if how == "append" else more)
            case ast.Expr(value=ast.Call(keywords=keywords)):
                for keyword in keywords:
                    if keyword.arg == "name":
                        self._names.setdefault("name", self._value(keyword.value))
                    found = self._value(keyword.value) if keyword.arg == "data_files" else None
                    self.data_files += found if isinstance(found, list) else []

    def _grow(self, name: str, more: object) -> None:
        """Append to a list; values that cannot be evaluated are skipped."""
        present = self._names.get(name)
        grown = _sum(present, more)
        self._names[name] = present if grown is None else grown

    def _value(self, node: ast.expr) -> object:
        match node:
            case ast.Constant(value=str(text)):
                return text
            case ast.Name(id=name):
                return self._names.get(name)
            case ast.Tuple(elts=[first, second]):
                return (self._value(first), self._value(second))
            case ast.List(elts=elements) | ast.Tuple(elts=elements):
                return [item for element in elements for item in self._items(element)]
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                return _sum(self._value(left), self._value(right))
            case ast.JoinedStr(values=parts):
                texts = [self._value(_unformatted(part)) for part in parts]
                return "".join(map(str, texts)) if None not in texts else None
            case ast.Call(func=function, args=arguments):
                return self._call(_last_name(function), [self._value(a) for a in arguments])
        return None

    def _items(self, element: ast.expr) -> list[object]:
        if isinstance(element, ast.Starred):
            value = self._value(element.value)
            return value if isinstance(value, list) else []
        return [self._value(element)]

    def _call(self, function: str, arguments: list[object]) -> object:
        texts = [text for text in arguments if isinstance(text, str)]
        if not texts or len(texts) != len(arguments):
            return arguments[0] if function in ("list", "sorted", "str") and arguments else None
        match function:
            case "join":
                return "/".join(text.rstrip("/") for text in texts)
            case "glob" | "iglob":
                return [str(path) for path in _glob(self._source, texts[0])]
            case "str" | "Path":
                return texts[0]
        return None


def _sum(one: object, other: object) -> object:
    if isinstance(one, str) and isinstance(other, str):
        return one + other
    return [*one, *other] if isinstance(one, list) and isinstance(other, list) else None


def _unformatted(part: ast.expr) -> ast.expr:
    return part.value if isinstance(part, ast.FormattedValue) else part


def _last_name(function: ast.expr) -> str:
    match function:
        case ast.Attribute(attr=name) | ast.Name(id=name):
            return name
    return ""


def _glob(source: Path, pattern: str) -> Iterator[Path]:
    try:
        yield from sorted(source.glob(pattern))
    except (ValueError, NotImplementedError, OSError):  # not a pattern for files in the package
        return


def _text_of(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    except OSError:
        return ""
