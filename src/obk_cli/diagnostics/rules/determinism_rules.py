"""OBK6xx: what may differ between two lock-step runs, reported on request. Data only."""

from obk_cli.diagnostics.rules.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK601",
        severity="info",
        title="a thread, process or event loop of the node's own",
        cause="A lock-step run calls all callbacks on one thread, in simulated time. What a node "
        "starts beside them runs in real time, so its effects come at another simulated time in "
        "each run. The thread in which `run_simulator` of a simulated robot runs is in lock-step; "
        "threads that it starts are not.",
        fix="Do the work in a timer, or in `run_simulator`. If results do not depend on when the "
        "thread runs, silence the finding.",
    ),
    Rule(
        code="OBK602",
        severity="info",
        title="input or output outside the stack",
        cause="Sockets, devices, other programs and people answer in real time, and not the same "
        "in each run.",
        fix="Move it into a node that the tested config leaves out or replaces by a simulated one.",
    ),
    Rule(
        code="OBK603",
        severity="info",
        title="a clock that is not simulated",
        cause="A lock-step run simulates ROS clocks, `time.time`, `monotonic`, `perf_counter`, "
        "`sleep`, `clock_gettime`, `datetime.now` and `date.today`. Processor time, `uuid.uuid1` "
        "and clocks that compiled code reads stay real.",
        fix="Read `self.t` or one of the simulated clocks. If the value is only logged, silence "
        "the finding.",
    ),
    Rule(
        code="OBK604",
        severity="info",
        title="an executor of the node's own",
        cause="A lock-step run delivers messages and timers itself. While a callback spins an "
        "executor, simulated time stands still, so what it waits for does not arrive.",
        fix="Use `call_async` and a callback of its future, or `await` it.",
    ),
    Rule(
        code="OBK605",
        severity="info",
        title="QoS that lock-step runs do not simulate",
        cause="Deadlines, lifespans and liveliness are measured by the middleware in real time. In "
        "a lock-step run messages do not pass through it: no message expires, and a callback of a "
        "QoS event is refused because it would never be called.",
        fix="Test what depends on them in a real run, `obk rehearse`; otherwise silence the "
        "finding.",
    ),
    Rule(
        code="OBK606",
        severity="info",
        title="the order of a set",
        cause="A set is ordered by hashes. Those of text depend on PYTHONHASHSEED, those of most "
        "objects on their addresses, so the order differs between processes. Sets of numbers are "
        "not reported.",
        fix="Iterate over `sorted(...)`, or keep the items in a list or dict, which keep the order "
        "of insertion.",
    ),
    Rule(
        code="OBK607",
        severity="info",
        title="a number made from `id` or `hash`",
        cause="`id` is an address. `hash` of text depends on PYTHONHASHSEED, and of most objects "
        "on their addresses. Both differ between processes.",
        fix="Number the objects yourself, or compute a checksum such as `zlib.crc32`.",
    ),
    Rule(
        code="OBK608",
        severity="info",
        title="a library that computes on a GPU",
        cause="GPUs add in an order that may differ from run to run, and with it the last bits of "
        "a result.",
        fix="Compute on the CPU in tests, or select the library's deterministic algorithms; then "
        "silence the finding.",
    ),
    Rule(
        code="OBK609",
        severity="info",
        title="a plain rclpy node",
        cause="Messages and timers of a plain rclpy node are those of DDS and the system's clock. "
        "A lock-step run refuses the node.",
        fix="Derive its class from `ObeliskNode` or another base class of the library, or leave "
        "the executable out of the test.",
    ),
    Rule(
        code="OBK611",
        severity="info",
        title="an executable that is not in lock-step runs",
        cause="A lock-step run has all nodes in one Python process. C++ executables, and scripts "
        "of another interpreter, cannot run there.",
        fix="Leave the node out of the test, publish its topics from the test, or test a variant "
        "of the config with a Python node in its place.",
    ),
    Rule(
        code="OBK612",
        severity="info",
        title="a node without life cycle",
        cause="ROS's joystick node is a program of its own, without life cycle, which reads a "
        "device.",
        fix="Write `on: false` in the tested variant, and publish its topic from the test.",
    ),
    Rule(
        code="OBK613",
        severity="info",
        title="a robot that is hardware",
        cause="Lock-step runs never open hardware.",
        fix="Test a variant of the config with `is_simulated: true`.",
    ),
)
