"""Timers and publishers match the state, whatever an override forgot, under any executor."""

import multiprocessing
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from obelisk_control_msgs.msg import PositionSetpoint
from rcl_interfaces.srv import SetParameters
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.executor import EventLoopExecutor
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.robot import ObeliskRobot, ObeliskSimRobot
from obelisk_py.core.spinning import _ThreadPool

from .stack import DEADLINE_S, eventually, parameters, spinning

pytestmark = pytest.mark.ros

SUCCESS = TransitionCallbackReturn.SUCCESS
FAILURE = TransitionCallbackReturn.FAILURE
CONTROL = {"sub_ctrl_setting": "{topic: /c, msg_type: PositionSetpoint}"}
EXECUTORS: dict[str, Callable[[], Executor]] = {
    "single": SingleThreadedExecutor,
    "multi": lambda: _ThreadPool(4),
    "event loop": EventLoopExecutor,
    "event loop of four": lambda: EventLoopExecutor(num_threads=4),
}


def spun(
    make: Callable[[], Any], executor: Callable[[], Executor] = EventLoopExecutor
) -> AbstractContextManager[Any]:
    return spinning(make, executor)


class Ticking(ObeliskController):
    """Counts its ticks; its transitions return the given results, once each."""

    def __init__(self, answers: dict[str, Any] | None = None, forgets: str = "") -> None:
        super().__init__(
            "ticking",
            **parameters(
                pub_ctrl_setting="{topic: /c, msg_type: PositionSetpoint}",
                sub_est_setting="{topic: /e, msg_type: EstimatedState}",
                timer_ctrl_setting="{timer_period_sec: 0.002}",
            ),
        )
        self.answers, self.forgets = answers or {}, forgets
        self.ticks = 0

    def update_x_hat(self, x_hat_msg: Any) -> None:
        del x_hat_msg

    def compute_control(self) -> Any:
        self.ticks += 1
        return None

    def _step(self, name: str, state: LifecycleState) -> Any:
        if name != self.forgets:
            getattr(super(), name)(state)
        return self.answers.get(name, SUCCESS)

    def on_configure(self, state: LifecycleState) -> Any:
        return self._step("on_configure", state)

    def on_activate(self, state: LifecycleState) -> Any:
        return self._step("on_activate", state)

    def on_deactivate(self, state: LifecycleState) -> Any:
        return self._step("on_deactivate", state)

    def on_cleanup(self, state: LifecycleState) -> Any:
        return self._step("on_cleanup", state)

    def on_error(self, state: LifecycleState) -> Any:
        return self._step("on_error", state)


def assert_silent(node: Ticking) -> None:
    """Assert that no timer runs and no publisher publishes."""
    assert all(timer.is_canceled() for timer in node.obk_timers.values())
    assert not any(publisher.is_activated for publisher in node.obk_publishers.values())


def test_an_activate_that_fails_after_its_super_call_starts_nothing() -> None:
    with spun(lambda: Ticking({"on_activate": FAILURE})) as node:
        node.trigger_configure()
        node.trigger_activate()
        assert node.state_label == "inactive"
        assert_silent(node)


@pytest.mark.parametrize(
    ("answers", "forgets"), [({}, "on_activate"), ({"on_deactivate": FAILURE}, "")]
)
def test_every_publisher_of_an_active_node_publishes(answers: dict[str, Any], forgets: str) -> None:
    with spun(lambda: Ticking(answers, forgets)) as node:
        node.trigger_configure()
        node.trigger_activate()
        if answers:
            node.trigger_deactivate()
        assert node.state_label == "active"
        assert all(publisher.is_activated for publisher in node.obk_publishers.values())
        eventually(lambda: node.ticks, "ticks")


def test_a_deactivate_without_its_super_call_stops_everything() -> None:
    with spun(lambda: Ticking(forgets="on_deactivate")) as node:
        node.trigger_configure()
        node.trigger_activate()
        eventually(lambda: node.ticks, "ticks")
        node.trigger_deactivate()
        assert_silent(node)


def test_an_activate_without_its_super_call_starts_everything() -> None:
    with spun(lambda: Ticking(forgets="on_activate")) as node:
        node.trigger_configure()
        node.trigger_activate()
        eventually(lambda: node.ticks, "ticks")


@pytest.mark.parametrize("forgets", ["on_cleanup", "on_error"])
def test_nothing_is_left_of_a_node_that_is_unconfigured(forgets: str) -> None:
    with spun(lambda: Ticking(forgets=forgets)) as node:
        node.trigger_configure()
        node.trigger_activate()
        if forgets == "on_error":
            node.fail("reported to")
            eventually(lambda: node.state_label == "unconfigured", "the end of error processing")
        else:
            node.trigger_deactivate()
            node.trigger_cleanup()
        # The state is set shortly before timers and publishers follow it.
        eventually(lambda: not node.obk_timers, "the end of its timers")
        assert not list(node.timers)


def test_a_configure_without_its_super_call_is_a_reported_fault() -> None:
    with spun(lambda: Ticking(forgets="on_configure")) as node:
        node.trigger_configure()
        eventually(lambda: node.state_label == "unconfigured", "the end of error processing")
        assert "super().on_configure(state)" in node.last_fault.text


