"""OBK6xx: differences between lockstep runs, reported on request. Data only."""

from obk_cli.diagnostics.rules.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK601",
        severity="info",
        title="a node starts its own thread, process or event loop",
        cause="A lockstep run calls all callbacks on one thread, in simulated time. A thread that "
        "waits with `time.sleep`, a `queue.Queue`, an event or a condition takes turns with them. "
        "Any other thread, process or event loop is executed in real time, so its effects occur at "
        "a different simulated time in each run.",
        fix="Do the work in a timer, or in `run_simulator`. If the thread waits as described, or "
        "if results do not depend on when it runs, silence the finding.",
    ),
    Rule(
        code="OBK602",
        severity="info",
        title="input or output outside the stack",
        cause="Sockets, devices, other programs and people respond in real time and differently "
        "in each run.",
        fix="Move it into a node that the tested config omits or replaces with a simulated one.",
    ),
    Rule(
        code="OBK603",
        severity="info",
        title="a clock that is not simulated",
        cause="A lockstep run simulates ROS clocks, `time.time`, `monotonic`, `perf_counter`, "
        "`sleep`, `clock_gettime`, `datetime.now` and `date.today`. CPU time, `uuid.uuid1` "
        "and clocks read by compiled code are not simulated.",
        fix="Read `self.t` or one of the simulated clocks. If the value is only logged, silence "
        "the finding.",
    ),
    Rule(
        code="OBK604",
        severity="info",
        title="a node uses its own executor",
        cause="A lockstep run delivers messages and calls timers itself. While a callback spins "
        "an executor, simulated time stands still, so the message it waits for never arrives.",
        fix="Use `call_async` with a done callback, or `await` it.",
    ),
    Rule(
        code="OBK605",
        severity="info",
        title="QoS that is not simulated in a lockstep run",
        cause="The middleware measures deadlines, lifespans and liveliness in real time. In a "
        "lockstep run, messages bypass it: no message expires, and QoS event callbacks "
        "are rejected because they would never be called.",
        fix="If the code depends on these policies, test it in real time with `obk rehearse`; "
        "otherwise silence the finding.",
    ),
    Rule(
        code="OBK606",
        severity="info",
        title="code depends on the order of a set",
        cause="The order of a set depends on hashes. Hashes of strings depend on PYTHONHASHSEED, "
        "and those of most objects on their addresses. The order therefore differs between "
        "processes. Sets of numbers are not reported.",
        fix="Iterate over `sorted(...)`, or use a list or dict, which keep the insertion order.",
    ),
    Rule(
        code="OBK607",
        severity="info",
        title="a number derived from `id` or `hash`",
        cause="`id` is an address. `hash` depends on PYTHONHASHSEED for strings, and on the "
        "address for most objects. Both differ between processes.",
        fix="Number the objects explicitly, or compute a checksum such as `zlib.crc32`.",
    ),
    Rule(
        code="OBK608",
        severity="info",
        title="a library that computes on a GPU",
        cause="GPUs may sum in a different order in each run, which changes the last bits of a "
        "result.",
        fix="In tests, compute on the CPU or select the library's deterministic algorithms. "
        "Then silence the finding.",
    ),
    Rule(
        code="OBK609",
        severity="info",
        title="a plain rclpy node",
        cause="A plain rclpy node uses DDS and the system clock for its messages and timers. A "
        "lockstep run rejects it.",
        fix="Derive its class from `ObeliskNode` or another base class of the library, or omit "
        "the executable from the test.",
    ),
    Rule(
        code="OBK611",
        severity="info",
        title="an executable that cannot run in lockstep",
        cause="A lockstep run executes all nodes in one Python process. C++ executables and "
        "scripts of another interpreter cannot run there.",
        fix="Omit the node in the test, publish its topics from the test, or test a variant of "
        "the config with a Python node in its place.",
    ),
    Rule(
        code="OBK612",
        severity="info",
        title="a node without a lifecycle",
        cause="The ROS joystick node is a separate program that reads a device and has no "
        "lifecycle.",
        fix="Set `on: false` in the tested variant, and publish its topic from the test.",
    ),
    Rule(
        code="OBK613",
        severity="info",
        title="a hardware robot",
        cause="Lockstep runs never access hardware.",
        fix="Test a variant of the config with `is_simulated: true`.",
    ),
)
