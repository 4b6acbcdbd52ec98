"""A node's `params`: ROS parameters of the user's own, nested names joined by dots."""

from collections.abc import Iterator

from obelisk_spec.values import ParameterValue
from obelisk_spec.yaml_core import Scalar
from obk_cli.config import Parameter
from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.read.fields import Faults
from obk_cli.tree import Tree, TreeList, TreeMap, TreeScalar, kind_of

__all__ = ["read_params"]

_HOLDS = "a ROS parameter holds a bool, int, float, text or a list of one of these"
_INT64 = range(-(2**63), 2**63)


def read_params(tree: TreeMap | None, faults: Faults) -> tuple[Parameter, ...]:
    """The parameters of a `params` mapping; those that ROS cannot hold become findings."""
    by_name: dict[str, Parameter] = {}
    for parameter in _read_map(tree, "", faults) if tree else ():
        first = by_name.setdefault(parameter.name, parameter)
        if first is not parameter:
            faults.append(_given_twice(parameter, first))
    return tuple(by_name.values())


def _given_twice(parameter: Parameter, first: Parameter) -> Diagnostic:
    """`a.b: 1` and `a: {b: 1}` are one name."""
    return found(
        "OBK004",
        f"parameter `{parameter.name}` is given twice",
        parameter.key_span or parameter.span,
        related=(Related(message="the first time", span=first.key_span or first.span),),
    )


def _read_map(tree: TreeMap, prefix: str, faults: Faults) -> Iterator[Parameter]:
    for entry in tree:
        name = prefix + entry.key
        if isinstance(entry.value, TreeMap):
            yield from _read_map(entry.value, f"{name}.", faults)
            continue
        value = _read_value(name, entry.value, faults)
        if value is not None:
            yield Parameter(name=name, value=value, span=entry.value.span, key_span=entry.key_span)


def _read_value(name: str, tree: Tree, faults: Faults) -> ParameterValue | None:
    if isinstance(tree, TreeList):
        return _read_list(name, tree, faults)
    if isinstance(tree, TreeScalar) and tree.value is not None and _fits(tree.value):
        return tree.value
    message = f"parameter `{name}` is {kind_of(tree)}, which ROS cannot hold"
    faults.append(found("OBK113", message, tree.span, help=_HOLDS))
    return None


def _fits(value: Scalar) -> bool:
    """Whether the value fits ROS's 64 bits; all but huge integers do."""
    return isinstance(value, bool) or not isinstance(value, int) or value in _INT64


def _read_list(name: str, tree: TreeList, faults: Faults) -> ParameterValue | None:
    if not tree.items:
        message = f"parameter `{name}` is an empty list, whose type ROS cannot know"
        faults.append(found("OBK113", message, tree.span, help="leave the parameter out"))
        return None
    values: list[Scalar] = []
    for item in tree.items:
        if not isinstance(item, TreeScalar) or item.value is None or not _fits(item.value):
            what = (
                "an empty item"
                if isinstance(item, TreeScalar) and item.value is None
                else kind_of(item)
            )
            message = f"parameter `{name}` is a list with {what} in it"
            faults.append(found("OBK113", message, item.span, help=_HOLDS))
            return None
        values.append(item.value)
    return _of_one_kind(name, values, tree, faults)


def _of_one_kind(
    name: str, values: list[Scalar], tree: TreeList, faults: Faults
) -> ParameterValue | None:
    kinds = {type(value) for value in values}
    if kinds == {int, float}:
        message = f"parameter `{name}` mixes int and float, it is read as floats"
        faults.append(found("OBK505", message, tree.span))
        return tuple(float(value) for value in values if isinstance(value, int | float))
    if len(kinds) > 1:
        mixed = " and ".join(sorted(kind.__name__ for kind in kinds))
        message = f"parameter `{name}` is a list that mixes {mixed}"
        faults.append(found("OBK113", message, tree.span, help=_HOLDS))
        return None
    one_kind: ParameterValue = tuple(values)  # type: ignore[assignment]  # all of one type
    return one_kind
