"""Controllers that run a trained network."""

from obelisk_py.zoo.control.policy.onnx_policy import ActionKind, OnnxPolicy

__all__ = ["ActionKind", "OnnxPolicy"]
