"""The folder of a new node: a package of its own, or an existing package.

It finds the folder from `--dest` and the working folder, and reads its package. It never writes.
"""

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from obk_cli.config.environment import ModelRead, NodeFacts
from obk_cli.errors import CommandFailedError
from obk_cli.scaffold.compose import Composition
from obk_cli.scaffold.kinds import Kind
from obk_cli.scaffold.package_files import PackageIdentity, PackageTexts, read_identity
from obk_cli.scaffold.package_spec import PackageRequest, PackageSpec, RobotJoints
from obk_cli.scaffold.robot_model import robot_joints
from obk_cli.scaffold.stack import (
    Model,
    StackNode,
    StackSketch,
    choose_nodes,
    read_model_text,
    stack_text,
)
from obk_cli.scaffold.templates import Template, render_templates
from obk_cli.workspace.entry_points import source_console_scripts
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import find_workspace, is_workspace

__all__ = [
    "TargetFolder",
    "compose_config",
    "find_joints",
    "find_model",
    "find_root",
    "find_target",
    "has_test_settings",
    "read_package_texts",
    "require_suitable_package",
]

_ELSEWHERE = "use --dest to create a package elsewhere"


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetFolder:
    """A folder for packages, or an existing package that the node is added to.

    `boundary` is the folder that the user named; nothing is created outside it.
    """

    folder: Path
    boundary: Path
    package: PackageIdentity | None = None
    python_folder: str = "."
    """Folder of the package's modules: `src` in that layout."""


def find_target(dest: Path | None, kind: Kind, config: Path | None = None) -> TargetFolder:
    """`dest`; by default the enclosing package, `src/` of the working folder, or the working
    folder.

    Outside a workspace, a node goes into the workspace of the config that it is `joined` to,
    because a launch searches no other folder. A config is not a package: it goes into `dest` or the
    working folder.

    Raises:
        CommandFailedError: the folder is a file, or a package whose package.xml cannot be read.
    """
    folder = _usual_folder(config) if dest is None else dest
    if folder.exists() and not folder.is_dir():
        raise CommandFailedError(f"--dest: {folder} is a file, expected a folder")
    if kind == "config":
        return TargetFolder(folder=folder, boundary=folder)
    if (folder / "package.xml").is_file():
        identity = _identify(folder)
        in_src = (folder / "src" / identity.name / "__init__.py").is_file()
        return TargetFolder(
            folder=folder,
            boundary=folder,
            package=identity,
            python_folder="src" if in_src else ".",
        )
    if dest is None and (folder / "src").is_dir():
        return TargetFolder(folder=folder / "src", boundary=folder)
    return TargetFolder(folder=folder, boundary=folder)


def find_root(target: TargetFolder, name: str) -> Path:
    """The folder of the package for a node of this name, which must be valid.

    Raises:
        CommandFailedError: the folder is a file, or is reached through a symbolic link that leads
            outside.
    """
    if target.package is not None:
        return target.folder.resolve()
    root = target.folder / name
    real = root.resolve()
    if not real.is_relative_to(target.boundary.resolve()):
        raise CommandFailedError(
            f"{root} is reached through a symbolic link to {real}",
            help=f"to create the package there, add --dest {real.parent}",
        )
    if root.exists() and not root.is_dir():
        raise CommandFailedError(
            f"{root} is a file, expected a folder or a new name",
            help="choose another name or --dest",
        )
    return root


def _usual_folder(config: Path | None) -> Path:
    cwd = Path.cwd()
    package = _enclosing_package(cwd)
    if package is not None:
        return package
    workspace = find_workspace(config.parent) if config else cwd
    is_outside = not is_workspace(find_workspace(cwd)) and is_workspace(workspace)
    return workspace if is_outside else Path()


def _enclosing_package(folder: Path) -> Path | None:
    """The package that contains a folder; the upward search stops at a workspace or checkout."""
    for parent in (folder, *folder.parents):
        if (parent / "package.xml").is_file():
            return parent
        if (parent / "src").is_dir() or (parent / ".git").exists():
            return None
    return None


def require_suitable_package(target: TargetFolder, request: PackageRequest) -> None:
    """Reject a package that cannot take the new node.

    Raises:
        CommandFailedError: the package cannot take the node.
    """
    identity = target.package
    assert identity is not None
    if request.kind == "msgs":
        raise CommandFailedError(
            f"this folder is the package `{identity.name}`, but messages need a package of "
            "their own",
            help=_ELSEWHERE,
        )
    if request.language == "cpp":
        raise CommandFailedError(
            f"this folder is the package `{identity.name}`, but a C++ node needs a package of "
            "its own",
            help=_ELSEWHERE,
        )
    if identity.build_type != "ament_python":
        raise CommandFailedError(
            f"the package `{identity.name}` in this folder has the build type "
            f"`{identity.build_type}`; Python nodes can only be added to packages of build "
            "type `ament_python`",
            help=_ELSEWHERE,
        )
    module = Path(target.python_folder, identity.name, "__init__.py")
    if not (target.folder / module).is_file():
        raise CommandFailedError(
            f"the package `{identity.name}` in this folder has no module `{module}`",
            help=f"create that file, or {_ELSEWHERE}",
        )


