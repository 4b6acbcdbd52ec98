"""Types for what the stages look up outside a config: packages, models, their lines.

`workspace.environment` looks things up on this machine; tests use tables. This module reads
nothing.
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
    "ReplacedMessages",
    "SourceFaults",
    "kind_of_value",
]


UNSEARCHED = ("build", "install", "log")
"""Build folders of a workspace; they contain copies."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """How to start an executable: its arguments and environment."""

    arguments: tuple[str, ...]
    python_path: tuple[Path, ...] = ()
    """Folders to put in front of PYTHONPATH."""
    module: str | None = None
    """The Python module that is run, if known."""
    function: str | None = None
    """The function of `module` that is called; None if the module is run as a program."""

    @property
    def program(self) -> Path:
        """The file that is run, if no module is known."""
        return Path(self.arguments[-1])

    @property
    def is_of_this_python(self) -> bool:
        """Whether it is Python, run by this interpreter or installed in its environment."""
        if self.module is None:
            return False
        program = Path(self.arguments[0])
        return program == Path(sys.executable) or program.is_relative_to(sys.prefix)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExecutableMissing:
    """An executable that was not found, and where it was searched."""

    package: str
    executable: str
    package_found: bool
    searched: tuple[str, ...]
    available: tuple[str, ...] = ()
    """Executables that the package has or declares."""
    not_executable: Path | None = None
    """A file with that name, but without the execute bit."""
    declared_in: Path | None = None
    """The CMakeLists.txt that declares it, if it is not built."""
    computed_in: Path | None = None
    """The setup.py or CMakeLists.txt that computes names of executables, if it is not built."""
    is_of_cmake: bool = False
    """Whether the package has a CMakeLists.txt."""
    unsourced: Path | None = None
    """The file in an `install` folder of the workspace, if that is not sourced."""
    left_out: Path | None = None
    """A folder with a package of that name, inside a folder that is not searched."""

    @property
    def looked(self) -> str:
        """The help for a missing package: where it was searched."""
        searched = f"searched {', '.join(self.searched)}"
        if self.left_out is None:
            return searched
        return (
            f"it exists in {self.left_out}, but folders named {list_names(UNSEARCHED)} are not "
            f"searched: move it, or source the workspace if it is installed there; {searched}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelRead:
    """A model that was read."""

    facts: ModelFacts
    referenced_files: tuple[tuple[str, str], ...] = ()
    """Meshes, textures and so on: path below the folder, and path as written."""
    missing_files: tuple[str, ...] = ()
    """Referenced files that do not exist at the path in the model."""
    fault: "ModelFault | None" = None
    """Why MuJoCo cannot compile it; None if files are missing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFault:
    """A model that cannot be read; `line` counts from 1, or is None if unknown."""

    message: str
    line: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyRead:
    """A network that was read; None for a size that its file leaves open."""

    inputs: int | None
    outputs: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyFault:
    """Why a network cannot be read."""

    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplacedMessages:
    """A workspace package that replaces one of Obelisk's, and what it lacks."""

    package: str
    folder: Path
    types: tuple[str, ...]
    """Missing messages."""
    fields: tuple[str, ...]
    """Missing fields of its messages, `TrueSimState.y`."""


class Environment(Protocol):
    """Lookups outside the config."""

    def find_package_share(self, name: str) -> Path | None:
        """The folder with a package's data; None if the package does not exist."""

    def manifest_fault(self, package: str) -> "CodeFault | None":
        """Why the package.xml of a source package cannot be read; None if it can."""

    def package_names(self) -> tuple[str, ...]:
        """The names of all packages."""

    def message_packages(self) -> tuple[str, ...]:
        """The packages of the workspace that define messages."""

    def message_names(self, package: str) -> tuple[str, ...] | None:
        """The messages that a package defines; None if the package does not exist."""

    def replaced_messages(self) -> "tuple[ReplacedMessages, ...]":
        """The workspace packages that replace one of Obelisk's and lack messages or fields."""

    def find_executable(self, package: str, executable: str) -> Command | ExecutableMissing:
        """How to start an executable."""

    def read_node_code(self, package: str, executable: str) -> "NodeCode | None":
        """What the Python source of an executable defines; None if it cannot be read."""

    def read_hazards(self, package: str, executable: str) -> tuple[Diagnostic, ...]:
        """Code of an executable that may behave differently between two lockstep runs."""

    def is_cpp(self, package: str, executable: str) -> bool:
        """Whether an executable is written in C++, as far as known."""

    def read_model(self, path: Path) -> ModelRead | ModelFault | None:
        """Facts about a model; None if MuJoCo is not installed."""

    def read_policy(self, path: Path) -> PolicyRead | PolicyFault | None:
        """The input and output sizes of a network; None if onnxruntime is not installed."""

    def model_line(self, path: Path, line: int) -> Span:
        """A whole line of a model file."""

    def model_element(self, path: Path, kind: str, name: str) -> Span | None:
        """The location where a model defines this element."""