def test_a_configure_that_fails_again_and_again_leaves_nothing_behind() -> None:
    with spun(lambda: Ticking({"on_configure": FAILURE})) as node:
        for _ in range(3):
            node.trigger_configure()
        assert not list(node.timers)
        assert not node.obk_publishers


def test_a_fault_reported_within_configure_is_kept() -> None:
    class NoHardware(ObeliskNode):
        def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
            super().on_configure(state)
            self.fail("no hardware", "on_configure")
            return SUCCESS

    with spun(lambda: NoHardware("n")) as node:
        assert node.trigger_configure() == TransitionCallbackReturn.ERROR
        assert node.state_label == "unconfigured"
        assert str(node.last_fault) == "on_configure: no hardware"


@pytest.mark.parametrize("executor", EXECUTORS.values(), ids=EXECUTORS)
def test_a_fault_during_a_transition_is_not_lost(executor: Callable[[], Executor]) -> None:
    class SlowToActivate(ObeliskSimRobot):
        def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
            result = super().on_activate(state)
            eventually(lambda: self.last_fault is not None, "the fault")
            return result

        def run_simulator(self) -> None:
            raise ValueError("diverged")

        def apply_control(self, control_msg: Any) -> None:
            del control_msg

    with spun(lambda: SlowToActivate("s", **parameters(**CONTROL)), executor) as node:
        node.trigger_configure()
        node.trigger_activate()
        eventually(lambda: node.state_label == "unconfigured", "the end of error processing")
        assert node.last_fault.text == "ValueError: diverged"


@pytest.mark.parametrize("executor", EXECUTORS.values(), ids=EXECUTORS)
def test_a_callback_of_plain_rclpy_fails_the_node_too(executor: Callable[[], Executor]) -> None:
    class Plain(ObeliskNode):
        def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
            self.plain = self.create_timer(0.01, self.tick)
            return super().on_activate(state)

        def tick(self) -> None:
            self.plain.cancel()
            raise ValueError("plain")

    with spun(lambda: Plain("p"), executor) as node:
        node.trigger_configure()
        node.trigger_activate()
        eventually(lambda: node.state_label == "unconfigured", "the end of error processing")
        assert node.last_fault.text == "ValueError: plain"


def test_a_coroutine_callback_fails_the_node_too() -> None:
    class Waiting(ObeliskNode):
        def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
            self.waiting = self.create_timer(0.01, self.tick)
            return super().on_activate(state)

        async def tick(self) -> None:
            self.waiting.cancel()
            raise ValueError("later")

    with spun(lambda: Waiting("w")) as node:
        node.trigger_configure()
        node.trigger_activate()
        eventually(lambda: node.state_label == "unconfigured", "the end of error processing")
        assert node.last_fault.text == "ValueError: later"


def test_a_robot_takes_control_only_while_it_is_active() -> None:
    class Robot(ObeliskRobot):
        taken = 0

        def apply_control(self, control_msg: Any) -> None:
            del control_msg
            self.taken += 1

    with spun(lambda: Robot("r", **parameters(**CONTROL))) as node:
        node.trigger_configure()
        callback = node.obk_subscriptions["sub_ctrl"].callback
        callback(PositionSetpoint())
        assert node.taken == 0
        node.trigger_activate()
        callback(PositionSetpoint())
        assert node.taken == 1


def test_a_simulator_that_returns_by_itself_is_reported() -> None:
    class Short(ObeliskSimRobot):
        def run_simulator(self) -> None:
            """Does not stop its loop."""

        def apply_control(self, control_msg: Any) -> None:
            del control_msg

    reported: list[str] = []
    with spun(lambda: Short("s", **parameters(**CONTROL))) as node:
        node.get_logger().warning = reported.append
        node.trigger_configure()
        node.trigger_activate()
        eventually(lambda: reported, "the warning")
        node.trigger_deactivate()
    assert reported == [
        "run_simulator returned before simulator_stop was set: the simulation has stopped"
    ]


def test_a_simulator_that_does_not_stop_is_never_joined_by_a_second_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("obelisk_py.core.robot.LONGEST_STOP_S", 0.05)
    release = threading.Event()

    class Deaf(ObeliskSimRobot):
        def run_simulator(self) -> None:
            release.wait(DEADLINE_S)

        def apply_control(self, control_msg: Any) -> None:
            del control_msg

    with spun(lambda: Deaf("d", **parameters(**CONTROL))) as node:
        node.trigger_configure()
        node.trigger_activate()
        waits_s: list[float] = []
        join = node._simulator.join
        node._simulator.join = lambda wait_s: (waits_s.append(wait_s), join(wait_s))
        node.trigger_deactivate()
        assert node.state_label == "finalized"
        assert "run_simulator " in node.last_fault.text
        assert node.ended.done()
        assert sum(t.name == "simulator" for t in threading.enumerate()) == 1
    # Waited for once, whatever else had to be stopped; and the node could be destroyed.
    assert (waits_s[0], set(waits_s[1:])) == (0.05, {0})
    release.set()


