"""Policies: the terms of their observations, and networks in ONNX, run by onnxruntime."""

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

__all__ = [
    "COMMAND",
    "PREVIOUS_ACTION",
    "TERMS",
    "Network",
    "NetworkError",
    "has_onnxruntime",
    "observation_size",
]


COMMAND: Final = "command"
PREVIOUS_ACTION: Final = "previous_action"
_JOINT_TERMS: Final = ("joint_positions", "joint_velocities")
_BASE_TERMS: Final = ("linear_velocity", "angular_velocity", "gravity")
TERMS: Final = (*_JOINT_TERMS, *_BASE_TERMS, PREVIOUS_ACTION, COMMAND)
"""Possible terms in `OnnxPolicy`'s `observation` parameter."""
_DIMENSIONS: Final = 3


def observation_size(terms: Sequence[str], *, joints: int, actions: int) -> int:
    """Compute the number of values in an observation.

    Args:
        terms: terms from `TERMS`.
        joints: number of observed joints.
        actions: number of the network's outputs.
    """
    sizes = {
        **dict.fromkeys(_JOINT_TERMS, joints),
        **dict.fromkeys((*_BASE_TERMS, COMMAND), _DIMENSIONS),
        PREVIOUS_ACTION: actions,
    }
    return sum(sizes[term] for term in terms)


class NetworkError(Exception):
    """The file is not a usable network; the message gives the reason."""


def has_onnxruntime() -> bool:
    """Whether onnxruntime is installed; does not import it."""
    return importlib.util.find_spec("onnxruntime") is not None


class Network:
    """A network that runs on one CPU thread, so that equal inputs give bitwise equal outputs."""

    def __init__(self, path: Path) -> None:
        """Load a network.

        Raises:
            NetworkError: onnxruntime is not installed, or the file is not a usable network.
        """
        if not has_onnxruntime():
            raise NetworkError("a network needs onnxruntime; install `obelisk-cli[policy]`")
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        try:
            session = onnxruntime.InferenceSession(
                str(path), options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # the library's errors have no common base class
            reason = str(error).splitlines()[0].rpartition(":")[2].strip()
            raise NetworkError(f"`{path.name}` is not an ONNX network: {reason}") from error
        inputs, outputs = session.get_inputs(), session.get_outputs()
        if len(inputs) != 1 or len(outputs) != 1:
            raise NetworkError(
                f"the network `{path.name}` has {len(inputs)} inputs and {len(outputs)} outputs, "
                "expected one of each"
            )
        self._run, self._input = session.run, inputs[0].name
        self.inputs: int | None = _width(inputs[0].shape)
        """Length of an observation; None if the file does not specify it."""
        self.outputs: int | None = _width(outputs[0].shape)
        """Number of actions; None if the file does not specify it."""

    def __call__(self, observation: Any) -> Any:
        """Compute the outputs for an observation; arrays of shapes (inputs,) and (outputs,)."""
        row = observation.astype("float32")[None]
        return self._run(None, {self._input: row})[0].astype(float).ravel()


def _width(shape: Sequence[Any]) -> int | None:
    return shape[-1] if shape and isinstance(shape[-1], int) else None
