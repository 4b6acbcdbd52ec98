"""`OnnxPolicy`: its observations, its commands, and networks that it rejects."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from obelisk_control_msgs.msg import PDFeedForward
from obelisk_estimator_msgs.msg import EstimatedState
from rclpy.parameter import Parameter

from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError
from obelisk_py.zoo.control.policy import OnnxPolicy
from obelisk_spec.onnx_policy import Network

from .world import World

pytestmark = pytest.mark.ros

ROOT = Path(__file__).parents[2]
NETWORK = ROOT / "examples/cartpole/policy/balance.onnx"
BASE = {"q_base": [0.0, 0.0, 0.3, 0.0, 0.5**0.5, 0.0, 0.5**0.5], "v_base": [1.0, 0, 0, 0, 0, 0.5]}
"""A base turned by 90 degrees about y: its x axis points down."""
JOINTS = {"joint_names": ["b", "a"], "q_joints": [2.0, 1.0], "v_joints": [20.0, 10.0]}


def policy(world: World, **parameters: Any) -> OnnxPolicy:
    """An active policy of two joints, with some parameters changed."""
    given = {
        "params_path": str(NETWORK),
        "observation": ["joint_positions", "joint_velocities"],
        "joints": ["a", "b"],
        "action_joints": ["a"],
        "pub_ctrl_setting": "topic:/ctrl,msg_type:PDFeedForward",
        "sub_est_setting": "topic:/est",
        "timer_ctrl_setting": "timer_period_sec:0.01",
        **parameters,
    }
    overrides = [Parameter(name, value=value) for name, value in given.items()]
    node: OnnxPolicy = world.node(
        "policy", lambda name: OnnxPolicy(name, parameter_overrides=overrides)
    )
    return node


def test_joints_are_in_the_order_of_the_network(world: World) -> None:
    node = policy(world, default_pose=[0.5, 0.0], observation_scales=[1.0, 0.1])
    assert node.observe(EstimatedState(**JOINTS)).tolist() == [0.5, 2.0, 1.0, 2.0]


def test_the_base_is_observed_in_its_own_frame(world: World) -> None:
    node = policy(world)
    node.terms, node.scales = ["gravity", "linear_velocity", "angular_velocity"], [1.0] * 3
    observed = node.observe(EstimatedState(**JOINTS, **BASE))
    assert observed == pytest.approx([1, 0, 0, 0, 0, 1, 0, 0, 0.5], abs=1e-12)


def test_an_estimate_without_an_observed_field_is_an_error(world: World) -> None:
    node = policy(world)
    with pytest.raises(ObeliskError, match="no joint a, b"):
        node.observe(EstimatedState(joint_names=["c"], q_joints=[0.0], v_joints=[0.0]))
    node.terms = ["gravity"]
    with pytest.raises(ObeliskError, match="base"):
        node.observe(EstimatedState(**JOINTS))


@pytest.mark.parametrize(
    ("kind", "target", "effort"), [("position", 0.5, 0.0), ("effort", 0.0, 20.0)]
)
def test_an_action_is_clipped_then_scaled(
    world: World, kind: str, target: float, effort: float
) -> None:
    node = policy(
        world,
        action_kind=kind,
        action_scale=[20.0],
        default_pose=[-19.5, 0.0],
        action_clip=1.0,
        kp=[3.0],
    )
    node.network = lambda _observation: np.array([5.0])
    node.update_x_hat(EstimatedState(**JOINTS))
    msg = node.compute_control()
    assert isinstance(msg, PDFeedForward)
    assert list(msg.joint_names) == ["a"]
    assert (msg.pos_target[0], msg.feed_forward[0], msg.kp[0]) == (target, effort, 3.0)


def test_no_command_is_published_that_is_not_finite(world: World) -> None:
    node = policy(world)
    node.network = lambda _observation: np.array([np.nan])
    node.update_x_hat(EstimatedState(**JOINTS))
    with pytest.raises(ObeliskError, match="nan"):
        node.compute_control()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"observation": ["joint_positions"]}, "has 4 numbers, expected 2 from the parameters"),
        ({"action_joints": ["a", "b"]}, "has 1 numbers, expected 2 from the parameters"),
        ({"observation": ["joint_position"]}, "joint_positions"),
        ({"observation_scales": [1.0]}, "1 values"),
        ({"joints": ["a"]}, "has 4 numbers, expected 2 from the parameters"),
        ({"params_path": __file__}, "not an ONNX network"),
        ({"default_pose": [0.0] * 3}, "`default_pose` has 3 values, expected 1 or 2"),
        ({"action_scale": [1.0, 2.0]}, "`action_scale` has 2 values, expected 1"),
        ({"kp": [1.0, 2.0]}, "`kp` has 2 values, expected 1"),
    ],
)
def test_parameters_that_do_not_match_the_network_are_rejected(
    world: World, parameters: dict[str, Any], message: str
) -> None:
    node = policy(world)
    node.trigger_deactivate()
    node.trigger_cleanup()
    node.set_parameters([Parameter(name, value=value) for name, value in parameters.items()])
    with pytest.raises(ObeliskConfigError, match=message):
        OnnxPolicy.on_configure(node, None)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("default_pose", [0.0] * 3, "`default_pose` has 3 values, expected 1 or 2"),
        ("action_scale", [1.0, 2.0], "`action_scale` has 2 values, expected 1"),
        ("kd", [], "`kd` has 0 values, expected 1"),
        (
            "observation_scales",
            [1.0],
            "`observation_scales` is read during the `configure` transition",
        ),
        ("joints", ["a"], "`joints` is read during the"),
    ],
)
def test_lists_of_wrong_lengths_are_rejected_while_the_policy_runs(
    world: World, name: str, value: list[Any], reason: str
) -> None:
    node = policy(world)
    kind = None if value else Parameter.Type.DOUBLE_ARRAY
    (result,) = node.set_parameters([Parameter(name, kind, value)])
    assert not result.successful
    assert reason in result.reason
    (result,) = node.set_parameters([Parameter("default_pose", value=[0.25, 0.5])])
    assert result.successful
    node.update_x_hat(EstimatedState(**JOINTS))
    assert node.compute_control() is not None
    assert node.default_pose == [0.25, 0.5]


def test_the_network_is_that_of_the_training() -> None:
    network = Network(NETWORK)
    assert (network.inputs, network.outputs) == (4, 1)
    left, right = network(np.array([0, 0.1, 0, 0])), network(np.array([0, -0.1, 0, 0]))
    assert left[0] > 0 > right[0]  # the cart follows the pole
