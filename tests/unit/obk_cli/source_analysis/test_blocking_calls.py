"""OBK426: callbacks that wait for their own executor, and valid waits."""

import pytest

from obk_cli.config.environment import NodeFacts
from obk_cli.source_analysis.entry_point import read_node_code

from .test_entry_point import HEAD, TAIL, code, load_from

NODE = """
import rclpy
def make(): ...
def run(): ...
f = Pool = more = {{}}
class Mine(ObeliskController):
    def __init__(self, node_name='n'):
        super().__init__(node_name, PositionSetpoint, ObkImu)
        self.client = self.create_client(None, 'reset')
        self.other = make()
        self.create_timer(0.1, self.tick)
        {constructor}
    def update_x_hat(self, msg): {update}
    def compute_control(self): self.helper()
    def helper(self): {helper}
    def tick(self): {tick}
    def run_simulator(self): {loop}
    def work(self): {work}
"""
CALL = "self.client.call(1)"
SPIN = "rclpy.spin_until_future_complete(self, f)"


def found(**bodies: str) -> list[str]:
    places = ("constructor", "update", "helper", "tick", "loop", "work")
    text = NODE.format(**{**dict.fromkeys(places, "pass"), **bodies})
    return [finding.code for finding in code(text).findings]


@pytest.mark.parametrize("where", ["update", "helper", "tick", "constructor"])
def test_a_service_call_is_found_in_anything_the_executor_runs(where: str) -> None:
    assert found(**{where: CALL}) == ["OBK426"]


@pytest.mark.parametrize("method", ["add_done_callback", "add_on_set_parameters_callback"])
def test_callbacks_of_futures_and_parameters_run_on_the_executor(method: str) -> None:
    assert found(tick=f"self.other.{method}(self.work)", work=CALL) == ["OBK426"]


@pytest.mark.parametrize(
    "body",
    [
        SPIN,
        "rclpy.spin_once(self)",
        "self.executor.spin_once()",
        "c = self.create_client(None, 'x'); c.call(1)",
        "self.create_client(None, 'x').call(1)",
    ],
)
def test_ways_to_wait(body: str) -> None:
    assert found(tick=body) == ["OBK426"]


@pytest.mark.parametrize(
    "bodies",
    [
        {"tick": "Pool.add_job(self.work)", "work": CALL},
        {"tick": "self.client.call_async(1)"},
        {"tick": "self.other.call(1)"},
        {"tick": "rclpy.spin_once(self.other)"},
        {"tick": "run(lambda: self.client.call(1))"},
        {"loop": CALL},
        {"work": CALL},
        {"constructor": SPIN},
    ],
)
def test_valid_or_undecidable_waits(bodies: dict[str, str]) -> None:
    assert found(**bodies) == []


def test_a_program_that_chooses_its_executor_may_have_threads_to_wait_on() -> None:
    places = ("constructor", "update", "helper", "loop", "work")
    text = NODE.format(**dict.fromkeys(places, "pass"), tick=CALL)
    for arguments in ("Mine, Pool", "Mine, executor_type=Pool", "Mine, **more"):
        source = HEAD + text + TAIL.replace("Mine", arguments)
        assert findings(source) == []


@pytest.mark.parametrize("executor", ["None", "SingleThreadedExecutor"])
def test_one_thread_is_one_thread_however_it_is_chosen(executor: str) -> None:
    places = ("constructor", "update", "helper", "loop", "work")
    text = NODE.format(**dict.fromkeys(places, "pass"), tick=CALL)
    known = "from rclpy.executors import SingleThreadedExecutor\n"
    source = HEAD + known + text + TAIL.replace("Mine", f"Mine, {executor}")
    assert findings(source) == ["OBK426"]


def findings(source: str) -> list[str]:
    facts = read_node_code("m", "main", lambda name: load_from({"m": source}, name))
    assert isinstance(facts, NodeFacts)
    return [finding.code for finding in facts.findings]
