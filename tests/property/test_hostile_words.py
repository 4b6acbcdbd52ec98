"""Hostile text from nodes, users and files is shown, and never moves the cursor."""

import re
import tempfile
from contextlib import redirect_stderr
from dataclasses import asdict, fields
from io import StringIO
from pathlib import Path
from typing import get_args

from hypothesis import given
from hypothesis import strategies as st

from obelisk_spec.runtime_protocol import Rate, parse_rate, rate_values
from obk_cli.cli.build import report_problems
from obk_cli.cli.commands import _print_error
from obk_cli.compiler import Options, compile_config, compile_source
from obk_cli.diagnostics.source import SourceFile
from obk_cli.introspect.message_text import csv_row, json_line, message_text
from obk_cli.launch.event_lines import LaunchReport
from obk_cli.launch.events import OutputEvent
from obk_cli.launch.status import with_event
from obk_cli.monitor.model import StackView
from obk_cli.monitor.table import monitor_text
from obk_cli.report import report_github, report_text
from obk_cli.runs.logs import last_lines, read_lines
from obk_cli.runs.protocol import NodeStatus, StackStatus
from obk_cli.scaffold.kinds import check_name, suggest_name
from obk_interfaces import PackageError, Prefixes, load_package
from obk_interfaces.definition import check_package

from .hostile import JSON, SPOILT, assert_shows_only_text, damaged

_SGR = re.compile(r"\x1b\[[0-9;:]*m")
RATE = Rate(
    name="t",
    expected_hz=1.0,
    measured_hz=0.5,
    ticks=1,
    overruns=1,
    late_p50_us=1.0,
    late_p99_us=1.0,
    late_max_us=1.0,
    standing="broken",
)
RATE_KEYS = tuple(key for key, _ in rate_values(RATE))
CHOSEN = {
    "fault": SPOILT,
    "text": SPOILT,
    "detail": SPOILT,
    "cause": SPOILT,
    "origin": SPOILT,
    "lines": st.lists(SPOILT, max_size=3).map(tuple),
    **dict.fromkeys(("node", "process"), st.just("/a")),
    **dict.fromkeys(("nodes", "devices", "processes"), st.just(("/a",))),
    **dict.fromkeys(("name", "state"), st.just("active")),
    "signal": st.just("SIGINT"),
    "transition": st.just("configure"),
    "result": st.just("refused"),
    "rate": SPOILT.map(lambda name: Rate(**{**asdict(RATE), "name": name})),
}
STATUS = StackStatus(
    name="arm",
    state="active",
    phase="active",
    seconds=1.0,
    nodes=(
        NodeStatus(
            node="/a",
            section="robot",
            device="",
            state="active",
            process="/a",
            pid=7,
            restarts=1,
            hangs=True,
            rates=(RATE,),
        ),
    ),
)
CONFIG = """\
config: "{0}"
include: "{0}"
control:
  - {{pkg: "{0}", executable: "{0}", publishers: [{{ros_parameter: "{0}", topic: "{0}"}}]}}
"{0}": ${{A}}
robot: [{{is_simulated: "{0}", sim: [{{model_xml_path: "${{B:-{0}}}", "{0}": ["${{A}}"]}}]}}]
"""
DEFINITION = b'# numbers\nfloat64[<=4] values\nstring<=8 N="x"\nstd_msgs/Header h\n---\nint8 a\n'
MANIFEST = b'<package format="3"><name>p</name><version>1.0.0</version><depend>q</depend></package>'
FRAGMENTS = st.lists(
    st.sampled_from(
        (
            *(b"include: [a.yaml, b.yaml, c.yaml]\n", b"include: a.yaml\n", b"config: ${A}\n"),
            *(b"control:\n  - pkg: p\n", b"robot: {x: [1]}\n", b"obk: [\n", b"\xff\n"),
        )
    ),
    max_size=5,
).map(b"".join)


def without_nul(text: str) -> str:
    """NUL, which environment variables cannot contain."""
    return text.replace("\0", "")


@given(st.lists(st.sampled_from(get_args(OutputEvent)), max_size=4), st.data())
def test_events_of_nodes_move_no_terminal_cursor(
    kinds: list[type[OutputEvent]], data: st.DataObject
) -> None:
    report, status = LaunchReport(("/a",), colour=False, quiet=True), STATUS
    for kind in kinds:
        chosen = {f.name: CHOSEN[f.name] for f in fields(kind) if f.name in CHOSEN}
        event = data.draw(st.builds(kind, **chosen))
        assert_shows_only_text(list(report.event(event)))
        status = with_event(status, event)