@pytest.mark.parametrize("period", [".inf", "1e300", "1e-12"])
def test_a_period_that_no_timer_can_hold_is_rejected(period: str) -> None:
    with spun(Ticking) as node:
        text = f"{{timer_period_sec: {period}}}"
        client = node.create_client(SetParameters, "~/set_parameters")
        eventually(client.service_is_ready, "the service")
        new = Parameter("timer_ctrl_setting", value=text).to_parameter_msg()
        answer = client.call_async(SetParameters.Request(parameters=[new]))
        eventually(answer.done, "the answer")
        assert "1e-09 to 9e+09" in answer.result().results[0].reason
        assert node.trigger_configure() == SUCCESS


PROGRAM = """
from rclpy.lifecycle import TransitionCallbackReturn as Return
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.utils.ros import spin_obelisk

class Node(ObeliskNode):
    def __init__(self):
        super().__init__("node")
        self.trigger_configure(); self.trigger_activate()
        print("up", flush=True)
    def on_deactivate(self, state):
        super().on_deactivate(state)
        {deactivate}
    def on_shutdown(self, state):
        print("shutdown from", state.label, flush=True)
        return super().on_shutdown(state)

spin_obelisk(None, Node)
"""


@pytest.mark.parametrize(
    ("deactivate", "shutdown_from"),
    [("return Return.FAILURE", "active"), ("raise ValueError('x')", "unconfigured")],
)
def test_a_signal_shuts_down_also_a_node_that_does_not_deactivate(
    deactivate: str, shutdown_from: str, tmp_path: Path
) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM.format(deactivate=deactivate))
    with subprocess.Popen(
        [sys.executable, program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=DEADLINE_S)
    assert output == f"shutdown from {shutdown_from}\n"
    assert "RCLError" not in errors
    assert process.returncode == 1


def test_settings_of_no_component_are_reported(capfd: pytest.CaptureFixture[str]) -> None:
    settings = "publishers: [{key: pub_crtl, topic: /x}]"
    with spun(lambda: ObeliskNode("n", **parameters(obelisk_settings=settings))) as node:
        node.trigger_configure()
    text = "the config has a publisher `pub_crtl` that this node's code does not register"
    assert text in capfd.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_shuts_the_node_down_cleanly(number: int, tmp_path: Path) -> None:
    module = tmp_path / "reported.py"
    module.write_text(
        "from obelisk_py.core.node import ObeliskNode\n"
        "from obelisk_py.core.utils.ros import spin_obelisk\n"
        "class Reported(ObeliskNode):\n"
        "    def __init__(self): super().__init__('reported'); self.trigger_configure()\n"
        "    def on_activate(self, s): print('up', flush=True); return super().on_activate(s)\n"
        "    def on_cleanup(self, s): print('clean', flush=True); return super().on_cleanup(s)\n"
        "    def on_shutdown(self, s): print('down', flush=True); return super().on_shutdown(s)\n"
        "class Active(Reported):\n"
        "    def __init__(self): super().__init__(); self.trigger_activate()\n"
        "spin_obelisk(None, Active)\n"
    )
    with subprocess.Popen([sys.executable, module], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.send_signal(number)
        assert process.stdout.read() == "clean\ndown\n"
    assert process.returncode == 0


class OlderSimulator(ObeliskSimRobot):
    """Steps forever with the shared control, like simulators of the first two generations."""

    def __init__(self) -> None:
        super().__init__("older", PositionSetpoint, **parameters(**CONTROL))
        self.n_u = 2
        self.seen: list[list[float]] = []
        self.ends = 0

    def apply_control(self, control_msg: Any) -> None:
        self._set_shared_ctrl(control_msg.u_mujoco)

    def run_simulator(self) -> None:
        try:
            while True:
                with self.lock:
                    ctrl = list(self.shared_ctrl)
                if ctrl not in self.seen:
                    self.seen.append(ctrl)
                time.sleep(0.001)
        finally:
            self.ends += 1


def test_an_existing_simulator_reads_the_shared_control_and_is_ended() -> None:
    with spun(OlderSimulator) as node:
        node.trigger_configure()
        for rounds in (1, 2):
            node.trigger_activate()
            eventually(lambda: [0.0, 0.0] in node.seen, "the control before the first command")
            node.obk_subscriptions["sub_ctrl"].callback(PositionSetpoint(u_mujoco=[1.0, rounds]))
            eventually(lambda n=rounds: [1.0, n] in node.seen, "the command")
            assert node.trigger_deactivate() == SUCCESS
            assert node.ends == rounds
        assert node.last_fault is None


def test_a_simulator_may_provide_its_own_shared_control() -> None:
    with spun(OlderSimulator) as node:
        for own in (multiprocessing.Array("d", 2), np.zeros(2)):
            node.shared_ctrl, node.lock = own, multiprocessing.Lock()
            node._set_shared_ctrl(np.array([1.0, 2.0]))
            assert list(node.shared_ctrl) == [1.0, 2.0]
