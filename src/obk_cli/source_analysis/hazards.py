"""OBK601 to OBK609: code of a node that may behave differently between lockstep runs.

The search covers the code that the node's start leads to. A call is recognized by its full name;
calls through a variable, `getattr` or a package outside the workspace are not found.
"""

import ast
from collections.abc import Callable, Iterator, Mapping
from typing import Final

from obk_cli.diagnostics.diagnostic import Diagnostic, found
from obk_cli.source_analysis.entry_point import entry_function
from obk_cli.source_analysis.modules import (
    LoadModule,
    ModuleLibrary,
    UnreadableSourceError,
    span_of,
)
from obk_cli.source_analysis.reached_code import CodeBlock, reached_code
from obk_cli.source_analysis.set_order import ordered_by_hash

__all__ = ["find_hazards"]

_THREADS = frozenset(
    """
    threading.Thread threading.Timer _thread.start_new_thread os.fork
    concurrent.futures.ThreadPoolExecutor concurrent.futures.ProcessPoolExecutor
    multiprocessing.Process multiprocessing.Pool multiprocessing.Manager
    multiprocessing.pool.Pool multiprocessing.pool.ThreadPool multiprocessing.dummy.Pool
    multiprocessing.process.BaseProcess multiprocessing.context.SpawnProcess
    asyncio.run asyncio.Runner asyncio.new_event_loop asyncio.get_event_loop
    joblib.Parallel
    """.split()
)
_OUTSIDE = frozenset(
    """
    socket.socket socket.create_connection socket.create_server socket.socketpair socket.fromfd
    subprocess.run subprocess.Popen subprocess.call subprocess.check_call subprocess.check_output
    subprocess.getoutput subprocess.getstatusoutput
    os.system os.popen os.posix_spawn os.spawnl os.spawnv os.spawnlp os.spawnvp os.execv os.execvp
    urllib.request.urlopen urllib.request.urlretrieve
    http.client.HTTPConnection http.client.HTTPSConnection
    requests.get requests.post requests.put requests.patch requests.delete requests.head
    requests.request requests.Session
    httpx.get httpx.post httpx.put httpx.request httpx.Client httpx.AsyncClient
    aiohttp.ClientSession websockets.connect websockets.sync.client.connect
    websocket.create_connection websocket.WebSocketApp
    zmq.Context zmq.asyncio.Context paho.mqtt.client.Client lcm.LCM
    serial.Serial serial.serial_for_url serial.rs485.RS485
    can.Bus can.ThreadSafeBus can.interface.Bus canopen.Network
    smbus.SMBus smbus2.SMBus spidev.SpiDev pigpio.pi usb.core.find hid.device hid.Device
    evdev.InputDevice evdev.list_devices RPi.GPIO.setmode RPi.GPIO.setup
    gpiozero.LED gpiozero.Button gpiozero.DigitalInputDevice gpiozero.DigitalOutputDevice
    pyrealsense2.pipeline pyrealsense2.context
    dynamixel_sdk.PortHandler pymodbus.client.ModbusSerialClient pymodbus.client.ModbusTcpClient
    input
    """.split()
)
_OPENS = frozenset(("open", "io.open", "os.open", "cv2.VideoCapture", "pathlib.Path"))
"""Functions that open devices, or ordinary files, which are the same in each run."""
_DEVICES = ("/dev/", "/proc/", "/sys/")
_NO_DEVICES = ("/dev/null", "/dev/zero", "/dev/full")
_REAL_CLOCKS = frozenset(
    """
    time.process_time time.process_time_ns time.thread_time time.thread_time_ns os.times
    resource.getrusage
    """.split()
)
_COMPILED = frozenset(
    """
    ctypes.CDLL ctypes.PyDLL ctypes.cdll.LoadLibrary ctypes.pydll.LoadLibrary cffi.FFI
    """.split()
)
_EXECUTORS = frozenset(
    """
    rclpy.spin rclpy.spin_once rclpy.spin_until_future_complete
    rclpy.executors.SingleThreadedExecutor rclpy.executors.MultiThreadedExecutor
    rclpy.experimental.EventsExecutor
    obelisk_py.core.executor.EventLoopExecutor
    """.split()
)
_PLAIN_NODES = ("rclpy.create_node", "rclpy.node.Node", "rclpy.lifecycle.LifecycleNode")
_GPU = ("torch", "jax", "cupy", "tensorflow", "pycuda", "warp")

