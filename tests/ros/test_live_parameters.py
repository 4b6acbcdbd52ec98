"""`Parameter`: declared once, read as an attribute, and changed between two callbacks."""

import gc
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from enum import Enum
from typing import Any

import pytest
import rclpy
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import SetParameters
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.parameter import Parameter as RosParameter
from rclpy.task import Future

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.executor import EventLoopExecutor
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.parameter import Parameter, parameters_of

from .stack import eventually, obk, parameters, request, spinning
from .test_parameters import ask, message, set_each, set_together

pytestmark = pytest.mark.ros

IN_EFFECT = "in effect"
STORED = "stored; takes effect at the next `configure` transition"
WAITS = "accepted; takes effect when no callback of the node is running"


class Gait(Enum):
    WALK = "walk"
    STAND = "stand"


class Level(Enum):
    LOW = 1
    HIGH = 2


class Tuned(ObeliskNode):
    """Has a parameter of each type, and records changes."""

    kp = Parameter(20.0, ge=0.0, le=200.0, unit="N m/rad", description="proportional gain")
    kd = Parameter(2.0, ge=0.0)
    steps = Parameter(3, ge=1, le=9)
    is_on = Parameter(True)
    name_of_gait = Parameter("slow")
    gait = Parameter(Gait.WALK)
    level = Parameter(Level.LOW)
    gains = Parameter([1.0, 2.0], ge=0.0, unit="N m/rad")
    limits = Parameter((-1, 1))
    horizon = Parameter(10, live=False, unit="ticks")
    offset = Parameter(0.0)

    def __init__(self, **given: Any) -> None:
        super().__init__("tuned", **parameters(**given))
        self.changed: list[frozenset[str]] = []
        self.seen_at_configure = 0

    def on_configure(self, state: Any) -> Any:
        self.seen_at_configure = self.horizon
        return super().on_configure(state)

    def on_parameters(self, changed: frozenset[str]) -> None:
        self.changed.append(changed)


def values(node: Tuned) -> dict[str, Any]:
    return {name: getattr(node, name) for name in parameters_of(Tuned)}


def activate(node: Any) -> None:
    assert request(node, "configure")
    assert request(node, "activate")


def test_every_type_is_an_attribute_and_a_described_ros_parameter() -> None:
    with spinning(Tuned) as node:
        assert values(node) == {
            "kp": 20.0,
            "kd": 2.0,
            "steps": 3,
            "is_on": True,
            "name_of_gait": "slow",
            "gait": Gait.WALK,
            "level": Level.LOW,
            "gains": [1.0, 2.0],
            "limits": (-1, 1),
            "horizon": 10,
            "offset": 0.0,
        }
        kp, kd, steps, gait, level, gains, horizon = node.describe_parameters(
            ["kp", "kd", "steps", "gait", "level", "gains", "horizon"]
        )
        assert (kp.type, kp.description) == (ParameterType.PARAMETER_DOUBLE, "proportional gain")
        assert (kp.floating_point_range[0].from_value, kp.floating_point_range[0].to_value) == (
            0.0,
            200.0,
        )
        live = "takes effect: between callbacks"
        assert kp.additional_constraints == f"unit: N m/rad; {live}; initial: 20.0"
        assert not kd.floating_point_range
        assert kd.additional_constraints == f"at least: 0.0; {live}; initial: 2.0"
        assert (steps.integer_range[0].from_value, steps.integer_range[0].to_value) == (1, 9)
        assert gait.additional_constraints == f'one of: walk, stand; {live}; initial: "walk"'
        assert level.additional_constraints == f'one of: LOW, HIGH; {live}; initial: "LOW"'
        assert gains.additional_constraints == (
            f"unit: N m/rad; at least: 0.0; {live}; initial: [1.0, 2.0]"
        )
        at_configure = "unit: ticks; takes effect: at configure; initial: 10"
        assert horizon.additional_constraints == at_configure


