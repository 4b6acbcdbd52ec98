"""Differences between two lockstep runs, and what lockstep simulates without a finding."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obk_cli.source_analysis.hazards import find_hazards

from .test_entry_point import HEAD, LIBRARY, TAIL, load_from

NODE = """
class Mine(ObeliskNode):
    def __init__(self, node_name='n', **kwargs):
        super().__init__(node_name, **kwargs)
        {}

    def on_x(self, msg):
        {}
"""


def hazards(text: str, **modules: str) -> list[str]:
    texts = {"m": HEAD + text + TAIL, **modules}
    found = find_hazards("m", "main", lambda name: load_from(texts, name))
    return [hazard.code for hazard in found]


def node(callback: str = "pass", constructor: str = "pass") -> str:
    return NODE.format(constructor, callback.replace("\n", "\n        "))


@pytest.mark.parametrize(
    ("imports", "callback", "code"),
    [
        ("import threading", "threading.Thread(target=f)", "OBK601"),
        ("from threading import Timer as T", "T(1.0, f)", "OBK601"),
        ("import _thread", "_thread.start_new_thread(f, ())", "OBK601"),
        ("import concurrent.futures", "concurrent.futures.ThreadPoolExecutor()", "OBK601"),
        ("from concurrent import futures", "futures.ProcessPoolExecutor()", "OBK601"),
        ("import multiprocessing as mp", "mp.Process(target=f)", "OBK601"),
        ("", "import asyncio\nasyncio.run(f())", "OBK601"),
        ("", "from asyncio import new_event_loop\nnew_event_loop()", "OBK601"),
        ("import socket", "socket.create_connection(('host', 1))", "OBK602"),
        ("import serial", "serial.Serial('/dev/ttyUSB0')", "OBK602"),
        ("import can", "can.Bus()", "OBK602"),
        ("import subprocess", "subprocess.run(['ls'])", "OBK602"),
        ("import os", "os.system('ls')", "OBK602"),
        ("import requests", "requests.get('http://x')", "OBK602"),
        ("", "open('/dev/input/js0', 'rb')", "OBK602"),
        ("", "open(f'/sys/class/{msg}')", "OBK602"),
        ("import uuid", "uuid.uuid1()", "OBK603"),
        ("import time", "time.thread_time()", "OBK603"),
        ("import ctypes", "ctypes.CDLL('libdrive.so')", "OBK603"),
        ("import rclpy", "rclpy.spin_until_future_complete(self.other, msg)", "OBK604"),
        ("from rclpy.executors import SingleThreadedExecutor as E", "E().spin_once()", "OBK604"),
        ("from rclpy.qos import QoSProfile", "QoSProfile(depth=1, deadline=msg)", "OBK605"),
        ("", "msg.qos.deadline = self.limit", "OBK605"),
        ("from rclpy.event_handler import *", "pass", ""),
        (
            "from rclpy.event_handler import SubscriptionEventCallbacks as S",
            "S(liveliness=self.on_x)",
            "OBK605",
        ),
        (
            "from rclpy.event_handler import PublisherEventCallbacks",
            "PublisherEventCallbacks(matched=self.on_x, incompatible_qos=self.on_x)",
            "OBK605",
        ),
        ("import rclpy", "self.second = rclpy.create_node('second')", "OBK609"),
        ("from rclpy.node import Node\nclass Second(Node): ...", "Second('second')", "OBK609"),
        ("", "for x in set(msg.names): print(x)", "OBK606"),
        ("", "return [x for x in {msg.a, msg.b}]", "OBK606"),
        ("", "return list({str(x) for x in msg})", "OBK606"),
        ("", "names = set(msg.a) | {msg.b}\nfor x in names: print(x)", "OBK606"),
        ("", "return ','.join(frozenset(msg.names))", "OBK606"),
        ("", "return [*set(msg.names)]", "OBK606"),
        ("", "return hash(msg.name) % 7", "OBK607"),
        ("", "return id(msg) + 1", "OBK607"),
        ("", "return sorted(msg, key=id)", "OBK607"),
        ("import random", "random.seed(hash(msg.name))", "OBK607"),
        ("import torch", "pass", "OBK608"),
        ("import jax.numpy as jnp", "pass", "OBK608"),
        ("", "from torch import nn", "OBK608"),
        ("", "import cupy", "OBK608"),
    ],
)
def test_a_hazard_of_a_callback_is_found(imports: str, callback: str, code: str) -> None:
    assert hazards(f"{imports}\n{node(callback)}") == ([code] if code else [])


@pytest.mark.parametrize(
    ("imports", "callback"),
    [
        ("import time", "time.sleep(0.1), time.time(), time.monotonic_ns(), time.perf_counter()"),
        ("from datetime import date, datetime", "datetime.now(), date.today()"),
        ("import time", "time.clock_gettime(time.CLOCK_MONOTONIC_RAW)"),
        ("import random, uuid, os", "random.random(), uuid.uuid4(), os.urandom(4)"),
        ("import numpy as np", "np.random.rand(), np.random.default_rng()"),
        ("", "self.create_rate(10.0).sleep()"),
        ("", "self.client.call_async(msg).add_done_callback(self.on_x)"),
        ("import threading", "threading.Lock(), threading.Event(), threading.current_thread()"),
        ("import socket", "socket.gethostname(), socket.inet_aton(msg)"),
        ("import subprocess", "print(subprocess.PIPE)"),
        ("", "open('gains.yaml'), open('/dev/null'), open(msg.path)"),
        ("", "def open(path): ...\nopen('/dev/x')"),
        ("", "socket = msg.socket\nsocket.socket()"),
        ("from rclpy.qos import QoSProfile", "QoSProfile(depth=1, deadline=None)"),
        (
            "from rclpy.qos import LivelinessPolicy, QoSProfile",
            "QoSProfile(depth=1, liveliness=LivelinessPolicy.AUTOMATIC)",
        ),
        ("", "msg.deadline = 1.0"),
        ("", "for x in sorted(set(msg.names)): print(x)"),
        ("", "for x in {1, 2, 3}: print(x)"),
        ("", "for x in set(range(3)): print(x)"),
        ("", "return len(set(msg.names)), max(x for x in set(msg)), msg.a in {msg.b}"),
        ("", "return {x for x in set(msg)}"),
        ("", "seen: set[int] = set(msg)\nreturn list(seen)"),
        ("", "seen = set()\nseen.add(1)\nfor x in seen: print(x)"),
        ("", "for x in {'a': 1}: print(x)"),
        ("", "return id(msg) == id(self), {id(msg): msg}, hash(msg)"),
        ("", "self.get_logger().info('%x' % id(msg))"),
        ("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import torch", "pass"),
    ],
)
def test_features_that_lockstep_simulates_are_no_hazard(imports: str, callback: str) -> None:
    assert hazards(f"{imports}\n{node(callback)}") == []


def test_the_thread_of_a_simulator_is_no_hazard_but_its_own_thread_is() -> None:
    loop = "    def run_simulator(self):\n        while self.goes_on():\n            {}\n"
    assert hazards("import time\n" + node() + loop.format("time.sleep(0.001)")) == []
    started = loop.format("threading.Thread(target=f).start()")
    assert hazards("import threading\n" + node() + started) == ["OBK601"]


def test_a_thread_class_is_found_at_its_use_in_the_node() -> None:
    worker = "import threading\nclass Worker(threading.Thread):\n    pass\n"
    assert hazards(worker + node("Worker().start()")) == ["OBK601"]
    assert hazards(worker + node()) == []


def test_only_code_that_the_node_uses_is_checked() -> None:
    link = (
        "import socket\nclass Link:\n    def __init__(self):\n        self.s = socket.socket()\n"
        "def ask():\n    return input()\n"
    )
    assert hazards("from link import Link\n" + node("Link()"), link=link) == ["OBK602"]
    assert hazards("import link\n" + node("link.ask()"), link=link) == ["OBK602"]
    assert hazards("from link import Link\n" + node("self.link: Link = msg"), link=link) == []
    assert hazards("import link\n" + node(), link=link) == []


def test_code_run_by_an_import_is_checked_but_not_a_main_program() -> None:
    begun = "import threading\nT = threading.Thread()\nX = 1\n"
    assert hazards("from other import X\n" + node("print(X)"), other=begun) == ["OBK601"]
    program = "import os\nX = 1\nif __name__ == '__main__':\n    os.system('ls')\n"
    assert hazards("from other import X\n" + node("print(X)"), other=program) == []


def test_a_method_that_the_class_overrides_is_never_run() -> None:
    base = "import socket\nclass Base(ObeliskNode):\n    def ask(self):\n        {}\n"
    mine = "class Mine(Base):\n    def ask(self):\n        {}\n"
    ask = base.format("socket.socket()")
    assert hazards(ask + mine.format("pass")) == []
    assert hazards(ask + mine.format("super().ask()")) == ["OBK602"]
    assert hazards(ask + "class Mine(Base):\n    pass\n") == ["OBK602"]


def test_the_function_of_the_entry_point_is_checked() -> None:
    main = "\ndef main():\n    import serial\n    with serial.Serial('/dev/x'):\n"
    text = HEAD + node() + main + "        spin_obelisk(None, Mine)\n"
    found = find_hazards("m", "main", lambda name: load_from({"m": text}, name))
    assert [hazard.code for hazard in found] == ["OBK602"]
    assert text.splitlines()[found[0].span.line - 1].strip().startswith("with serial")


def test_one_finding_represents_all_of_its_kind_in_a_file() -> None:
    callback = "threading.Thread(target=f)\nthreading.Thread(target=g)\nthreading.Timer(1, f)"
    assert hazards("import threading\n" + node(callback)) == ["OBK601", "OBK601"]


def test_source_that_is_not_python_has_no_hazards() -> None:
    assert hazards("class Mine(:") == []
    assert hazards("x = " + "(" * 5000) == []
    assert hazards("from other import Link\n" + node("Link()"), other="class (") == []


def test_a_set_that_refers_to_itself_ends() -> None:
    assert hazards(node("names = names | other\nfor x in names: print(x)")) == []
    assert hazards(node("self.a = self.a | msg.b\nfor x in self.a: print(x)")) == []


def test_bases_in_a_circle_end() -> None:
    assert hazards("class Mine(Other):\n    pass\nclass Other(Mine):\n    pass\n") == []


SOURCES = [path.read_text(encoding="utf-8") for path in sorted(LIBRARY.rglob("core/*.py"))]


@given(st.sampled_from(SOURCES), st.data())
def test_any_source_has_hazards_or_not(text: str, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(text)))
    cut = data.draw(st.integers(0, 30))
    text = text[:at] + data.draw(st.text(max_size=5)) + text[at + cut :]
    for function in ("main", None):
        find_hazards("m", function, lambda name: load_from({"m": text + TAIL}, name))
