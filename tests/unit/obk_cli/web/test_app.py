"""The page over HTTP, requested without a network."""

import asyncio
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest

from obelisk_spec.page_access import new_token
from obelisk_spec.parameter_notes import ParameterNotes
from obk_cli.configedit.edited_files import EditedFile, open_for_edit
from obk_cli.configedit.save_params import SavedParameter
from obk_cli.diagnostics.source import Span
from obk_cli.errors import CommandFailedError
from obk_cli.introspect.config_update import ConfigUpdate
from obk_cli.introspect.tuning import ChangedParameter, TunableParameter
from obk_cli.monitor.model import StackView
from obk_cli.ros.parameters import NodeParameter, ParameterDescription
from obk_cli.runs.protocol import ChangeAnswer, Member
from obk_cli.web.feed import Snapshot
from obk_cli.web.plots import FieldData, FieldRequest

from ..monitor.stacks import BROKEN, HEALTHY  # noqa: TID252 - shared by folders of tests

pytest.importorskip("starlette", reason="starlette is in the `web` extra")

from obk_cli.web.app import FILES, HEADERS, PageApi, make_app

TOKEN = new_token()
PORT = 8420
HOST = f"127.0.0.1:{PORT}"
RUN = {"run": HEALTHY.run}
REACHED = ChangeAnswer(
    success=True, members=(Member(node="/obelisk_control_0", result="reached", state="inactive"),)
)


KP = TunableParameter(
    name="kp",
    value=NodeParameter(kind="double", value=25.0),
    description=ParameterDescription(
        kind="double",
        notes=ParameterNotes(unit="N m/rad", least=0.0, most=200.0, is_live=True, initial=20.0),
        text="stiffness",
    ),
)


@dataclass(frozen=True)
class Answer:
    status: int
    headers: dict[str, str]
    body: str

    @property
    def json(self) -> Any:
        return json.loads(self.body)

    @property
    def events(self) -> list[tuple[str, Any]]:
        pairs = [block.split("\n") for block in self.body.split("\n\n") if block]
        return [
            (name.removeprefix("event: "), json.loads(data.removeprefix("data: ")))
            for name, data in pairs
        ]


@dataclass
class Behind:
    """A fake back end of a page; its streams end after some updates."""

    moments: list[Snapshot] = field(default_factory=lambda: [Snapshot(number=1, view=HEALTHY)])
    looks: int = 1
    changes: list[tuple[str, str, tuple[str, ...]]] = field(default_factory=list)
    answer: ChangeAnswer | Exception = REACHED
    received_after: list[int] = field(default_factory=list)
    is_wanted: bool = False
    updates: list[ConfigUpdate] = field(default_factory=list)

    def update(self, view: StackView) -> ConfigUpdate:
        assert view is HEALTHY
        if not self.updates:
            raise CommandFailedError("no node of the config is running", help="launch it")
        return self.updates.pop(0) if len(self.updates) > 1 else self.updates[0]

    def snapshot(self) -> Snapshot:
        return self.moments.pop(0) if len(self.moments) > 1 else self.moments[0]

    def is_ending(self) -> bool:
        self.looks -= 1
        return self.looks < 0

    def change(self, view: StackView, transition: str, nodes: tuple[str, ...]) -> ChangeAnswer:
        self.changes.append((view.name, transition, nodes))
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def of(self, view: StackView) -> dict[str, tuple[TunableParameter, ...]]:
        assert view is HEALTHY
        return {"/obelisk_control_0": (KP,)}

    def set(self, view: StackView, node: str, name: str, text: str) -> ChangedParameter:
        if text == "-1":
            raise CommandFailedError("too small", help="see the range")
        after = NodeParameter(kind="double", value=float(text))
        return ChangedParameter(
            name=name, before=KP.value, after=after, unit="N m/rad", effect="in effect"
        )

    def history(self, view: StackView, requests: Sequence[FieldRequest]) -> list[dict[str, Any]]:
        if not requests:
            raise CommandFailedError("not recorded", help="record it")
        return [{"curve": f"{one.topic} {one.field}"} for one in requests]

    @contextmanager
    def subscribed(self, wishes: list[FieldRequest]) -> Iterator[None]:
        self.is_wanted = True
        yield
        self.is_wanted = False

    def data_after(self, wish: FieldRequest, after_ns: int) -> FieldData:
        assert self.is_wanted
        self.received_after.append(after_ns)
        values = (1.0, float("nan"), None)
        return FieldData(
            labels=("q[0]", "q[1]", "q[2]"), samples=((5_000_000_000, values),), fault=""
        )


