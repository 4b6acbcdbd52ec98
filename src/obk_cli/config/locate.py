"""Find what a config refers to: types in the nodes' source, files, and ray casters in files.

Files are searched in the config's folder, then in the package's share folder.
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from obelisk_spec.components import component_identity
from obelisk_spec.suggestions import near_names, sure_name
from obk_cli.config.environment import CodeComponent, Environment, NodeFacts
from obk_cli.config.loader import ConfigFiles
from obk_cli.config.model import Component, FileSearch, Node, Sim, Spanned, Stack
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap, TreeScalar, kind_of
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.source import Span

__all__ = ["locate_files", "locate_stack"]

_MODEL_FOLDER = "mujoco"
_WRAPPER = "scan_config"
_PATH = "config_path"


def locate_stack(
    stack: Stack, folder: Path, files: ConfigFiles, environment: Environment
) -> tuple[Stack, tuple[Diagnostic, ...]]:
    """The stack with everything that it refers to, and findings about ray-caster files.

    Args:
        stack: the typed config.
        folder: the config's folder.
        files: loads the files of `config_path`.
        environment: finds packages and sources of nodes.
    """
    stack = locate_files(stack, folder, environment)
    nodes = (_with_code_types(node, environment) for node in stack.nodes)
    stack = replace(stack, nodes=tuple(nodes))
    if not any(sim.files for node in stack.nodes for sim in node.used_sims):
        return stack, ()
    ray_casters = _RayCasters(files)
    nodes = (
        replace(node, sims=tuple(ray_casters.in_sim(sim) for sim in node.sims))
        if node.used_sims
        else node
        for node in stack.nodes
    )
    stack = replace(stack, nodes=tuple(nodes))
    return stack, tuple(dict.fromkeys(ray_casters.faults))


def locate_files(stack: Stack, folder: Path, environment: Environment) -> Stack:
    """Search every file of a stack; `folder` is the config's folder."""
    search = _Search(folder, environment)
    return replace(stack, nodes=tuple(search.in_node(node) for node in stack.nodes))


def _with_code_types(node: Node, environment: Environment) -> Node:
    if node.pkg is None or node.executable is None or not node.components:
        return node
    command = (node.pkg.value, node.executable.value)
    code = environment.read_node_code(*command)
    if isinstance(code, NodeFacts):
        of_hardware = _hardware_components(node, code)
        components = (
            replace(c, is_unused=True) if c in of_hardware else _with_code_type(c, code)
            for c in node.components
        )
    elif environment.is_cpp(*command):
        components = (replace(c, ignores_type=True) for c in node.components)
    else:
        return node
    return replace(node, components=tuple(components))


def _hardware_components(node: Node, code: NodeFacts) -> tuple[Component, ...]:
    """Components that only the robot's hardware registers, not its simulator; no misspellings."""
    if not (node.is_simulator and node.runs_simulation and code.knows_components):
        return ()
    given = [*map(code.component_of, node.components)]
    missing = [c for c in code.components if c.is_required and c not in given]
    return tuple(
        component
        for component, registered in zip(node.components, given, strict=True)
        if component.name is not None
        and registered is None
        and not sure_name(
            component.identity or "",
            {component_identity(c.name) for c in code.components if c.kind == component.kind},
        )
        and not any(_may_mean(component, c) for c in missing)
    )


def _may_mean(component: Component, missing: CodeComponent) -> bool:
    """Whether a component may be one that the code needs, with a misspelled name or kind."""
    name = component.identity or ""
    is_near = component.kind == missing.kind and near_names(name, missing.names)
    return name in missing.names or bool(is_near)


def _with_code_type(component: Component, code: NodeFacts) -> Component:
    registered = code.component_of(component)
    if registered is None or registered.msg_type is None:
        return component
    return replace(component, code_type=registered.msg_type)