_SETTINGS = ("pyproject.toml", "pytest.ini")
_PLUGIN = "obk_testing.plugin"


def has_test_settings(root: Path) -> bool:
    """Whether the workspace around a package has settings with which its tests run.

    Raises:
        CommandFailedError: the settings are not UTF-8.
    """
    workspace = find_workspace(root.parent)
    return any(_PLUGIN in read_text(workspace / name) for name in _SETTINGS)


def read_package_texts(root: Path) -> PackageTexts:
    """The files of a package that change when a node is added.

    Raises:
        CommandFailedError: one of them is not UTF-8.
    """
    return PackageTexts(
        package_xml=read_text(root / "package.xml"),
        setup_py=read_text(root / "setup.py"),
        setup_cfg=read_text(root / "setup.cfg"),
        pyproject=read_text(root / "pyproject.toml"),
    )


def read_text(path: Path) -> str:
    """The text with its original line ends; empty if the file does not exist.

    Raises:
        CommandFailedError: the file is not UTF-8.
    """
    try:
        return path.read_bytes().decode() if path.is_file() else ""
    except UnicodeDecodeError as fault:
        raise CommandFailedError(f"{path} is not UTF-8 text: {fault}", help=_ELSEWHERE) from fault


def _identify(folder: Path) -> PackageIdentity:
    identity = read_identity(read_text(folder / "package.xml"))
    if identity is None:
        raise CommandFailedError(
            f"{folder / 'package.xml'} is not a valid package.xml", help=_ELSEWHERE
        )
    return identity


_STAND_INS = (
    ("obelisk_control_py", "example_position_setpoint_controller"),
    ("obelisk_estimation_py", "jointencoders_passthrough_estimator"),
)
_MODEL_FOLDERS = (".", "model", "models")
_OWN_MODEL = ".xml.jinja"
"""Template of a model, for a workspace without one."""


def compose_config(spec: PackageSpec, templates: Iterable[Template], root: Path) -> Composition:
    """Render a config, and a small model if the workspace has neither a robot nor a model.

    Raises:
        TemplateFaultError: a template cannot be rendered.
    """
    environment = MachineEnvironment(root, Path.cwd(), os.environ)
    stand_ins = _nodes(environment, _STAND_INS)
    nodes = choose_nodes(_nodes(environment, _executables(environment)), stand_ins)
    variables = {"node": spec.node, "package": spec.package, "kind": spec.kind}
    given = tuple(templates)
    if any(node.kind == "robot" for node in nodes):
        model, own = None, []
    else:
        model = find_model(root)
        own = [] if model else [t for t in given if t.name.endswith(_OWN_MODEL)]
    files = render_templates(own, variables)
    if model is None and files:
        model = read_model_text(files[0].content.decode(), files[0].path.as_posix())
    text = stack_text(StackSketch(name=spec.node, nodes=nodes, model=model))
    others = tuple(t for t in given if not t.name.endswith(_OWN_MODEL))
    return Composition(files=(*files, *render_templates(others, {**variables, "stack": text})))


def _executables(environment: MachineEnvironment) -> Iterator[tuple[str, str]]:
    for package, folder in sorted(environment.packages.source_packages.items()):
        yield from ((package, script) for script in sorted(source_console_scripts(folder)))


def _nodes(
    environment: MachineEnvironment, executables: Iterable[tuple[str, str]]
) -> tuple[StackNode, ...]:
    """The executables that can be read as nodes."""
    codes = ((p, e, environment.read_node_code(p, e)) for p, e in executables)
    return tuple(
        StackNode(package=package, executable=executable, code=code)
        for package, executable, code in codes
        if isinstance(code, NodeFacts)
    )


def find_model(root: Path) -> Model | None:
    """The first model in the usual folders of the workspace, by its path from a folder in it."""
    workspace = find_workspace(root)
    folders = dict.fromkeys((root, *(workspace / name for name in _MODEL_FOLDERS)))
    for folder in folders:
        for path in filter(Path.is_file, sorted(folder.glob("*.xml"))):
            try:
                text = path.read_text(encoding="utf-8", errors="replace")
            except OSError:
                continue  # unreadable
            model = read_model_text(text, os.path.relpath(path, root))
            if model is not None:
                return model
    return None


def find_joints(root: Path) -> RobotJoints | None:
    """The joints of the workspace's model in its first keyframe; None if unknown."""
    model = find_model(root)
    if model is None:
        return None
    environment = MachineEnvironment(root, Path.cwd(), os.environ)
    read = environment.read_model((root / model.path).resolve())
    if not isinstance(read, ModelRead):
        return None
    return robot_joints(read.facts, next(iter(model.keyframes), ""))
