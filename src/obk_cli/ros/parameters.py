"""A node's parameters over its services: their names, values, types, and setting them.

Source: rcl_interfaces/srv.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from obk_cli.ros.parameter_values import KINDS, NOT_SET, NodeParameter
from obk_cli.ros.participant import RosLook
from obk_cli.ros.services import ServiceClient
from obk_cli.ros.types import find_type

__all__ = ["MODULES", "NodeParameters"]

PACKAGE: Final = "rcl_interfaces"
MODULES: Final = ("rosidl_generator_py", f"{PACKAGE}.msg", f"{PACKAGE}.srv")
"""What is imported before a node can be asked."""


class NodeParameters:
    """The parameters of one node; every question has the same deadline."""

    def __init__(self, look: RosLook, node: str, timeout_s: float) -> None:
        """Ask nothing yet.

        Args:
            look: whose participant asks.
            node: full name.
            timeout_s: for each answer [s].
        """
        self._look = look
        self._node = node
        self._timeout_s = timeout_s

    def names(self) -> tuple[str, ...]:
        """The names of all.

        Raises:
            CommandFailedError: the node gives no answer.
        """
        response = self._ask("ListParameters", "list_parameters", depth=0)
        return tuple(sorted(response.result.names))

    def values(self, names: Sequence[str]) -> Mapping[str, NodeParameter]:
        """The values of these; `not set` where the node has none of that name.

        Raises:
            CommandFailedError: the node gives no answer.
        """
        told = self._told(names)
        if len(told) != len(names):
            # Where one has no value, rclpy's nodes tell of none; so each is asked for.
            told = [next(iter(self._told([name])), None) for name in names]
        return {name: _parameter(value) for name, value in zip(names, told, strict=True)}

    def declared_kind(self, name: str) -> str:
        """The type that a parameter is declared with, also where it has no value.

        Raises:
            CommandFailedError: the node gives no answer.
        """
        response = self._ask("DescribeParameters", "describe_parameters", names=[name])
        return next((KINDS[one.type] for one in response.descriptors), NOT_SET)

    def set(self, name: str, parameter: NodeParameter) -> str | None:
        """Set one; gives the node's reason where it refuses.

        Raises:
            CommandFailedError: the node gives no answer.
        """
        client = self._client("SetParameters", "set_parameters")
        message = find_type(f"{PACKAGE}/msg/Parameter")(name=name)
        message.value.type = KINDS.index(parameter.kind)
        if parameter.kind != NOT_SET:
            setattr(message.value, f"{parameter.kind}_value", _for_message(parameter))
        request = find_type(f"{PACKAGE}/srv/SetParameters").Request(parameters=[message])
        result = client.call(request, self._timeout_s).results[0]
        return None if result.successful else str(result.reason) or "it gave no reason"

    def _told(self, names: Sequence[str]) -> Sequence[Any]:
        response = self._ask("GetParameters", "get_parameters", names=list(names))
        values: Sequence[Any] = response.values
        return values

    def _ask(self, kind: str, service: str, **fields: Any) -> Any:
        request = find_type(f"{PACKAGE}/srv/{kind}").Request(**fields)
        return self._client(kind, service).call(request, self._timeout_s, is_question=True)

    def _client(self, kind: str, service: str) -> ServiceClient:
        python_type = find_type(f"{PACKAGE}/srv/{kind}")
        return ServiceClient(self._look, f"{self._node}/{service}", python_type)


def _parameter(message: Any) -> NodeParameter:
    kind = KINDS[message.type] if message is not None else NOT_SET
    if kind == NOT_SET:
        return NodeParameter(kind=kind, value=None)
    value = getattr(message, f"{kind}_value")
    if kind == "byte_array":
        return NodeParameter(kind=kind, value=tuple(byte[0] for byte in value))
    return NodeParameter(kind=kind, value=tuple(value) if kind.endswith("_array") else value)


def _for_message(parameter: NodeParameter) -> Any:
    if not isinstance(parameter.value, tuple):
        return parameter.value
    if parameter.kind == "byte_array":
        return [bytes([int(byte)]) for byte in parameter.value]
    return list(parameter.value)