class _Search:
    def __init__(self, folder: Path, environment: Environment) -> None:
        self._folder = folder
        self._environment = environment
        self._names: dict[Path, tuple[str, ...]] = {}

    def in_node(self, node: Node) -> Node:
        """The node with its files searched."""
        return replace(
            node,
            sims=tuple(self._in_sim(sim) for sim in node.sims),
            params_file=self._file(node.params_path, node.params_package, ""),
            urdf_file=self._file(node.urdf, node.robot_pkg, "urdf"),
        )

    def _in_sim(self, sim: Sim) -> Sim:
        return replace(
            sim,
            model=self._file(sim.model_xml_path, sim.robot_pkg, _MODEL_FOLDER),
            files=tuple(
                file
                for path in sim.config_paths
                if (file := self._file(path, sim.robot_pkg, _MODEL_FOLDER))
            ),
        )

    def _file(
        self, written: Spanned[str] | None, package: Spanned[str] | None, subfolder: str
    ) -> FileSearch | None:
        if written is None:
            return None
        share = self._environment.find_package_share(package.value) if package else None
        tried: list[Path] = []
        for path in self._places(written, share, subfolder):
            if path not in tried:
                tried.append(path)
            if _is_file(path):
                return FileSearch(written=written, found=path, tried=tuple(tried))
        missing = package.value if package is not None and share is None else None
        return FileSearch(
            written=written,
            found=None,
            tried=tuple(tried),
            missing_package=missing,
            near=self._near(Path(written.value), tried),
        )

    def _near(self, written: Path, tried: Iterable[Path]) -> tuple[str, ...]:
        """Files of the same kind with similar names in the folders that were searched.

        Otherwise files of the same name in the folders above and beside them.
        """
        if not written.name:
            return ()
        stems: dict[str, str] = {}
        elsewhere: dict[Path, str] = {}
        for path in tried:
            for name in self._names_in(path.parent):
                if Path(name).suffix == written.suffix and name != path.name:
                    stems.setdefault(Path(name).stem, str(written.with_name(name)))
            if written.is_absolute() or path.parts[-len(written.parts) :] != written.parts:
                continue  # outside the folder, through a link or `..`
            base = path.parents[len(written.parts) - 1]
            for name in self._names_in(base):
                for other in (base / name, base / name / written.name):
                    if other.name == written.name and _is_file(other):
                        elsewhere.setdefault(other, str(other.relative_to(base)))
        near = tuple(stems[stem] for stem in near_names(written.stem, stems))
        return near or tuple(elsewhere.values())

    def _names_in(self, folder: Path) -> tuple[str, ...]:
        if folder not in self._names:
            try:
                self._names[folder] = tuple(sorted(path.name for path in folder.iterdir()))
            except OSError:
                self._names[folder] = ()
        return self._names[folder]

    def _places(self, written: Spanned[str], share: Path | None, subfolder: str) -> Iterator[Path]:
        path = Path(written.value)
        if path.is_absolute():
            yield path
            return
        yield _real(self._folder / path)
        own = Path(written.span.path).parent
        if own.is_dir():
            # An included fragment may refer to files next to itself.
            yield _real(own / path)
        if share is not None:
            yield share / subfolder / path
            yield share / path


def _real(path: Path) -> Path:
    """The path with links resolved; a circular link is resolved as far as possible."""
    return Path(os.path.realpath(path))  # `Path.resolve` raises for circular links


def _is_file(path: Path) -> bool:
    """Whether the file exists; False for an invalid or too long name."""
    return os.path.isfile(path)  # noqa: PTH113  (`Path.is_file` raises)


class _RayCasters:
    def __init__(self, files: ConfigFiles) -> None:
        self.faults: list[Diagnostic] = []
        self._files = files

    def in_sim(self, sim: Sim) -> Sim:
        """The block with the files of its sensor groups inserted."""
        paths = {file.written.span: file.found for file in sim.files}
        entry = sim.tree.get("sensor_settings")
        if not paths or entry is None or not isinstance(entry.value, TreeList):
            return sim
        groups = tuple(self._in_group(group, paths) for group in entry.value.items)
        filled = replace(entry, value=replace(entry.value, items=groups))
        entries = tuple(filled if e is entry else e for e in sim.tree)
        return replace(sim, checked=replace(sim.tree, entries=entries))

    def _in_group(self, group: Tree, paths: Mapping[Span, Path | None]) -> Tree:
        entry = group.get(_PATH) if isinstance(group, TreeMap) else None
        if entry is None or not isinstance(group, TreeMap) or group.get(_WRAPPER):
            return group
        path = paths.get(entry.value.span)
        scan = self._read(path, entry) if path is not None else None
        if scan is None:
            return group
        return replace(group, entries=(*group.entries, Entry(_WRAPPER, entry.key_span, scan)))

    def _read(self, path: Path, entry: Entry) -> TreeMap | None:
        loaded = self._files.load_shown(path)
        self.faults += loaded.diagnostics
        if loaded.unreadable is not None:
            message = f"the file of `{_PATH}` cannot be read: {loaded.unreadable}"
            self.faults.append(found("OBK404", message, entry.value.span, severity="error"))
            return None
        tree = loaded.tree
        wrapped = tree.get(_WRAPPER) if isinstance(tree, TreeMap) else None
        tree = wrapped.value if wrapped else tree
        if isinstance(tree, TreeMap):
            return tree
        if not loaded.diagnostics:
            self.faults.append(_no_ray_caster(tree, entry))
        return None


def _no_ray_caster(tree: Tree | None, entry: Entry) -> Diagnostic:
    if tree is None or (isinstance(tree, TreeScalar) and tree.value is None):
        message = f"the file of `{_PATH}` is empty, expected a ray caster"
        return found("OBK103", message, entry.value.span)
    return found(
        "OBK103",
        f"the file contains {kind_of(tree)}, expected a ray caster: a mapping with `site_name` "
        "and `pattern`",
        tree.span,
        related=(Related(message=f"the `{_PATH}`", span=entry.value.span),),
    )