def asked(
    path: str,
    *,
    method: str = "GET",
    query: str = "",
    body: bytes = b"",
    headers: dict[str, str] | None = None,
    behind: Behind | None = None,
) -> Answer:
    """A request with the headers of the page itself, except for given changes."""
    behind = behind or Behind()
    site = PageApi(
        behind.snapshot,
        behind,
        behind.history,
        behind.change,
        behind,
        behind.update,
        behind.is_ending,
    )
    app = make_app(site, token=TOKEN, port=PORT)
    page = {"host": HOST, "origin": f"http://{HOST}", "cookie": f"obk_{PORT}={TOKEN}"}
    reported = {**page, **(headers or {})}
    scope = {
        "type": "http",
        "asgi": {"version": "3.0", "spec_version": "2.4"},
        "http_version": "1.1",
        "method": method,
        "scheme": "http",
        "path": path,
        "raw_path": path.encode(),
        "root_path": "",
        "query_string": query.encode(),
        "headers": [(name.encode(), text.encode()) for name, text in reported.items() if text],
        "client": ("127.0.0.1", 50000),
        "server": ("127.0.0.1", PORT),
    }
    sent: list[Any] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": body, "more_body": False}

    async def send(message: Any) -> None:
        sent.append(message)

    asyncio.run(app(scope, receive, send))
    reported_back = {name.decode(): text.decode() for name, text in sent[0]["headers"]}
    return Answer(
        status=sent[0]["status"],
        headers=reported_back,
        body=b"".join(message.get("body", b"") for message in sent[1:]).decode(),
    )


def change(body: object, behind: Behind, **headers: str) -> Answer:
    data = json.dumps(body).encode()
    return asked("/change", method="POST", body=data, behind=behind, headers=headers)


PATHS = [
    "/",
    "/page.js",
    "/style.css",
    "/graph",
    "/fields",
    "/events",
    "/history",
    "/save",
    "/nothing",
]


@pytest.mark.parametrize("path", PATHS)
def test_nothing_is_reported_without_the_token(path: str) -> None:
    answer = asked(path, headers={"cookie": ""})
    assert answer.status == 401
    assert asked(path, headers={"cookie": f"obk_{PORT + 1}={TOKEN}"}).status == 401


@pytest.mark.parametrize("path", PATHS)
def test_nothing_is_reported_to_a_page_of_another_host_name(path: str) -> None:
    assert asked(path, headers={"host": f"robot.example:{PORT}"}).status == 403
    assert asked(path, headers={"origin": "http://robot.example"}).status == 403


@pytest.mark.parametrize("path", PATHS)
def test_every_response_states_what_may_run(path: str) -> None:
    for headers in ({}, {"cookie": ""}, {"host": "robot.example"}):
        reported = asked(path, headers=headers).headers
        assert {name: reported[name.lower()] for name in HEADERS} == HEADERS


def test_only_code_from_the_page_itself_is_run() -> None:
    policy = dict(part.split(" ", 1) for part in HEADERS["Content-Security-Policy"].split("; "))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == "'self'"
    assert policy["frame-ancestors"] == "'none'"
    assert "unsafe" not in HEADERS["Content-Security-Policy"]


def test_the_url_with_its_token_returns_the_page_and_a_cookie() -> None:
    answer = asked("/", query=f"token={TOKEN}", headers={"cookie": "", "origin": ""})
    assert answer.status == 200
    assert "<!doctype html>" in answer.body
    assert answer.headers["set-cookie"] == (
        f"obk_{PORT}={TOKEN}; HttpOnly; Path=/; SameSite=strict"
    )
    assert asked("/graph", headers={"cookie": "", "x-obk-token": TOKEN}).status == 200


def test_only_the_files_of_the_page_exist() -> None:
    for name, path in FILES.items():
        answer = asked(f"/{name}")
        assert (answer.status, answer.body) == (200, path.read_text())
    for path in ("/../guard.py", "/%2e%2e/guard.py", "/guard.py", "/page"):
        assert asked(path).status == 404