def test_the_config_sets_the_initial_values() -> None:
    given = {"kp": 30, "gait": "stand", "level": "HIGH", "gains": [3, 4, 5], "horizon": 7}
    with spinning(lambda: Tuned(**given)) as node:
        found = values(node)
        assert {name: found[name] for name in given} == {
            "kp": 30.0,
            "gait": Gait.STAND,
            "level": Level.HIGH,
            "gains": [3.0, 4.0, 5.0],
            "horizon": 7,
        }
        assert isinstance(node.kp, float)


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ({"kp": 300.0}, "`kp` is 300.0 N m/rad, expected 0.0 to 200.0"),
        ({"kd": -1.0}, "`kd` is -1.0, expected at least 0.0"),
        ({"kp": "stiff"}, "`kp` is of type string, expected double"),
        ({"gait": "wlak"}, "did you mean `walk`?"),
        ({"limits": [1, 2, 3]}, "`limits` has 3 items, expected 2"),
    ],
)
def test_an_invalid_value_of_the_config_is_named(given: dict[str, Any], fault: str) -> None:
    rclpy.init()
    try:
        with pytest.raises(ObeliskConfigError, match=fault):
            Tuned(**given)
        gc.collect()
    finally:
        rclpy.try_shutdown()


def test_a_service_call_changes_the_attributes_and_reports_it() -> None:
    with spinning(Tuned) as node:
        activate(node)
        assert set_each(node, message("kp", 400.0)) == [
            "`kp` is 400.0 N m/rad, expected 0.0 to 200.0"
        ]
        results = ask_each(node, message("kp", 25), message("kd", 3.0), message("horizon", 20))
        assert results == [(True, IN_EFFECT), (True, IN_EFFECT), (True, STORED)]
        assert (node.kp, node.kd, node.horizon) == (25.0, 3.0, 10)
        assert node.changed == [frozenset({"kp", "kd"})]
        # Setting the same values again is not a change.
        assert ask_each(node, message("kp", 25.0)) == [(True, IN_EFFECT)]
        assert len(node.changed) == 1
        assert "expected 0.0 to 200.0" in set_together(
            node, message("kd", 4.0), message("kp", 400.0)
        )
        assert node.kd == 3.0
        assert ask_each(node, message("limits", [3, 4]), message("gains", [1])) == [
            (True, IN_EFFECT),
            (True, IN_EFFECT),
        ]
        assert (node.limits, node.gains) == ((3, 4), [1.0])


def ask_each(node: Any, *sent: Any) -> list[tuple[bool, str]]:
    results = ask(node, SetParameters, "set_parameters", list(sent)).results
    return [(result.successful, result.reason) for result in results]


def test_a_stored_value_is_used_at_configure() -> None:
    with spinning(Tuned) as node:
        activate(node)
        assert ask_each(node, message("horizon", 20)) == [(True, STORED)]
        assert request(node, "deactivate")
        assert request(node, "cleanup")
        assert node.horizon == 10
        assert request(node, "configure")
        assert (node.horizon, node.seen_at_configure) == (20, 20)
        assert ask_each(node, message("horizon", 20)) == [(True, IN_EFFECT)]


def test_derived_values_are_computed_only_once_configured() -> None:
    with spinning(Tuned) as node:
        assert ask_each(node, message("kp", 1.0)) == [(True, IN_EFFECT)]
        assert (node.kp, node.changed) == (1.0, [])


def test_a_failing_on_parameters_takes_the_node_to_error_processing() -> None:
    class Failing(Tuned):
        def on_parameters(self, changed: frozenset[str]) -> None:
            raise ObeliskConfigError(f"no gains for {sorted(changed)}")

    with spinning(Failing) as node:
        activate(node)
        ((is_set, reason),) = ask_each(node, message("kp", 1.0))
        assert is_set
        assert reason.startswith("set, but")
        assert "no gains for ['kp']" in reason
        eventually(lambda: node.state_label == "unconfigured", "error processing")
        assert str(node.last_fault) == "on_parameters: no gains for ['kp']"


def test_changes_by_the_nodes_own_callback_are_in_effect_after_it() -> None:
    seen: list[float] = []

    class Own(Tuned):
        def tick(self) -> None:
            if not seen:
                self.set_parameters([RosParameter("kp", value=7.0)])
            seen.append(self.kp)

    with spinning(Own) as node:
        activate(node)
        node.create_timer(0.005, node.tick)
        eventually(lambda: len(seen) > 1, "two ticks")
        assert seen[:2] == [20.0, 7.0]