@given(SPOILT, SPOILT)
def test_a_line_of_a_node_moves_no_terminal(output: str, cause: str) -> None:
    report = LaunchReport(("/a",), colour=False, quiet=False)
    assert_shows_only_text([*report.line("/a", output), *report.note(output)])
    coloured = LaunchReport(("/a",), colour=True, quiet=False).line("/a", output)
    assert_shows_only_text([_SGR.sub("", line) for line in coloured])
    view = StackView(
        run="arm",
        name="arm",
        domain=1,
        state=output,
        phase=output,
        uptime_s=1.0,
        realtime_factor=None,
        nodes=(),
        topics=(),
        lines=(output,),
        cause=cause,
        cost_percent=0.0,
        has_ended=bool(cause),
    )
    assert_shows_only_text(monitor_text(view, 80, colour=False).split("\n"))


@given(st.binary(), st.integers(0, 9))
def test_a_log_of_any_bytes_is_shown(data: bytes, count: int) -> None:
    with tempfile.NamedTemporaryFile() as file:
        file.write(data)
        file.flush()
        assert len(last_lines(Path(file.name), count)) <= count
        "".join(read_lines(Path(file.name))).encode()


@given(JSON | SPOILT)
def test_a_message_of_any_content_moves_no_terminal(value: object) -> None:
    plain = [value] if isinstance(value, str) else value
    assert_shows_only_text(list(message_text(plain, is_whole=True)))  # type: ignore[arg-type]
    json_line(plain)  # type: ignore[arg-type]
    csv_row([str(value)])


@given(st.text(), st.integers(-9, 9), st.dictionaries(st.sampled_from(RATE_KEYS), st.text()))
def test_a_status_of_any_content_is_a_rate_or_ignored(
    name: str, level: int, values: dict[str, str]
) -> None:
    parse_rate(name, level, values)


@given(SPOILT | st.text())
def test_a_name_of_any_text_is_accepted_or_rejected_with_a_message(name: str) -> None:
    problem = check_name(name, kind="controller", owner_of=lambda _: None)
    assert check_name(suggest_name(name, kind="node"), kind="node", owner_of=lambda _: None) is None
    if problem is not None:
        with redirect_stderr(StringIO()) as shown:
            _print_error(problem.sentence, problem.help)
        assert_shows_only_text(shown.getvalue().split("\n"))


@given(SPOILT.map(without_nul), SPOILT.map(without_nul), st.text().map(without_nul))
def test_a_config_and_its_environment_move_no_terminal_cursor(
    output: str, variable: str, raw: str
) -> None:
    escaped = "".join(f"\\x{ord(c):02x}" if ord(c) < 256 else c for c in output)
    options = Options(variables={"A": variable, "B": raw}, working_folder=Path("/nowhere"))
    for text in (CONFIG.format(escaped), CONFIG.format(output)):
        found = compile_source(SourceFile.of("c.yaml", text), options).diagnostics
        assert_shows_only_text(report_text(found, colour=False, verbose=True).split("\n"))
        report_github(found)


@given(st.dictionaries(st.sampled_from("abc"), FRAGMENTS, min_size=1))
def test_files_that_include_one_another_are_merged_or_rejected(texts: dict[str, bytes]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name, data in texts.items():
            Path(folder, f"{name}.yaml").write_bytes(data)
        first = Path(folder, f"{min(texts)}.yaml")
        compile_config(str(first), Options(variables={"A": "a"}, working_folder=Path(folder)))


@given(
    damaged([DEFINITION]) | st.binary(),
    damaged([MANIFEST]) | st.just(MANIFEST),
    st.sampled_from(("msg", "srv", "action")),
    st.from_regex(r"[A-Za-z_0-9 .-]{1,20}", fullmatch=True),
)
def test_a_definition_of_any_bytes_is_accepted_or_rejected(
    definition: bytes, manifest: bytes, kind: str, name: str
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, kind).mkdir()
        Path(folder, kind, f"{name}.{kind}").write_bytes(definition)
        Path(folder, "package.xml").write_bytes(manifest)
        try:
            package = load_package(Path(folder))
        except PackageError as error:
            assert_shows_only_text(str(error).split("\n"))
            return
        prefixes = Prefixes(layers=(), ros=Path("/nowhere"))
        for problem in check_package(package, {}, prefixes):
            assert problem.line >= 1
            assert_shows_only_text(report_problems([problem], colour=False).split("\n"))