_CALLS: Final[Mapping[str, tuple[str, str, str]]] = {
    **dict.fromkeys(
        _THREADS,
        ("OBK601", "`{}` runs code outside the callbacks", "do the work in a timer"),
    ),
    **dict.fromkeys(
        _OUTSIDE,
        (
            "OBK602",
            "`{}` depends on something outside the stack",
            "move it into a node that the tested config omits or replaces",
        ),
    ),
    **dict.fromkeys(
        _REAL_CLOCKS,
        ("OBK603", "`{}` is not simulated", "read `self.t`, or `time.monotonic()`"),
    ),
    "uuid.uuid1": ("OBK603", "`{}` reads the real clock", "use `uuid.uuid4`, which repeats"),
    **dict.fromkeys(
        _COMPILED,
        (
            "OBK603",
            "`{}` loads compiled code, whose clocks are not simulated",
            "if it reads no clock, silence the finding on this line",
        ),
    ),
    **dict.fromkeys(
        _EXECUTORS,
        (
            "OBK604",
            "`{}` waits while simulated time stands still",
            "use `call_async` with a done callback, or `await` it",
        ),
    ),
    **dict.fromkeys(
        _PLAIN_NODES,
        (
            "OBK609",
            "`{}` creates a plain rclpy node, which a lockstep run rejects",
            "derive its class from `ObeliskNode`",
        ),
    ),
}
"""Full name of the callee -> code, message and help of the finding."""

_QOS_POLICIES = ("deadline", "lifespan", "liveliness", "liveliness_lease_duration")
_QOS_EVENTS = ("deadline", "liveliness", "matched", "message_lost")
_QOS_KEYWORDS: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    "rclpy.qos.QoSProfile": ("policy", _QOS_POLICIES),
    "rclpy.event_handler.PublisherEventCallbacks": ("event", _QOS_EVENTS),
    "rclpy.event_handler.SubscriptionEventCallbacks": ("event", _QOS_EVENTS),
    "rclpy.qos_event.PublisherEventCallbacks": ("event", _QOS_EVENTS),
    "rclpy.qos_event.SubscriptionEventCallbacks": ("event", _QOS_EVENTS),
}
"""Callee -> what its keywords set, and those that only have an effect in a real run."""
_WITHOUT_EFFECT = ("AUTOMATIC", "SYSTEM_DEFAULT", "BEST_AVAILABLE", "UNKNOWN", "Infinite")
_WANT_NUMBERS = (
    "int",
    "float",
    "random.seed",
    "random.Random",
    "numpy.random.seed",
    "numpy.random.default_rng",
    "numpy.random.RandomState",
    "numpy.random.SeedSequence",
)
_OF_HASHING = ("__hash__", "__repr__", "__str__")


def find_hazards(module: str, function: str | None, load: LoadModule) -> tuple[Diagnostic, ...]:
    """Find code behind an entry point that lockstep runs cannot reproduce.

    Args:
        module: dotted name of the module.
        function: the function that the entry point calls; None for a module run as a program.
        load: returns modules by their dotted names.
    """
    library = ModuleLibrary(load)
    hazards: dict[tuple[str, str, str], Diagnostic] = {}
    try:
        entry = library.module(module)
        if entry is not None:
            for block in reached_code(entry_function(entry, function, library), library):
                for name, hazard in _hazards_of(block):
                    # Each hazard is reported once per file, where it first occurs.
                    hazards.setdefault((hazard.code, hazard.span.path, name), hazard)
    except (UnreadableSourceError, RecursionError):
        return ()  # OBK410 reports it, or no check can read it
    return tuple(hazards.values())


_Hazard = tuple[str, Diagnostic]
"""The subject of the finding, and the finding."""


def _hazards_of(block: CodeBlock) -> Iterator[_Hazard]:
    for check in _CHECKS:
        yield from check(block)


def _calls(block: CodeBlock) -> Iterator[_Hazard]:
    """OBK601 to OBK604: calls with effects outside simulated time."""
    for node in block.nodes:
        match node:
            case ast.Call(func=called):
                name = block.name_of(called) or ""
                row = _CALLS.get(name)
                if row is not None and not _is_of_program(row[0], block):
                    code, message, help = row
                    span = span_of(called, block.module.source)
                    yield name, found(code, message.format(name), span, help=help)
                elif name in _OPENS and node.args and _is_device(node.args[0]):
                    yield _device(node.args[0], block)


def _is_of_program(code: str, block: CodeBlock) -> bool:
    """Whether it is an executor that the program itself spins, outside all callbacks."""
    return code == "OBK604" and block.function is None


def _is_device(path: ast.expr) -> bool:
    match path:
        case (
            ast.Constant(value=str(text))
            | ast.JoinedStr(values=[ast.Constant(value=str(text)), *_])
        ):
            return text.startswith(_DEVICES) and text not in _NO_DEVICES
    return False


def _device(path: ast.expr, block: CodeBlock) -> _Hazard:
    span = span_of(path, block.module.source)
    return span.text, found(
        "OBK602",
        f"{span.text} is outside the stack",
        span,
        help="move it into a node that the tested config omits or replaces",
    )


