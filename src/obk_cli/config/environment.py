"""What the stages may ask of the world around a config, as types: packages, models, their lines.

The adapters answer; tests answer with tables. Looks at nothing itself.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from obelisk_spec.components import SETTING_SUFFIX, component_identity, component_spellings
from obelisk_spec.model import ModelFacts
from obelisk_spec.parameter_notes import ParameterNotes
from obelisk_spec.suggestions import list_names
from obk_cli.config.model import Component, ComponentKind
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import Span

__all__ = [
    "UNSEARCHED",
    "CodeComponent",
    "CodeFault",
    "CodeParameter",
    "Command",
    "ControlLength",
    "Environment",
    "ExecutableMissing",
    "KeyUse",
    "MissingMethod",
    "ModelFault",
    "ModelRead",
    "NodeCode",
    "NodeFacts",
    "PolicyFault",
    "PolicyRead",
    "SourceFaults",
    "kind_of_value",
]


UNSEARCHED = ("build", "install", "log")
"""Folders of a workspace into which building writes: what is in them is a copy."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """How an executable is started: the arguments, and what must be in the environment."""

    arguments: tuple[str, ...]
    python_path: tuple[Path, ...] = ()
    """Folders to put in front of PYTHONPATH."""
    found_in: str
    """For a person: where it was found."""
    module: str | None = None
    """The Python module that holds what is run, where that is known."""
    function: str | None = None
    """The function of `module` that is called; None for a module that is run as a program."""

    @property
    def is_of_this_python(self) -> bool:
        """Whether it is Python that this interpreter runs, or installed in its environment."""
        if self.module is None:
            return False
        program = Path(self.arguments[0])
        return program == Path(sys.executable) or program.is_relative_to(sys.prefix)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExecutableMissing:
    """An executable that is nowhere, and what was looked through."""

    package: str
    executable: str
    package_found: bool
    searched: tuple[str, ...]
    available: tuple[str, ...] = ()
    """Executables that the package does have."""
    not_executable: Path | None = None
    """A file of that name without the execute bit."""
    declared_in: Path | None = None
    """The CMakeLists.txt that declares it; it is not built."""
    unsourced: Path | None = None
    """The file of that name in an `install` folder of the workspace that is not sourced."""
    left_out: Path | None = None
    """A folder with a package of that name, within one that is not searched."""

    @property
    def looked(self) -> str:
        """The help for a package that is not found: where it was searched."""
        searched = f"searched {', '.join(self.searched)}"
        if self.left_out is None:
            return searched
        return (
            f"it exists in {self.left_out}, but folders named {list_names(UNSEARCHED)} are not "
            f"searched: move it, or source the workspace if it is installed there; {searched}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelRead:
    """A model that could be read."""

    facts: ModelFacts
    referenced_files: tuple[tuple[str, str], ...] = ()
    """Meshes, textures, ..., each by its path under its folder and by its path as written."""
    missing_files: tuple[str, ...] = ()
    """Those that are not at the path in the model."""
    fault: "ModelFault | None" = None
    """Why MuJoCo cannot compile it; None if files are missing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFault:
    """A model that cannot be read; `line` counts from 1, None where none is named."""

    message: str
    line: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyRead:
    """A network that could be read; None: its file leaves a length open."""

    inputs: int | None
    outputs: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyFault:
    """Why a network cannot be read."""

    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplacedMessages:
    """A package of the workspace in the place of one of Obelisk's, and what it lacks."""

    package: str
    folder: Path
    types: tuple[str, ...]
    """Messages that it does not have."""
    fields: tuple[str, ...]
    """Fields that its messages do not have, `TrueSimState.y`."""


class Environment(Protocol):
    """The questions."""

    def find_package_share(self, name: str) -> Path | None:
        """The folder that holds a package's data, None if there is no such package."""

    def manifest_fault(self, package: str) -> "CodeFault | None":
        """Why the package.xml of a package in source cannot be read; None if it can."""

    def package_names(self) -> tuple[str, ...]:
        """Every package that is there."""

    def message_packages(self) -> tuple[str, ...]:
        """The packages of the workspace that define messages."""

    def message_names(self, package: str) -> tuple[str, ...] | None:
        """The messages that a package defines, None if there is no such package."""

    def replaced_messages(self) -> "tuple[ReplacedMessages, ...]":
        """The packages of the workspace that have the name of one of Obelisk's, and lack some."""

    def find_executable(self, package: str, executable: str) -> Command | ExecutableMissing:
        """How an executable is started."""

    def read_node_code(self, package: str, executable: str) -> "NodeCode | None":
        """What the Python source of an executable defines, None if that cannot be known."""

    def read_hazards(self, package: str, executable: str) -> tuple[Diagnostic, ...]:
        """What in the source of an executable may differ between two lock-step runs."""

    def is_cpp(self, package: str, executable: str) -> bool:
        """Whether an executable is in C++, as far as that can be known."""

    def read_model(self, path: Path) -> ModelRead | ModelFault | None:
        """The facts of a model, None where MuJoCo is not installed."""

    def read_policy(self, path: Path) -> PolicyRead | PolicyFault | None:
        """The lengths of a network, None where onnxruntime is not installed."""

    def model_line(self, path: Path, line: int) -> Span:
        """A whole line of a model file."""

    def model_element(self, path: Path, kind: str, name: str) -> Span | None:
        """Where a model defines an element of that kind and name."""