_KINDS: Final = {bool: "bool", int: "int", float: "float", str: "string"}


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeComponent:
    """One `register_obk_...` call."""

    kind: ComponentKind
    ros_parameter: str | None
    key: str | None
    msg_type: str | None
    """Full name; None if the config determines it or the code computes it."""
    has_type: bool
    """Whether the code passes a message type, possibly a computed one."""
    is_required: bool
    """Whether `configure` fails without settings; False if unknown."""
    is_optional: bool
    """Whether the code marks it as optional."""
    has_default: bool
    """Whether the code has default settings."""
    is_named_in_full: bool
    """Whether both names are known; otherwise the config may use a computed one."""
    is_of_library: bool
    """Whether a base class of the runtime library registers it."""
    given_type: Span | None = None
    """Where the user's class passes the message type to the base class that registers it."""
    has_typed_base: bool = False
    """Whether that base class is given message types, as since API generation 2."""
    wrong_callback: Diagnostic | None = None
    """The finding in its callback, which applies only if the component is created."""
    span: Span
    """The line of the call."""

    @property
    def names(self) -> frozenset[str]:
        """All names by which the config may refer to it."""
        given = (name for name in (self.ros_parameter, self.key) if name)
        return frozenset(spelling for name in given for spelling in component_spellings(name))

    @property
    def name(self) -> str:
        """Its name in the code: the ROS parameter, otherwise the key."""
        return self.ros_parameter or self.key or ""

    @property
    def written(self) -> tuple[str, str]:
        """How a config names it: `key` with its key, otherwise `ros_parameter` with its name."""
        if self.ros_parameter is None or self.ros_parameter.endswith(SETTING_SUFFIX):
            return "key", component_identity(self.name)
        return ("key", self.key) if self.key else ("ros_parameter", self.ros_parameter)


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeParameter:
    """A ROS parameter that the code declares."""

    name: str
    kind: str | None
    """As in `kind_of_value`; None if the code accepts any or computes it."""
    span: Span
    """The line of the call."""
    notes: ParameterNotes | None = None
    """Limits and unit; None unless declared with `Parameter`."""


def kind_of_value(value: object) -> str | None:
    """The kind of a parameter with this value, `float` or `list of ints`; None if it has none."""
    if isinstance(value, list | tuple):
        kinds = {_KINDS.get(type(item)) for item in value}
        kind = kinds.pop() if len(kinds) == 1 else None
        return f"list of {kind}s" if kind else None
    return _KINDS.get(type(value))


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingMethod:
    """An abstract method that the class does not implement."""

    name: str
    span: Span
    """Where it is declared."""
    near: tuple[str, ...] = ()
    """Methods of the class with similar names."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlLength:
    """Number of controls that the code writes into a control message."""

    field: str
    length: int
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyUse:
    """A component that a method uses: `self.obk_publishers["pub_ctrl"]`."""

    kind: ComponentKind
    key: str
    span: Span
    """The key."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeFacts:
    """The node class that an executable runs."""

    class_name: str
    span: Span
    """The `class` line."""
    components: tuple[CodeComponent, ...]
    parameters: tuple[CodeParameter, ...]
    """The ROS parameters that it declares itself, each once."""
    knows_components: bool
    """Whether `components` is complete."""
    knows_parameters: bool
    """Whether `parameters` is complete."""
    missing_methods: tuple[MissingMethod, ...] = ()
    control_lengths: tuple[ControlLength, ...] = ()
    key_uses: tuple[KeyUse, ...] = ()
    findings: tuple[Diagnostic, ...] = ()
    """Findings in the source that do not depend on the config."""
    can_damp: bool | None = None
    """Whether a robot implements `apply_damping`; None for other nodes, or if unknown."""
    words: frozenset[str] = frozenset()
    """Attributes and strings in the node's own classes."""
    is_run_by_library: bool = True
    """Whether `spin_obelisk` creates and runs the node."""

    def component_of(self, component: Component) -> CodeComponent | None:
        """The registration in the code for a component of the config."""
        written = {name.value for name in (component.ros_parameter, component.key) if name}
        same_kind = (c for c in self.components if c.kind == component.kind)
        return next((c for c in same_kind if not written.isdisjoint(c.names)), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeFault:
    """Source that cannot be read as a node."""

    message: str
    """A predicate for the source: "is not valid Python: ..."."""
    place: str
    """The file, as the subject of the sentence."""
    span: Span | None = None
    help: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceFaults:
    """Source whose node class is unknown, and findings in it."""

    findings: tuple[Diagnostic, ...]


NodeCode = NodeFacts | CodeFault | SourceFaults
"""Possible results of reading the source of an executable."""