def _classes(block: CodeBlock) -> Iterator[_Hazard]:
    """OBK601, OBK609: classes that are themselves threads, processes or plain nodes."""
    if block.owner is None or block.function is not None:
        return
    name = block.owner.name
    for base in block.owner.bases:
        span = span_of(base, block.module.source)
        base_name = block.name_of(base)
        if base_name in _THREADS:
            message = f"class `{name}` runs code outside the callbacks"
            yield name, found("OBK601", message, span, help="do the work in a timer")
        elif base_name in _PLAIN_NODES:
            message = f"class `{name}` is a plain rclpy node, which a lockstep run rejects"
            yield name, found("OBK609", message, span, help="derive it from `ObeliskNode`")


def _gpu(block: CodeBlock) -> Iterator[_Hazard]:
    """OBK608: imports of libraries that compute on a GPU."""
    for node in block.nodes:
        match node:
            case ast.Import(names=aliases):
                tops = [(alias.name.partition(".")[0], alias) for alias in aliases]
            case ast.ImportFrom(module=str(origin), level=0, names=[alias, *_]):
                tops = [(origin.partition(".")[0], alias)]
            case _:
                continue
        for top, alias in tops:
            if top in _GPU:
                yield (
                    top,
                    found(
                        "OBK608",
                        f"on a GPU `{top}` may compute slightly different values in each run",
                        span_of(alias, block.module.source),
                        help="compute on the CPU in tests, or select deterministic algorithms",
                    ),
                )


def _qos(block: CodeBlock) -> Iterator[_Hazard]:
    """OBK605: deadlines, lifespans, liveliness, and callbacks of QoS events."""
    for node in block.nodes:
        for what, name, place in _qos_settings(node, block):
            span = span_of(place, block.module.source)
            message = f"lockstep runs do not simulate the QoS {what} `{name}`"
            yield str(span), found("OBK605", message, span)


def _qos_settings(node: ast.AST, block: CodeBlock) -> Iterator[tuple[str, str, ast.expr]]:
    match node:
        case ast.Call(func=called, keywords=keywords):
            what, names = _QOS_KEYWORDS.get(block.name_of(called) or "", ("", ()))
            for keyword in keywords:
                if keyword.arg in names and not _is_default(keyword.value):
                    yield what, keyword.arg, keyword.value
        case ast.Assign(
            targets=[ast.Attribute(value=profile, attr=name) as target], value=value
        ) if name in _QOS_POLICIES:
            if "qos" in ast.unparse(profile).lower() and not _is_default(value):
                yield "policy", name, target


def _is_default(expression: ast.expr) -> bool:
    """Whether a policy's value has no effect: `None`, `Duration()`, automatic liveliness."""
    match expression:
        case ast.Constant(value=None) | ast.Call(args=[], keywords=[]):
            return True
        case ast.Attribute(attr=name) | ast.Name(id=name):
            return name in _WITHOUT_EFFECT
    return False


def _set_order(block: CodeBlock) -> Iterator[_Hazard]:
    """OBK606: iteration over a set."""
    for node in ordered_by_hash(block):
        span = span_of(node, block.module.source)
        yield (
            str(span),
            found(
                "OBK606",
                "the order of this set may differ between runs",
                span,
                help="iterate over `sorted(...)`, or keep the items in a list or dict",
            ),
        )


def _hashes(block: CodeBlock) -> Iterator[_Hazard]:
    """OBK607: `id` and `hash` as operands, seeds, numbers and sort keys."""
    if block.function is not None and block.function.name in _OF_HASHING:
        return
    for node in block.nodes:
        match node:
            case ast.BinOp(left=left, right=right) if not _is_text(left):
                used = [left, right]
            case ast.Call(func=called, args=args) if block.name_of(called) in _WANT_NUMBERS:
                used = args
            case ast.keyword(arg="key", value=value) if block.name_of(value) in ("id", "hash"):
                yield _hash(value, block)
                continue
            case _:
                continue
        for expression in used:
            match expression:
                case ast.Call(func=ast.Name(id="id" | "hash") as builtin, args=[of]):
                    is_number = isinstance(of, ast.Constant) and not _is_text(of)
                    if block.name_of(builtin) == builtin.id and not is_number:
                        yield _hash(expression, block)


def _is_text(expression: ast.expr) -> bool:
    return isinstance(expression, ast.Constant) and isinstance(expression.value, str | bytes)


def _hash(place: ast.expr, block: CodeBlock) -> _Hazard:
    span = span_of(place, block.module.source)
    name = "id" if span.text.startswith("id") else "hash"
    return str(span), found(
        "OBK607",
        f"`{name}` returns different numbers in each process",
        span,
        help="number the objects explicitly, or compute a checksum such as `zlib.crc32`",
    )


_CHECKS: Final[tuple[Callable[[CodeBlock], Iterator[_Hazard]], ...]] = (
    _calls,
    _classes,
    _gpu,
    _qos,
    _set_order,
    _hashes,
)