def test_a_coroutine_keeps_its_values_until_it_ends() -> None:
    gate = Future()
    seen: list[float] = []

    class Waiting(Tuned):
        async def tick(self) -> None:
            seen.append(self.kp)
            await gate
            seen.append(self.kp)

    with spinning(Waiting, EventLoopExecutor) as node:
        activate(node)
        # In the default group, the suspended coroutine would block the parameter services.
        timer = node.create_timer(0.005, node.tick, callback_group=ReentrantCallbackGroup())
        eventually(lambda: bool(seen), "the first half of a tick")
        timer.cancel()
        assert ask_each(node, message("kp", 5.0)) == [(True, WAITS)]
        assert node.kp == 20.0
        gate.set_result(None)
        eventually(lambda: node.kp == 5.0, "the new value")
        assert set(seen) == {20.0}
        assert ask_each(node, message("kp", 5.0)) == [(True, IN_EFFECT)]


class Busy(Tuned):
    """Has overlapping callbacks on all workers, which record torn values."""

    def __init__(self) -> None:
        super().__init__()
        self.torn: list[tuple[Any, ...]] = []
        self.late_parameters = 0
        self.derived = 10.0
        self.ticks = 0
        self.inside = 0
        group = ReentrantCallbackGroup()
        for _ in range(6):
            self.create_timer(0.001, self.tick, callback_group=group)
        self.create_timer(0.001, self.tick, callback_group=MutuallyExclusiveCallbackGroup())

    def on_parameters(self, changed: frozenset[str]) -> None:
        if self.inside:
            self.late_parameters += 1
        self.derived = self.kp / self.kd

    def tick(self) -> None:
        self.inside += 1
        first = (self.kp, self.kd, self.derived)
        end_s = time.perf_counter() + 0.003
        while time.perf_counter() < end_s:
            time.sleep(0.0003)
            now = (self.kp, self.kd, self.derived)
            if now != first or now[0] != 10.0 * now[1] or now[2] != 10.0:
                self.torn.append((first, now))
        self.ticks += 1
        self.inside -= 1


def test_with_several_workers_values_change_together_and_never_inside_a_callback() -> None:
    with spinning(Busy, lambda: EventLoopExecutor(num_threads=4)) as node:
        activate(node)
        eventually(lambda: node.ticks > 10, "ticks")
        for n in range(1, 20):
            ask_each(node, message("kp", 10.0 * n), message("kd", float(n)))
            eventually(lambda n=n: node.kp == 10.0 * n, "the new values")
        assert node.torn == []


def test_a_slow_callback_does_not_hold_up_a_fast_one() -> None:
    """The fast loop continues while a change waits for the slow callback to end."""
    release = threading.Event()
    entered = threading.Event()
    seen: list[float] = []

    class TwoSpeeds(Tuned):
        ticks = 0

        def tick(self) -> None:
            self.ticks += 1

        def plan(self) -> None:
            entered.set()
            release.wait()
            seen.append(self.kp)

    with spinning(TwoSpeeds, lambda: EventLoopExecutor(num_threads=3)) as node:
        activate(node)
        node.create_timer(0.002, node.tick, callback_group=MutuallyExclusiveCallbackGroup())
        slow = node.create_timer(0.002, node.plan, callback_group=MutuallyExclusiveCallbackGroup())
        try:
            assert entered.wait(30)
            slow.cancel()
            assert ask_each(node, message("kp", 5.0)) == [(True, WAITS)]
            before = node.ticks
            eventually(lambda: node.ticks > before + 20, "ticks of the fast loop")
            assert node.kp == 20.0
        finally:
            release.set()
        eventually(lambda: node.kp == 5.0, "the new value")
        assert seen == [20.0]


def test_a_node_without_parameters_has_its_own_callbacks() -> None:
    with spinning(lambda: ObeliskNode("plain")) as node:
        callback: Callable[[], None] = lambda: None  # noqa: E731
        assert node.live_parameters.around(callback) is callback


