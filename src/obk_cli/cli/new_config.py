"""`obk new config NAME`: a config of what stands in the workspace around it.

In: the answers and the folder that the config goes into. Out: files in memory.
"""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from obk_cli.config.node_facts import NodeFacts
from obk_cli.scaffold.compose import Composition
from obk_cli.scaffold.questions import Answers
from obk_cli.scaffold.stack import (
    Model,
    Stack,
    StackNode,
    choose_nodes,
    read_model_text,
    stack_text,
)
from obk_cli.scaffold.templates import Template, render_templates
from obk_cli.workspace.entry_points import source_console_scripts
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import find_workspace

__all__ = ["compose_config", "find_model"]

_STAND_INS = (
    ("obelisk_control_py", "example_position_setpoint_controller"),
    ("obelisk_estimation_py", "jointencoders_passthrough_estimator"),
)
_MODEL_FOLDERS = (".", "model", "models")
_OWN_MODEL = ".xml.jinja"
"""The template of a model, for a workspace that has none."""


def compose_config(answers: Answers, templates: Iterable[Template], root: Path) -> Composition:
    """A config, and a small model where the workspace has neither a robot nor a model.

    Raises:
        TemplateFaultError: a template cannot be rendered.
    """
    environment = MachineEnvironment(root, Path.cwd(), os.environ)
    stand_ins = _nodes(environment, _STAND_INS)
    nodes = choose_nodes(_nodes(environment, _executables(environment)), stand_ins)
    variables = {"node": answers.node, "package": answers.package, "kind": answers.kind}
    given = tuple(templates)
    if any(node.kind == "robot" for node in nodes):
        model, own = None, []
    else:
        model = find_model(root)
        own = [] if model else [t for t in given if t.name.endswith(_OWN_MODEL)]
    files = render_templates(own, variables)
    if model is None and files:
        model = read_model_text(files[0].content.decode(), files[0].path.as_posix())
    text = stack_text(Stack(name=answers.node, nodes=nodes, model=model))
    others = tuple(t for t in given if not t.name.endswith(_OWN_MODEL))
    return Composition(files=(*files, *render_templates(others, {**variables, "stack": text})))


def _executables(environment: MachineEnvironment) -> Iterator[tuple[str, str]]:
    for package, folder in sorted(environment.packages.source_packages.items()):
        yield from ((package, script) for script in sorted(source_console_scripts(folder)))


def _nodes(
    environment: MachineEnvironment, executables: Iterable[tuple[str, str]]
) -> tuple[StackNode, ...]:
    """Those executables that can be read as nodes."""
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
                continue  # not to be read
            model = read_model_text(text, os.path.relpath(path, root))
            if model is not None:
                return model
    return None
