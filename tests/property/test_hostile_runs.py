"""Invalid files and replies of a run are shown or skipped, and never raise."""

import json
import os
import tempfile
from contextlib import AbstractContextManager, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from unittest import mock

from hypothesis import given
from hypothesis import strategies as st

from obk_cli.cli import lifecycle, logs, ps
from obk_cli.errors import ObkError
from obk_cli.monitor.expected_topics import planned_topics
from obk_cli.process.identity import boot_id, this_process
from obk_cli.record.recorder_job import run_metadata_of
from obk_cli.runs.folder import RUN_FILE, Run, plan_of_run, read_run, topics_of_run
from obk_cli.runs.protocol import (
    ChangeAnswer,
    Fault,
    StackStatus,
    decode_answer,
    decode_request,
    encode_line,
)
from obk_cli.runs.registry import LiveStack, live_folders
from obk_cli.web.feed import live_picture
from obk_cli.workspace.overlay import FOLDER, RECORD, overlay_prefixes, read_record

from .hostile import JSON, SPOILT, assert_shows_only_text, damaged, respelt

PID, STARTED = this_process()
END = {"topic": "/t", "msg_type": "a/msg/B", "rate_hz": 1.0}
PROCESS = {
    "node": "n",
    "namespace": "/",
    "section": "robot",
    "device": "",
    "model": "m.xml",
    "publishes": [END],
    "subscribes": [END],
    "sensor_groups": [],
    "package": "p",
    "executable": "e",
    "origin": {"path": "c", "line": 1, "column": 1},
}
RUN = {
    "name": "arm",
    "pid": PID,
    "started": STARTED,
    "domain": 1,
    "config": "c.yaml",
    "nodes": ["/a", "/b"],
    "other_nodes": [],
    "devices": ["d"],
    "boot": boot_id(),
    "ended": None,
    "exit_code": 1,
    "cause": "why",
    "versions": {"obk": "1"},
    "plan": {"name": "arm", "processes": [PROCESS]},
}
RATE = {
    "name": "t",
    "expected_hz": 1.0,
    "measured_hz": 0.5,
    "ticks": 1,
    "overruns": 1,
    "late_p50_us": 1.0,
    "late_p99_us": 1.0,
    "late_max_us": 1.0,
    "standing": "off",
}
NODE = {
    "node": "/a",
    "section": "robot",
    "device": "",
    "state": "active",
    "process": "/a",
    "pid": 7,
    "restarts": 1,
    "hangs": True,
    "rates": [RATE],
}
STATUS = {"name": "arm", "state": "active", "phase": "active", "seconds": 1.0, "nodes": [NODE]}
MEMBER = {"node": "/a", "result": "refused", "state": "active", "fault": "no"}
CHANGE = {"success": False, "why": "no", "members": [MEMBER]}
ANSWERS = [json.dumps(STATUS).encode(), json.dumps(CHANGE).encode()]
OVERLAY = {
    "builder": "obk",
    "python": "3.11.7",
    "ros": "/opt/ros/jazzy",
    "prefixes": ["."],
    "packages": {"demo_msgs": {"source": "src/demo_msgs", "digest": "0"}},
}
FILES = st.binary() | damaged([json.dumps(RUN).encode()]) | st.builds(json.dumps, respelt(RUN))


def no_leftovers() -> AbstractContextManager[object]:
    """Skip the scan of all processes on this machine, which takes most of the time."""
    return mock.patch.object(ps, "find_orphans", return_value=())


def shown(call: object, *arguments: object, **options: object) -> list[str]:
    """The output of a command, which is empty if the command fails with a message."""
    text = StringIO()
    with redirect_stdout(text), suppress(ObkError, SystemExit):
        call(*arguments, **options)  # type: ignore[operator]
    text.getvalue().encode()  # as a terminal receives it
    return text.getvalue().splitlines()


@given(FILES)
def test_a_run_file_of_any_content_is_shown_or_left_out(content: bytes | str) -> None:
    with tempfile.TemporaryDirectory() as home:
        folder = Path(home, "runs", "arm_20260101_000000")
        folder.mkdir(parents=True)
        data = content.encode(errors="replace") if isinstance(content, str) else content
        (folder / RUN_FILE).write_bytes(data)
        (folder / "launch.log").write_bytes(data)
        with mock.patch.dict(os.environ, {"OBK_HOME": home}), no_leftovers():
            live_folders(folder.parent)
            assert_shows_only_text(shown(ps.command))
            shown(ps.command, format="json")
            assert_shows_only_text(shown(logs.command, color="never"))
            shown(logs.command, "arm", "a", color="never")
        run = read_run(folder)
        assert run is None or run.name.isprintable()
        planned_topics(plan_of_run(folder))
        live_picture(plan_of_run(folder))
        topics_of_run(folder)
        run_metadata_of(folder)


@given(st.binary() | damaged(ANSWERS) | JSON.map(json.dumps))
def test_any_reply_of_a_launcher_is_parsed_or_ignored(line: bytes | str) -> None:
    data = line.encode() if isinstance(line, str) else line
    decode_answer(data, StackStatus)
    decode_answer(data, ChangeAnswer)
    request = decode_request(data)
    if isinstance(request, Fault):
        assert_shows_only_text(request.error)
        assert encode_line(request).endswith(b"\n")


@given(respelt(STATUS), SPOILT)
def test_a_status_of_any_shape_is_shown(reported: object, spoilt: str) -> None:
    line = json.dumps(reported).replace("/a", json.dumps(spoilt)[1:-1]).encode()
    answer = decode_answer(line, StackStatus)
    status = answer if isinstance(answer, StackStatus) else None
    run = Run(name="arm", pid=PID, started=STARTED, domain=1, config=f"{spoilt}.yaml", nodes=())
    stack = LiveStack(folder=Path("runs/arm"), run=run, status=status)
    with mock.patch.object(ps, "live_stacks", return_value=(stack,)), no_leftovers():
        assert_shows_only_text(shown(ps.command))
        shown(ps.command, format="json")


@given(respelt(CHANGE), SPOILT)
def test_a_change_of_any_shape_is_shown(reported: object, spoilt: str) -> None:
    line = json.dumps(reported).replace("no", json.dumps(spoilt)[1:-1]).encode()
    answer = decode_answer(line, ChangeAnswer)
    if isinstance(answer, ChangeAnswer):
        assert_shows_only_text(shown(lifecycle._report_change, answer, is_json=False))
        shown(lifecycle._report_change, answer, is_json=True)


@given(st.binary() | st.just("[" * 100_000) | (JSON | respelt(OVERLAY)).map(json.dumps))
def test_a_record_of_an_overlay_of_any_content_is_read_or_ignored(content: bytes | str) -> None:
    with tempfile.TemporaryDirectory() as workspace:
        path = Path(workspace, FOLDER, "overlay", RECORD)
        path.parent.mkdir(parents=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        read_record(Path(workspace))
        overlay_prefixes([Path(workspace)])