_KINDS: Final = {bool: "bool", int: "int", float: "float", str: "text"}


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeComponent:
    """One `register_obk_...` call."""

    kind: ComponentKind
    ros_parameter: str | None
    key: str | None
    msg_type: str | None
    """Full, None where the config decides or the code computes it."""
    has_type: bool
    """Whether the code gives a message type, or may give one that is computed."""
    is_required: bool
    """Whether configure fails without settings; False too where that is not known."""
    is_optional: bool
    """Whether the code marks it as optional."""
    has_default: bool
    """Whether the code brings settings of its own."""
    is_named_in_full: bool
    """Whether both names are known; else the config may use one that is computed."""
    is_of_library: bool
    """Whether a base class of the run-time library registers it."""
    has_typed_base: bool = False
    """Whether that base class received message types, as since the second API generation."""
    span: Span
    """The line of the call."""

    @property
    def names(self) -> frozenset[str]:
        """Every spelling under which the config may name it."""
        given = (name for name in (self.ros_parameter, self.key) if name)
        return frozenset(spelling for name in given for spelling in component_spellings(name))

    @property
    def name(self) -> str:
        """What the code calls it: the ROS parameter, else the key."""
        return self.ros_parameter or self.key or ""

    @property
    def written(self) -> tuple[str, str]:
        """How a config names it: `key` with its key, else `ros_parameter` with that."""
        if self.ros_parameter is None or self.ros_parameter.endswith(SETTING_SUFFIX):
            return "key", component_identity(self.name)
        return ("key", self.key) if self.key else ("ros_parameter", self.ros_parameter)


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeParameter:
    """A ROS parameter that the code declares."""

    name: str
    kind: str | None
    """As `kind_of_value` has it, None where the code takes any or computes it."""
    span: Span
    """The line of the call."""
    notes: ParameterNotes | None = None
    """Limits and unit; None unless it is declared with `Parameter`."""


def kind_of_value(value: object) -> str | None:
    """Of which kind a parameter with this value is, `float` or `list of ints`; None: of none."""
    if isinstance(value, list | tuple):
        kinds = {_KINDS.get(type(item)) for item in value}
        kind = kinds.pop() if len(kinds) == 1 else None
        return f"list of {kind}s" if kind else None
    return _KINDS.get(type(value))


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingMethod:
    """An abstract method that the class leaves out."""

    name: str
    span: Span
    """Where it is declared."""
    near: tuple[str, ...] = ()
    """Methods of the class that look like it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlLength:
    """How many controls the code writes into a control message."""

    field: str
    length: int
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyUse:
    """A component that a method looks up: `self.obk_publishers["pub_ctrl"]`."""

    kind: ComponentKind
    key: str
    span: Span
    """The key."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeFacts:
    """The class that an executable spins."""

    class_name: str
    span: Span
    """The `class` line."""
    components: tuple[CodeComponent, ...]
    parameters: tuple[CodeParameter, ...]
    """The ROS parameters that it declares itself, each once."""
    knows_components: bool
    """Whether `components` is all there can be."""
    knows_parameters: bool
    """Whether `parameters` is all there can be."""
    missing_methods: tuple[MissingMethod, ...] = ()
    control_lengths: tuple[ControlLength, ...] = ()
    key_uses: tuple[KeyUse, ...] = ()
    findings: tuple[Diagnostic, ...] = ()
    """What is wrong in the source whatever the config contains."""
    can_damp: bool | None = None
    """Whether a robot implements `apply_damping`; None for other nodes, or if unknown."""

    def component_of(self, component: Component) -> CodeComponent | None:
        """What the code registers for a component of the config."""
        written = {name.value for name in (component.ros_parameter, component.key) if name}
        same_kind = (c for c in self.components if c.kind == component.kind)
        return next((c for c in same_kind if not written.isdisjoint(c.names)), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeFault:
    """Source that cannot be read as a node."""

    message: str
    """Of the source: "is not Python: ..."."""
    place: str
    """The file, for the sentence."""
    span: Span | None = None
    help: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceFaults:
    """Source whose node class is unknown, and what is wrong in it."""

    findings: tuple[Diagnostic, ...]


NodeCode = NodeFacts | CodeFault | SourceFaults
"""What reading the source of an executable can give."""