def test_reading_a_value_finds_nothing_but_the_instances_attribute() -> None:
    with spinning(Tuned) as node:
        assert vars(node)["kp"] == 20.0
        assert not hasattr(Tuned, "kp")


def test_subclasses_change_defaults_and_replace_parameters() -> None:
    class Stiff(Tuned):
        kp = Parameter(100.0)
        kd = 3.0  # type: ignore[assignment]

    assert parameters_of(Stiff)["kp"].default == 100.0
    assert list(parameters_of(Stiff)) == [name for name in parameters_of(Tuned) if name != "kd"]


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (lambda: Parameter(5.0, le=1.0), "the default of a parameter is 5.0, expected at most 1.0"),
        (lambda: Parameter(1.0, ge=2.0, le=1.0), r"`ge` is 2.0, greater than `le` \(1.0\)"),
        (lambda: Parameter("x", ge=1.0), "`ge` and `le` limit numbers, not 'x'"),
        (lambda: Parameter(1.0, unit="m; s"), "expected one line without `;`"),
        (lambda: Parameter([]), "is \\[\\], expected a bool"),
        (lambda: Parameter(None), "is None, expected a bool"),  # type: ignore[type-var]
    ],
)
def test_an_invalid_declaration_is_named(make: Callable[[], object], fault: str) -> None:
    with pytest.raises(ObeliskConfigError, match=fault):
        make()


def test_a_name_that_the_library_uses_is_rejected() -> None:
    with pytest.raises((ObeliskConfigError, RuntimeError)) as raised:
        type("Hidden", (ObeliskNode,), {"params_path": Parameter("x")})
    reported = str(raised.value.__cause__ or raised.value)
    assert "hides ObeliskNode.params_path: choose another name" in reported


def test_obk_param_reports_the_outcome() -> None:
    with spinning(Tuned, EventLoopExecutor) as node:
        activate(node)

        def output(*words: object) -> str:
            done = obk("param", *words)
            assert done.returncode == 0, done.stderr
            return done.stdout

        prefix = "/tuned: "
        assert (
            output("set", "tuned", "kp", 25)
            == f"{prefix}kp changed from 20.0 to 25.0 N m/rad, in effect\n"
        )
        stored = f"{prefix}horizon changed from 10 to 20 ticks, {STORED}\n"
        assert output("set", "tuned", "horizon", 20) == stored
        assert output("set", "tuned", "offset", "-1.5") == (
            f"{prefix}offset changed from 0.0 to -1.5, in effect\n"
        )
        assert (node.kp, node.horizon, node.offset) == (25.0, 10, -1.5)
        refused = obk("param", "set", "tuned", "kp", -1)
        assert refused.returncode == 1
        assert "`kp` is -1.0 N m/rad, expected 0.0 to 200.0" in refused.stderr
        row = next(line for line in output("list", "tuned").splitlines() if line.startswith("kp "))
        assert row.split(maxsplit=2)[:2] == ["kp", "double"]
        assert "0.0 to 200.0  N m/rad" in row
        assert row.endswith("proportional gain")
        listed = json.loads(output("list", "tuned", "--format", "json"))["/tuned"]
        assert listed["gait"]["choices"] == ["walk", "stand"]
        assert (listed["horizon"]["live"], listed["params_path"]["live"]) == (False, None)


def test_a_parameter_read_before_the_base_constructor_is_named_with_its_location() -> None:
    program = (
        "from obelisk_py.core.node import ObeliskNode\n"
        "from obelisk_py.core.parameter import Parameter\n"
        "from obelisk_py.core.utils.ros import spin_obelisk\n"
        "class Arm(ObeliskNode):\n"
        "    mass = Parameter(5.0)\n"
        "    def __init__(self):\n"
        "        self.weight = 9.81 * self.mass\n"
        "        super().__init__('arm')\n"
        "spin_obelisk([], Arm)\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 1
    for part in ("`mass`", "`super().__init__(...)`", "<string>:7"):
        assert part in ended.stderr
    assert "Traceback" not in ended.stderr
