"""ROS 2 parameter files for `--params-file`.

Text is always in quotes, so that the ROS parser never reads `on` or `1e3` as another type.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from obelisk_spec.values import ParameterValue
from obelisk_spec.yaml_core import quoted_scalar

if TYPE_CHECKING:
    from obk_cli.plan.plan import PlannedNode

__all__ = ["emit_node_params", "emit_params", "emit_value", "params_file_name"]


def emit_params(nodes: "Iterable[PlannedNode]") -> str:
    """One parameter file for these nodes, keyed by their full names."""
    return "".join(emit_node_params(node.full_name, node.parameters) for node in nodes)


def emit_node_params(full_name: str, parameters: Mapping[str, ParameterValue]) -> str:
    """One node's part of a parameter file."""
    return "".join(_node_lines(full_name, parameters))


def params_file_name(node: "PlannedNode") -> str:
    """The file name for a node's parameters, such as `obelisk_control_0.yaml`."""
    return f"{node.full_name.strip('/').replace('/', '.')}.yaml"


def _node_lines(full_name: str, parameters: Mapping[str, ParameterValue]) -> Iterator[str]:
    if not parameters:
        yield f"{full_name}:\n  ros__parameters: {{}}\n"
        return
    yield f"{full_name}:\n  ros__parameters:\n"
    for name, value in parameters.items():
        yield f"    {_text(name)}: {emit_value(value)}\n"


def emit_value(value: ParameterValue) -> str:
    """A value in the syntax of parameter files."""
    if isinstance(value, tuple):
        return f"[{', '.join(emit_value(item) for item in value)}]"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    return _float(value) if isinstance(value, float) else str(value)


def _text(text: str) -> str:
    if '"' in text and "'" not in text and text.isprintable():
        return f"'{text}'"  # without escapes, so that JSON remains readable
    return quoted_scalar(text)


def _float(value: float) -> str:
    if math.isnan(value):
        return ".nan"
    if math.isinf(value):
        return ".inf" if value > 0 else "-.inf"
    return repr(value)
