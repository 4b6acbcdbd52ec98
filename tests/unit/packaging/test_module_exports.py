"""`__all__` lists every name that other modules import."""

import ast
from collections.abc import Iterator
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[3] / "src"


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__")


def exported(tree: ast.Module) -> set[str] | None:
    for node in tree.body:
        match node:
            case ast.Assign(targets=[ast.Name(id="__all__")], value=ast.List(elts=names)):
                return {ast.literal_eval(name) for name in names}
    return None


def imports(tree: ast.Module) -> Iterator[tuple[str, str]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module is not None and not node.level:
            yield from ((node.module, alias.name) for alias in node.names)


def test_other_modules_import_only_exported_names() -> None:
    trees = {module_name(path): ast.parse(path.read_text()) for path in SOURCE.rglob("*.py")}
    exports = {name: exported(tree) for name, tree in trees.items()}
    missing = [
        f"{importer}: {module}.{name}"
        for importer, tree in trees.items()
        for module, name in imports(tree)
        if name not in (exports.get(module) or (name,)) and f"{module}.{name}" not in trees
    ]
    assert not missing
