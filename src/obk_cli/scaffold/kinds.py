"""What can be made, in which languages, and from which template folders.

In: a kind and a language. Out: names of template folders, the section of a config. Never looks at
the disk.
"""

from dataclasses import dataclass
from typing import Final, Literal

__all__ = [
    "LAYER_NAMES",
    "NODE_KINDS",
    "PACKAGE_OF_WORKSPACE_LAYERS",
    "RECIPES",
    "SECTIONS",
    "SERVICE_LAYER",
    "WORKSPACE_LAYER",
    "WORKSPACE_LAYERS",
    "Kind",
    "Language",
    "Recipe",
    "recipe_of",
]

Kind = Literal["controller", "estimator", "robot", "sensor", "msgs", "config"]
Language = Literal["py", "cpp"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """One thing that `obk new` makes."""

    kind: Kind
    language: Language | None
    """None for what is in no programming language."""
    layers: tuple[str, ...]
    """Template folders; of two files with one name the later folder's wins."""
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
        summary="sensor messages from a device beside the robot",
    ),
    Recipe(
        kind="msgs",
        language=None,
        layers=("msgs",),
        summary="message and service types of your own",
    ),
    Recipe(
        kind="config", language=None, layers=("config",), summary="a stack of the workspace's nodes"
    ),
)
"""All of them, in the order of the help."""

NODE_KINDS: Final = ("controller", "estimator", "robot", "sensor")

SECTIONS: Final = {
    "controller": "control",
    "estimator": "estimation",
    "robot": "robot",
    "sensor": "sensing",
}
"""The section of the config that a kind of node belongs to."""

SERVICE_LAYER: Final = "msgs_srv"
"""On top of `msgs` where a service is asked for."""

WORKSPACE_LAYER: Final = "workspace"
"""What `obk init` makes around its packages."""

PACKAGE_OF_WORKSPACE_LAYERS: Final[dict[Kind, tuple[str, ...]]] = {
    "controller": ("package_py", "controller_py", "workspace_package", "workspace_controller"),
    "estimator": ("package_py", "estimator_py", "workspace_package"),
}
"""What its packages are made of."""

WORKSPACE_LAYERS: Final = (
    WORKSPACE_LAYER,
    *dict.fromkeys(layer for layers in PACKAGE_OF_WORKSPACE_LAYERS.values() for layer in layers),
)
"""All template folders that `obk init` reads."""

LAYER_NAMES: Final = (
    *dict.fromkeys((*(layer for recipe in RECIPES for layer in recipe.layers), *WORKSPACE_LAYERS)),
    SERVICE_LAYER,
)
"""Every template folder that there is."""


def recipe_of(kind: Kind, language: Language = "py") -> Recipe | None:
    """How a kind is made in a language, None where it is not."""
    return next(
        (r for r in RECIPES if r.kind == kind and r.language in (language, None)),
        None,
    )