def test_a_stream_reports_the_stack_and_its_log() -> None:
    behind = Behind(moments=[Snapshot(number=1, view=BROKEN, is_waiting=False, picture="<svg/>")])
    (name, view), (log, reported) = asked("/events", behind=behind).events
    assert (name, log) == ("view", "log")
    assert view["has_picture"]
    assert not view["is_waiting"]
    assert view["transitions"] == ["activate", "cleanup", "shutdown"]
    assert [node["state"] for node in view["nodes"]] == ["active", "inactive", "finalized"]
    assert view["nodes"][0]["transitions"] == ["deactivate", "shutdown"]
    assert view["nodes"][0]["rates"][0]["measured_hz"] == 463.4
    assert [topic["is_off"] for topic in view["topics"]] == [True, True, False]
    assert "\x1b" not in "".join(reported["lines"])
    assert "red [ERROR]" in reported["lines"][2]


def test_a_stream_reports_only_changes() -> None:
    first = Snapshot(number=1, view=HEALTHY)
    same_log = Snapshot(number=2, view=replace(HEALTHY, state="inactive"))
    more_log = Snapshot(number=3, view=replace(HEALTHY, lines=("<b>bold</b>",)))
    behind = Behind(moments=[first, first, same_log, more_log], looks=4)
    events = asked("/events", behind=behind).events
    assert [name for name, _ in events] == ["view", "log", "view", "view", "log"]
    assert events[-1][1] == {"lines": ["<b>bold</b>"]}


def test_a_stream_reports_that_nothing_runs() -> None:
    assert asked("/events", behind=Behind(moments=[Snapshot()])).events == [("waiting", {})]


def test_a_stream_resumes_a_field_at_its_position() -> None:
    behind = Behind(looks=2)
    curve = quote("/obelisk/dummy/est q")
    events = asked("/events", query=f"curve={curve}&curve={curve}", behind=behind).events
    samples = [data for name, data in events if name == "samples"]
    assert samples[0]["curves"] == [
        {
            "curve": "/obelisk/dummy/est q",
            "labels": ["q[0]", "q[1]", "q[2]"],
            "fault": "",
            "rows": [[5.0, 1.0, "nan", None]],
        }
    ]
    assert behind.received_after == [0, 5_000_000_000]
    assert not behind.is_wanted


@pytest.mark.parametrize("path", ["/events", "/history"])
def test_too_many_fields_are_rejected(path: str) -> None:
    query = "&".join(f"curve=/t%20f{n}" for n in range(13))
    assert asked(path, query=query).json["why"] == "more than 12 curves"


def test_the_whole_run_comes_from_its_recording() -> None:
    answer = asked("/history", query="curve=/t%20q")
    assert answer.json == {"run": HEALTHY.run, "curves": [{"curve": "/t q"}]}
    missing = asked("/history")
    assert (missing.status, missing.json["why"]) == (404, "not recorded: record it")
    assert asked("/history", behind=Behind(moments=[Snapshot()])).status == 404


def test_a_transition_of_a_node_or_of_the_stack_is_carried_out() -> None:
    behind = Behind()
    answer = change({"transition": "deactivate", "node": "/obelisk_control_0", **RUN}, behind)
    assert answer.json["success"]
    assert answer.json["members"][0]["state"] == "inactive"
    change({"transition": "activate", "node": "", **RUN}, behind)
    assert behind.changes == [
        ("dummy", "deactivate", ("/obelisk_control_0",)),
        ("dummy", "activate", ()),
    ]


def test_the_reason_of_a_failed_transition_is_reported() -> None:
    behind = Behind(answer=CommandFailedError("the launcher gave no answer", help="see `obk ps`"))
    answer = change({"transition": "configure", "node": "", **RUN}, behind)
    assert (answer.status, answer.json["success"]) == (200, False)
    assert answer.json["why"] == "the launcher gave no answer: see `obk ps`"


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({"transition": "destroy", "node": "", **RUN}, 400),
        ({"transition": "activate", "node": "/another", **RUN}, 404),
        ({"transition": "activate", **RUN}, 400),
        ({"transition": "activate", "node": ""}, 400),
        (["activate"], 400),
        ("activate", 400),
    ],
)
def test_an_invalid_change_is_rejected(body: object, status: int) -> None:
    behind = Behind()
    answer = change(body, behind)
    assert answer.status == status
    assert not answer.json["success"]
    assert behind.changes == []


def test_a_change_that_another_page_asks_for_is_not_carried_out() -> None:
    behind = Behind()
    body = {"transition": "activate", "node": "", **RUN}
    assert change(body, behind, origin="http://robot.example").status == 403
    assert change(body, behind, origin="").status == 403
    assert change(body, behind, cookie="").status == 401
    assert behind.changes == []


