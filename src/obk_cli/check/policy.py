"""OBK322: a policy's network against its parameters, and its joints against the model."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from obelisk_spec.policy import TERMS, observation_size
from obelisk_spec.suggestions import did_you_mean, with_number
from obk_cli.check.context import CheckContext
from obk_cli.config.environment import ModelRead, PolicyFault, PolicyRead
from obk_cli.config.model import ConfigParameter, Node
from obk_cli.diagnostics.diagnostic import Diagnostic, found

__all__ = ["check_policies"]

_NETWORK: Final = ".onnx"
_OBSERVATION: Final = "observation"
_JOINTS: Final = "joints"
_ACTION_JOINTS: Final = "action_joints"


def check_policies(context: CheckContext) -> Iterator[Diagnostic]:
    """Every node that has a network as `params_path`, and says what it observes."""
    for node in context.stack.nodes:
        parameters = {parameter.name: parameter for parameter in node.params}
        observation, joints = parameters.get(_OBSERVATION), parameters.get(_JOINTS)
        path = node.params_file.found if node.params_file is not None else None
        if path is None or path.suffix != _NETWORK or observation is None or joints is None:
            continue
        actions = parameters.get(_ACTION_JOINTS, joints)
        unknown = tuple(_unknown_terms(observation))
        yield from unknown
        for parameter in dict.fromkeys((joints, actions)):
            yield from _unknown_joints(parameter, context)
        if not unknown:
            yield from _check_lengths(path, node, observation, joints, actions, context)


def _words(parameter: ConfigParameter) -> Sequence[str]:
    value = parameter.value
    return [str(word) for word in value] if isinstance(value, list | tuple) else [str(value)]


def _unknown_terms(observation: ConfigParameter) -> Iterator[Diagnostic]:
    for term in _words(observation):
        if term not in TERMS:
            yield found(
                "OBK322",
                f"a policy cannot observe `{term}`",
                observation.span,
                help=did_you_mean(term, TERMS),
            )


def _unknown_joints(parameter: ConfigParameter, context: CheckContext) -> Iterator[Diagnostic]:
    """Joints that the model lacks, if the stack has one model that can be read."""
    models = {
        sim.model.found
        for node in context.stack.nodes
        for sim in node.used_sims
        if sim.model is not None and sim.model.found is not None
    }
    read = context.environment.read_model(models.pop()) if len(models) == 1 else None
    if not isinstance(read, ModelRead):
        return
    for name in _words(parameter):
        if name not in read.facts.joints:
            yield found(
                "OBK322",
                f"the model has no joint `{name}`",
                parameter.span,
                help=did_you_mean(name, read.facts.joints),
            )


def _check_lengths(
    path: Path,
    node: Node,
    observation: ConfigParameter,
    joints: ConfigParameter,
    actions: ConfigParameter,
    context: CheckContext,
) -> Iterator[Diagnostic]:
    read = context.environment.read_policy(path)
    if isinstance(read, PolicyFault):
        assert node.params_path is not None  # it was found
        yield found("OBK322", read.message, node.params_path.span)
    if not isinstance(read, PolicyRead):
        return
    joint_count, action_count = len(_words(joints)), len(_words(actions))
    size = observation_size(_words(observation), joints=joint_count, actions=action_count)
    if read.inputs is not None and read.inputs != size:
        yield found(
            "OBK322",
            f"`observation` has {with_number(size, 'value')} for "
            f"{with_number(joint_count, 'joint')}, "
            f"the network `{path.name}` takes {read.inputs}",
            observation.span,
            help="write the terms and joints that the network was trained with",
        )
    if read.outputs is not None and read.outputs != action_count:
        yield found(
            "OBK322",
            f"the network `{path.name}` returns {with_number(read.outputs, 'value')} for "
            f"{with_number(action_count, 'joint')}",
            actions.span,
            help=f"name the joints that it commands as `{_ACTION_JOINTS}`",
        )
