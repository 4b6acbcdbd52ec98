"""Configs with thousands of faults, and huge files, take bounded time and memory."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import takewhile
from pathlib import Path

import pytest

from obk_cli.diagnostics.diagnostic import counted, found
from obk_cli.diagnostics.source import SourceFile, Span

COMPILE = """
import os, resource, sys
from collections import Counter
from pathlib import Path
from obk_cli.compiler import Options, compile_config

def compile_here():
    resource.setrlimit(resource.RLIMIT_AS, (700_000_000, 700_000_000))
    resource.setrlimit(resource.RLIMIT_CPU, (20, 20))  # [s], whatever else the machine does
    outcome = compile_config("many.yaml", Options(variables={}, working_folder=Path.cwd()))
    counts = Counter(fault.code for fault in outcome.diagnostics)
    print(*(f"{code} {times}" for code, times in counts.items()), sep="\\n", flush=True)

for folder in map(str.strip, sys.stdin):
    pid = os.fork()
    if not pid:
        os.chdir(folder)
        try:
            compile_here()
        finally:
            os._exit(0)
    print("exit code", os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
"""
"""Compiles in each folder read from standard input, in its own process; imports only once."""
IMU = "msg_type: sensor_msgs/msg/Imu"


def nodes(count: int, keys: Callable[[int], str]) -> str:
    lines = (f"  - {{pkg: demo, executable: run, name: n{i}, {keys(i)}}}\n" for i in range(count))
    return f"config: many\ncontrol:\n{''.join(lines)}"


def groups(defined: int) -> str:
    known = ", ".join(f"group_{i}x: MutuallyExclusiveCallbackGroup" for i in range(defined))
    used = ", ".join(f"{{key: p{i}, topic: /t, callback_group: gruop_{i}y}}" for i in range(1_000))
    return nodes(1, lambda _: f"callback_groups: {{{known}}}, publishers: [{used}]")


def dangling(count: int) -> str:
    return nodes(
        count,
        lambda i: (
            f"publishers: [{{key: p, topic: /robot/part_{i}/out, msg_type: ObkImu}}], "
            f"subscribers: [{{key: s, topic: /robot/part_{i}/in, msg_type: ObkImu}}]"
        ),
    )


def clash() -> str:
    qos = "qos: {reliability: best_effort}"
    return nodes(
        1_000,
        lambda _: (
            f"publishers: [{{key: p, topic: /t, {IMU}, {qos}}}], "
            "subscribers: [{key: s, topic: /t, msg_type: sensor_msgs/msg/JointState}]"
        ),
    )


@pytest.fixture(scope="module")
def compiler() -> Iterator[subprocess.Popen[str]]:
    """Compile in bounded time and memory."""
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, "-c", COMPILE],
        stdin=pipe,
        stdout=pipe,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        yield process


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        pytest.param(groups(1_000), "OBK207 1000", id="groups-that-are-not-defined"),
        pytest.param(
            groups(200), "OBK207 1000", id="groups-with-few-defined", marks=pytest.mark.slow
        ),
        pytest.param(dangling(3_000), "OBK203 1", id="topics-without-publisher"),
        pytest.param(
            dangling(200), "OBK203 200", id="topics-near-to-two-hundred", marks=pytest.mark.slow
        ),
        pytest.param(clash(), "OBK205 1000", id="types-that-differ"),
        pytest.param(clash(), "OBK206 1000", id="qualities-that-differ"),
        pytest.param(
            f"config: {' '.join(f'${{X{i}}}' for i in range(5_000))}",
            "OBK011 1001",
            id="variables-that-are-not-set",
        ),
        pytest.param(
            "- a\n" * 2_600_000, "OBK006 1", id="ten-mebibytes-of-items", marks=pytest.mark.slow
        ),
        pytest.param(
            "vars: [&a [x, x], *a" + ", *a" * 60_000 + "]", "OBK006 1", id="many-small-aliases"
        ),
        pytest.param("include: many.part", "OBK201 1", id="includes-that-double"),
        pytest.param(
            f"vars: [{'x, ' * 60_000}]\n" + "vars: x\n" * 20_000,
            "OBK004 1001",
            id="keys-that-stand-twice",
            marks=pytest.mark.slow,
        ),
        pytest.param("# obk: ignore[" * 60_000, "OBK114 1", id="comments-without-an-end"),
        pytest.param(groups(20_000), "OBK208 1001", id="unused-groups", marks=pytest.mark.slow),
    ],
)
def test_many_faults_are_reported_in_bounded_time_and_memory(
    text: str, expected: str, tmp_path: Path, compiler: subprocess.Popen[str]
) -> None:
    (tmp_path / "many.yaml").write_text(text)
    for depth in range(20):
        include = f"include: [{depth + 1}.part, {depth + 1}.part]\n"
        (tmp_path / f"{depth or 'many'}.part").write_text(include)
    (tmp_path / "20.part").write_text("vars: 1\n")
    assert compiler.stdin
    assert compiler.stdout
    compiler.stdin.write(f"{tmp_path}\n")
    compiler.stdin.flush()
    lines = takewhile(lambda line: not line.startswith("exit code"), compiler.stdout)
    printed = [line.strip() for line in lines]
    assert expected in printed, printed


def test_the_rest_of_a_rule_is_counted_in_a_last_finding() -> None:
    source = SourceFile.of("f.yaml", "a\n" * 5)
    faults = [found("OBK204", f"fault {i}", Span.at(source, i, 1)) for i in range(1, 6)]
    assert [str(fault) for fault in counted(faults, most=3)[2:]] == [
        "f.yaml:3:1: info[OBK204]: fault 3",
        "f.yaml:4:1: info[OBK204]: and 2 more findings of this rule, the first of them here",
    ]
    assert counted(faults, most=5) == tuple(faults)
