"""The kinds that can be created, with their languages and template folders.

This module never reads files.
"""

import keyword
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from obelisk_spec.names import node_name_fault, package_name_fault

__all__ = [
    "ARM_LAYER",
    "HOLD_LAYER",
    "LAYER_NAMES",
    "LONGEST_NAME",
    "MODEL_LAYER",
    "NODE_KINDS",
    "PACKAGE_OF_WORKSPACE_LAYERS",
    "RECIPES",
    "SECTIONS",
    "SERVICE_LAYER",
    "SETTINGS_LAYER",
    "WORKSPACE_LAYER",
    "Kind",
    "Language",
    "Problem",
    "Recipe",
    "Release",
    "check_name",
    "recipe_of",
    "suggest_name",
]

Kind = Literal["controller", "estimator", "robot", "sensor", "msgs", "config"]
Language = Literal["py", "cpp"]
Release = Literal["v0.4", "2026"]
"""Version of Obelisk's C++ library: v0.1 to v0.4, or since May 2026."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """One kind that `obk new` creates, in one language."""

    kind: Kind
    language: Language | None
    """None if it is not in a programming language."""
    layers: tuple[str, ...]
    """Template folders; a later folder overrides files of the same name."""
    summary: str


RECIPES: Final = (
    Recipe(
        kind="controller",
        language="py",
        layers=("package_py", "controller_py"),
        summary="state estimates in, control messages out",
    ),
    Recipe(
        kind="controller",
        language="cpp",
        layers=("package_cpp", "controller_cpp"),
        summary="the same for a full ROS 2 install",
    ),
    Recipe(
        kind="estimator",
        language="py",
        layers=("package_py", "estimator_py"),
        summary="sensor messages in, state estimates out",
    ),
    Recipe(
        kind="estimator",
        language="cpp",
        layers=("package_cpp", "estimator_cpp"),
        summary="the same for a full ROS 2 install",
    ),
    Recipe(
        kind="robot",
        language="py",
        layers=("package_py", "robot_py"),
        summary="control messages to the hardware, sensor messages from it",
    ),
    Recipe(
        kind="sensor",
        language="py",
        layers=("package_py", "sensor_py"),
        summary="sensor messages from a device separate from the robot",
    ),
    Recipe(
        kind="msgs",
        language=None,
        layers=("msgs",),
        summary="your own message and service types",
    ),
    Recipe(
        kind="config",
        language=None,
        layers=("config",),
        summary="a stack from the workspace's nodes",
    ),
)
"""All recipes, in the order of the help."""

NODE_KINDS: Final = ("controller", "estimator", "robot", "sensor")

SECTIONS: Final = {
    "controller": "control",
    "estimator": "estimation",
    "robot": "robot",
    "sensor": "sensing",
}
"""Kind of node -> its section in the config."""

SERVICE_LAYER: Final = "msgs_srv"
"""Added to `msgs` if a service is requested."""

SETTINGS_LAYER: Final = "settings"
"""Settings of pytest, ruff and mypy, for a workspace or for a Python package outside one."""

WORKSPACE_LAYER: Final = "workspace"
"""Files that `obk init` creates around its packages."""

ARM_LAYER: Final = "workspace_arm"
"""The robot of a workspace for which no model is given."""

MODEL_LAYER: Final = "workspace_model"
"""The stack for a given model."""

PACKAGE_OF_WORKSPACE_LAYERS: Final[dict[Kind, tuple[str, ...]]] = {
    "controller": ("package_py", "controller_py", "workspace_controller"),
    "estimator": ("package_py", "estimator_py"),
}
"""Layers of its packages."""

HOLD_LAYER: Final = "hold_controller"
"""Added to the controller's layers if a model is given."""

WORKSPACE_LAYERS: Final = (
    WORKSPACE_LAYER,
    SETTINGS_LAYER,
    ARM_LAYER,
    MODEL_LAYER,
    *dict.fromkeys(layer for layers in PACKAGE_OF_WORKSPACE_LAYERS.values() for layer in layers),
    HOLD_LAYER,
)
"""All template folders that `obk init` reads."""

LAYER_NAMES: Final = (
    *dict.fromkeys((*(layer for recipe in RECIPES for layer in recipe.layers), *WORKSPACE_LAYERS)),
    SERVICE_LAYER,
)
"""All template folders."""


def recipe_of(kind: Kind, language: Language = "py") -> Recipe | None:
    """The recipe of a kind in a language; None if it does not exist."""
    return next(
        (r for r in RECIPES if r.kind == kind and r.language in (language, None)),
        None,
    )


LONGEST_NAME = 40
"""obk's limit [characters]: the name is a folder, a module, an executable and part of a class."""

_OTHER_USE = frozenset("build conftest install log resource setup src test".split())
"""Names that workspaces and packages use for other files and folders."""

_SNAKE_CASE = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """A problem with the user's request, and how to fix it."""

    sentence: str
    help: str | None = None


def check_name(name: str, *, kind: str, owner_of: Callable[[str], str | None]) -> Problem | None:
    """Why `name` cannot be used for a package or node; None if it can.

    `kind` is used for suggestions ("class" -> "class_controller"); `owner_of` returns the owner of
    a name that is taken, as words after "is" ("a module of Python's standard library").

    Source: REP 144 (package names); PEP 8 (module names).
    """
    suggestion = suggest_name(name, kind=kind)
    if "/" in name or "\\" in name or ".." in name:
        sentence = f"the name `{name}` is a path, expected a name"
        return Problem(
            sentence=sentence, help=f"{_try(suggestion)}; choose the folder with --dest DIR"
        )
    reason = _shape_fault(name) or _use_fault(name, owner_of)
    if reason is None:
        return None
    return Problem(sentence=f"the name `{name}` {reason}", help=_try(suggestion))


def suggest_name(name: str, *, kind: str) -> str:
    """The nearest valid name: `FooBar` and `foo-bar` become `foo_bar`."""
    last = re.split(r"[/\\]", name.rstrip("/\\"))[-1]
    humps = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", last)
    words = re.findall(r"[a-z0-9]+", humps.lower())
    snake = "_".join(words).lstrip("0123456789_")
    if snake == name or len(snake) < 2 or keyword.iskeyword(snake) or snake in _OTHER_USE:
        snake = f"{snake}_{kind}" if snake else f"my_{kind}"
    return snake[:LONGEST_NAME].rstrip("_")


def _shape_fault(name: str) -> str | None:
    if not name:
        return "is empty"
    if len(name) > LONGEST_NAME:
        return f"has {len(name)} characters; expected at most {LONGEST_NAME}"
    if not _SNAKE_CASE.fullmatch(name):
        return (
            "is not lower snake case: expected a lowercase letter, then lowercase letters, digits "
            "and single underscores"
        )
    fault = package_name_fault(name) or node_name_fault(name)
    return f"is not valid in ROS: {fault}" if fault else None


def _use_fault(name: str, owner_of: Callable[[str], str | None]) -> str | None:
    if keyword.iskeyword(name):
        return "is a Python keyword"
    if name in _OTHER_USE:
        return "has another meaning in workspaces and packages"
    owner = owner_of(name)
    return f"is taken: it is {owner}" if owner else None


def _try(suggestion: str) -> str:
    return f"try `{suggestion}`"