def test_without_a_stack_nothing_can_be_changed() -> None:
    behind = Behind(moments=[Snapshot()])
    answer = change({"transition": "activate", "node": "", **RUN}, behind)
    assert (answer.status, answer.json["why"]) == (404, "no stack is running")


def test_a_yes_for_a_stack_that_has_ended_is_not_one_for_the_next() -> None:
    behind = Behind()
    answer = change({"transition": "activate", "node": "", "run": "arm_20310203_040506"}, behind)
    assert answer.status == 409
    assert answer.json["why"] == "the stack of arm_20310203_040506 is no longer running"
    assert behind.changes == []


def test_parameters_are_described_and_set() -> None:
    (node,) = asked("/parameters").json["nodes"]
    assert node == {
        "node": "/obelisk_control_0",
        "parameters": [
            {
                "name": "kp",
                "kind": "double",
                "text": "25.0",
                "unit": "N m/rad",
                "least": 0.0,
                "most": 200.0,
                "step": 0.1,
                "range": "0.0 to 200.0",
                "choices": [],
                "live": True,
                "description": "stiffness",
                "initial": "20.0",
            }
        ],
    }

    def reported(**changes: str) -> tuple[int, Any]:
        wanted = {"node": "/obelisk_control_0", "name": "kp", "value": "30", **RUN, **changes}
        answer = asked("/parameter", method="POST", body=json.dumps(wanted).encode())
        return answer.status, answer.json["why"]

    assert reported() == (200, "kp changed from 25.0 to 30.0 N m/rad, in effect")
    assert reported(value="-1") == (200, "too small: see the range")
    assert reported(node="/other")[0] == 404
    assert reported(run="another")[0] == 409
    assert asked("/parameter", method="POST", body=b"{}").status == 400


def edit_of(path: Path, kp: float) -> ConfigUpdate:
    """The edit that sets `kp` in a config."""
    file = open_for_edit(str(path))
    assert isinstance(file, EditedFile)
    one = SavedParameter(
        node="/obelisk_control_0",
        name="kp",
        before=20.0,
        after=kp,
        place=Span.at(file.source, 1, 1),
    )
    return ConfigUpdate(
        config=str(path),
        findings=(),
        parameters=(one,),
        files=((file, f"kp: {kp}\n"),),
        missing_nodes=(),
    )


def save(behind: Behind, **body: str) -> Answer:
    return asked("/save", method="POST", body=json.dumps(body).encode(), behind=behind)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "arm.yaml"
    path.write_text("kp: 20.0\n")
    return path


def test_parameters_are_written_into_the_config_as_shown(config: Path) -> None:
    behind = Behind(updates=[edit_of(config, 25.0)])
    shown = asked("/save", behind=behind).json
    assert "+kp: 25.0" in shown["diff"].splitlines()
    assert config.read_text() == "kp: 20.0\n"
    answer = save(behind, run=shown["run"], digest=shown["digest"])
    assert answer.json["success"]
    assert answer.json["why"].endswith("kp changed from 20.0 to 25.0")
    assert config.read_text() == "kp: 25.0\n"


def test_another_edit_than_the_one_that_was_shown_is_not_written(config: Path) -> None:
    behind = Behind(updates=[edit_of(config, 25.0), edit_of(config, 26.0)])
    shown = asked("/save", behind=behind).json
    assert save(behind, run=shown["run"], digest=shown["digest"]).status == 409
    assert save(behind, run="another", digest=shown["digest"]).status == 409
    assert save(behind, run=shown["run"]).status == 400
    assert config.read_text() == "kp: 20.0\n"


def test_only_the_page_itself_writes_the_config(config: Path) -> None:
    behind = Behind(updates=[edit_of(config, 25.0)])
    shown = asked("/save", behind=behind).json
    body = json.dumps({"run": shown["run"], "digest": shown["digest"]}).encode()
    for headers, status in (({"cookie": ""}, 401), ({"origin": "http://robot.example"}, 403)):
        answer = asked("/save", method="POST", body=body, behind=behind, headers=headers)
        assert answer.status == status
    assert config.read_text() == "kp: 20.0\n"


def test_the_reason_why_nothing_can_be_saved_is_reported() -> None:
    answer = asked("/save")
    assert answer.status == 404
    assert answer.json["why"] == "no node of the config is running: launch it"
