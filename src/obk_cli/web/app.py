"""The web server of a running stack's page: files, an event stream, transitions.

`page_access` checks every request first. The stream polls the latest snapshot ten times per second;
transitions run in their own threads.
"""

import asyncio
import socket
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Final, Protocol

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

import obk_cli.record
import obk_cli.web
from obelisk_spec.page_access import TOKEN, WebRequest, cookie_name, refusal
from obk_cli.clock import wall_s
from obk_cli.errors import CommandFailedError, ObkError
from obk_cli.introspect.config_update import ConfigUpdate, write_update
from obk_cli.introspect.lifecycle import possible_transitions
from obk_cli.introspect.message_text import json_line
from obk_cli.monitor.model import StackView
from obk_cli.monitor.parameters import Tuner, parameter_data
from obk_cli.monitor.table import monitor_data
from obk_cli.ros.types import fields_of, short_type
from obk_cli.runs.lifecycle import TRANSITIONS
from obk_cli.runs.protocol import ChangeAnswer, change_data
from obk_cli.terminal import plain
from obk_cli.web.feed import Snapshot
from obk_cli.web.plots import FieldData, FieldRequest, Sample, number_fields
from obk_cli.web.saving import update_data

__all__ = ["HEADERS", "HOST", "PageApi", "WebServer", "make_app", "take_port"]

HOST: Final = "127.0.0.1"
HEADERS: Final = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "img-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of every response: the page runs and fetches only content of this server."""
END_S: Final = 2
"""How long the shutdown waits for open streams [s]."""


def take_port(port: int) -> socket.socket:
    """Open a socket that listens on this host only.

    Args:
        port: the port; 0 for any free one.

    Raises:
        CommandFailedError: the port is in use, or this user may not use it.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    # Connections of a server that has just ended must not block its port.
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
        listener.listen()
    except OSError as error:
        listener.close()
        raise CommandFailedError(
            f"port {port} on {HOST} cannot be used: {error.strerror}",
            help="another `obk web` may be using it; choose another port with `--port` (0: any)",
        ) from error
    return listener


class WebServer:
    """Serves until `end` is called, or until Ctrl-C."""

    def __init__(self) -> None:
        """Create the server without starting it."""
        self._server: uvicorn.Server | None = None
        self._is_ended = False

    @property
    def is_ending(self) -> bool:
        """Whether endless streams must end now."""
        return self._is_ended or (self._server is not None and self._server.should_exit)

    def run(self, app: ASGIApp, listener: socket.socket) -> None:
        """Serve on a port until `end` is called, or a signal arrives that uvicorn handles."""
        self._server = uvicorn.Server(
            uvicorn.Config(
                app,
                log_config=None,
                access_log=False,
                lifespan="off",
                proxy_headers=False,
                server_header=False,
                ws="none",
                timeout_graceful_shutdown=END_S,
            )
        )
        self._server.should_exit = self._is_ended
        asyncio.run(self._server.serve(sockets=[listener]))

    def end(self) -> None:
        """Stop the server soon; may be called from any thread."""
        self._is_ended = True
        if self._server is not None:
            self._server.should_exit = True


_SECOND: Final = 1e-9


def view_data(view: StackView) -> dict[str, Any]:
    """A stack without its log, with the transitions that are possible now."""
    data = monitor_data(view)
    del data["lines"]
    data["transitions"] = possible_transitions(view.state)
    data["started_s"] = wall_s() - view.uptime_s
    data["nodes"] = [
        {**node, "transitions": possible_transitions(node["state"])} for node in data["nodes"]
    ]
    return data


def lines_data(lines: Iterable[str]) -> list[str]:
    """Lines of a log without terminal sequences."""
    return [plain(line) for line in lines]


def samples_data(samples: Sequence[Sample]) -> list[list[float | None]]:
    """Rows of a time [s since 1970] and the values."""
    return [[at_ns * _SECOND, *values] for at_ns, values in samples]


def event(name: str, data: dict[str, Any]) -> str:
    """A message of an event stream.

    Source: https://html.spec.whatwg.org/multipage/server-sent-events.html
    """
    return f"event: {name}\ndata: {json_line(data)}\n\n"


LINK: Final = "the URL that `obk web` printed"
POLL_S: Final = 0.1
"""Period of polling for changes [s]."""
MOST_CURVES: Final = 12
CHANGE: Final = 'expected {"transition": "activate", "node": "/name", "run": "name_of_its_folder"}'
SETTING: Final = 'expected {"node": "/name", "name": "kp", "value": "2.5", "run": "its_folder"}'
SAVING: Final = 'expected {"run": "its_folder", "digest": "of the edit as shown"}'
PAGE: Final = Path(obk_cli.web.__file__).with_name("page")
LIBRARY: Final = Path(obk_cli.record.__file__).with_name("page")
"""The folder of uPlot, which `obk plot --html` uses too."""
KINDS: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}

FILES: Final[Mapping[str, Path]] = {
    **{path.name: path for path in PAGE.iterdir() if path.suffix in KINDS},
    **{name: LIBRARY / name for name in ("uPlot.iife.min.js", "uPlot.min.css")},
}
"""The files of the page, by the last part of their URL."""

History = Callable[[StackView, Sequence[FieldRequest]], list[dict[str, Any]]]
"""Reads fields over the whole run of a view's stack; returns the same as `recorded_fields`."""
Update = Callable[[StackView], ConfigUpdate]
"""Finds what the parameters of a view's stack change in its config."""
Change = Callable[[StackView, str, tuple[str, ...]], ChangeAnswer]
"""Takes nodes (full names) of a view's stack through a transition; no names: the whole stack."""


class FieldSource(Protocol):
    """The methods of `Plots` that the page uses."""

    def subscribed(self, requests: list[FieldRequest]) -> AbstractContextManager[None]:
        """Subscribe to these fields inside the `with` block."""
        ...

    def data_after(self, field_request: FieldRequest, after_ns: int) -> FieldData:
        """The data of a field after a time [ns since 1970]."""
        ...


class PageApi:
    """The requests of a page."""

    def __init__(
        self,
        snapshot: Callable[[], Snapshot],
        fields: FieldSource,
        history: History,
        change: Change,
        tuner: Tuner,
        update: Update,
        is_ending: Callable[[], bool],
    ) -> None:
        """Connect the page to its sources.

        Args:
            snapshot: returns the latest snapshot.
            fields: the fields that pages plot.
            history: reads fields from the recording of a run.
            change: executes transitions.
            tuner: reads and sets parameters.
            update: finds what the parameters change in the config.
            is_ending: whether the streams must end.
        """
        self._snapshot = snapshot
        self._fields = fields
        self._history = history
        self._change = change
        self._tuner = tuner
        self._update = update
        self._is_ending = is_ending

    async def graph(self, _: Request) -> Response:
        """Return the diagram of the stack."""
        return Response(self._snapshot().picture, media_type=KINDS[".svg"])

    async def fields(self, request: Request) -> Response:
        """Return the fields of a topic that can be plotted."""
        name = request.query_params.get("topic", "")
        view = self._snapshot().view
        types = {topic.topic: topic.msg_type for topic in view.topics} if view else {}
        msg_type = types.get(name)
        if msg_type is None:
            return _error_response(404, f"the type of {name} is not known")
        try:
            found = await run_in_threadpool(number_fields, short_type(msg_type), fields_of)
        except ObkError as error:
            return _error_response(404, _sentence(error))
        return JSONResponse({"type": msg_type, "fields": found})

    async def events(self, request: Request) -> Response:
        """Stream changes until the page closes; `curve=TOPIC FIELD` requests a field's values."""
        requests = _field_requests(request)
        if len(requests) > MOST_CURVES:
            return _error_response(400, f"more than {MOST_CURVES} curves")
        return StreamingResponse(self._events(requests), media_type="text/event-stream")

    async def history(self, request: Request) -> Response:
        """Return fields over the whole run, from its recording; `curve` as for `events`."""
        requests, view = _field_requests(request), self._snapshot().view
        if len(requests) > MOST_CURVES:
            return _error_response(400, f"more than {MOST_CURVES} curves")
        if view is None:
            return _error_response(404, "no stack is running")
        try:
            curves = await run_in_threadpool(self._history, view, requests)
        except ObkError as error:
            return _error_response(404, _sentence(error))
        return JSONResponse({"run": view.run, "curves": curves})

    async def change(self, request: Request) -> Response:
        """Execute a transition of a node or, if none is given, of the stack."""
        try:
            body = await request.json()
            transition, node, run = (str(body[key]) for key in ("transition", "node", "run"))
        except (ValueError, TypeError, KeyError):
            return _error_response(400, CHANGE)
        view = self._snapshot().view
        if transition not in TRANSITIONS:
            return _error_response(400, f"unknown transition `{transition}`")
        if view is not None and view.run != run:
            return _error_response(
                409, f"the stack of {run or 'another host'} is no longer running"
            )
        if view is None or (node and node not in {one.node for one in view.nodes}):
            return _error_response(404, f"no node {node}" if view else "no stack is running")
        try:
            answer = await run_in_threadpool(
                self._change, view, transition, (node,) if node else ()
            )
        except ObkError as error:
            answer = ChangeAnswer(success=False, why=_sentence(error))
        return JSONResponse(change_data(answer))

    async def parameters(self, _: Request) -> Response:
        """Return the tunable parameters of all nodes."""
        view = self._snapshot().view
        found = await run_in_threadpool(self._tuner.of, view) if view is not None else {}
        nodes = [
            {"node": node, "parameters": [parameter_data(one) for one in parameters]}
            for node, parameters in found.items()
        ]
        return JSONResponse({"run": view.run if view else "", "nodes": nodes})

    async def set_parameter(self, request: Request) -> Response:
        """Set a parameter of a node."""
        try:
            body = await request.json()
            node, name, text, run = (str(body[key]) for key in ("node", "name", "value", "run"))
        except (ValueError, TypeError, KeyError):
            return _error_response(400, SETTING)
        view = self._snapshot().view
        if view is None or node not in {one.node for one in view.nodes}:
            return _error_response(404, f"no node {node}" if view else "no stack is running")
        if view.run != run:
            return _error_response(
                409, f"the stack of {run or 'another host'} is no longer running"
            )
        try:
            changed = await run_in_threadpool(self._tuner.set, view, node, name, text)
        except ObkError as error:
            return JSONResponse({"success": False, "why": _sentence(error)})
        return JSONResponse({"success": True, "why": str(changed)})

    async def config_edit(self, _: Request) -> Response:
        """Return what saving the parameters would change in the config; write nothing."""
        view = self._snapshot().view
        if view is None:
            return _error_response(404, "no stack is running")
        try:
            update = await run_in_threadpool(self._update, view)
        except ObkError as error:
            return _error_response(404, _sentence(error))
        if update.findings:
            return _error_response(404, f"`{update.config}` has errors: run `obk validate`")
        return JSONResponse({"run": view.run, **update_data(update)})

    async def save_parameters(self, request: Request) -> Response:
        """Write the parameters into the config, if the edit is the one that was shown."""
        try:
            body = await request.json()
            run, digest = (str(body[key]) for key in ("run", "digest"))
        except (ValueError, TypeError, KeyError):
            return _error_response(400, SAVING)
        view = self._snapshot().view
        if view is None or view.run != run:
            return _error_response(409, f"the stack of {run} is no longer running")
        try:
            update = await run_in_threadpool(self._update, view)
            data = update_data(update)
            if update.findings or data["digest"] != digest:
                return _error_response(
                    409, "the values or the config have changed; nothing was written"
                )
            await run_in_threadpool(write_update, update)
        except ObkError as error:
            return JSONResponse({"success": False, "why": _sentence(error)})
        return JSONResponse({"success": True, "why": "\n".join(data["changes"])})

    async def _events(self, requests: list[FieldRequest]) -> AsyncIterator[str]:
        shown: Snapshot | None = None
        until_ns = dict.fromkeys(requests, 0)
        with self._fields.subscribed(requests):
            while not self._is_ending():
                snapshot = self._snapshot()
                if shown is None or snapshot.number != shown.number:
                    for text in _changes(shown, snapshot):
                        yield text
                    shown = snapshot
                if requests:
                    yield event("samples", self._samples(until_ns))
                await asyncio.sleep(POLL_S)

    def _samples(self, until_ns: dict[FieldRequest, int]) -> dict[str, Any]:
        """Return the samples since the last call; update the times in `until_ns`."""
        curves = []
        for field_request, after_ns in until_ns.items():
            received = self._fields.data_after(field_request, after_ns)
            if received.samples:
                until_ns[field_request] = received.samples[-1][0]
            curves.append(
                {
                    "curve": f"{field_request.topic} {field_request.field}",
                    "labels": list(received.labels),
                    "fault": received.fault,
                    "rows": samples_data(received.samples),
                }
            )
        return {"now_s": wall_s(), "curves": curves}


def make_app(site: PageApi, *, token: str, port: int) -> ASGIApp:
    """Create the application.

    Args:
        site: handles the requests.
        token: required in every request.
        port: port of the server, because cookies of a host apply to all its ports.
    """
    cookie = cookie_name(port)

    def page(_: Request) -> Response:
        answer = _file(PAGE / "index.html")
        answer.set_cookie(cookie, token, httponly=True, samesite="strict")
        return answer

    routes = [
        Route("/", page),
        *(Route(f"/{name}", lambda _, path=path: _file(path)) for name, path in FILES.items()),
        Route("/graph", site.graph),
        Route("/fields", site.fields),
        Route("/events", site.events),
        Route("/history", site.history),
        Route("/change", site.change, methods=["POST"]),
        Route("/parameters", site.parameters),
        Route("/parameter", site.set_parameter, methods=["POST"]),
        Route("/save", site.config_edit, methods=["GET"]),
        Route("/save", site.save_parameters, methods=["POST"]),
    ]
    return _AuthMiddleware(Starlette(routes=routes), token, cookie)


class _AuthMiddleware:
    """Rejects unauthorized requests, and adds the security headers to every response."""

    def __init__(self, app: ASGIApp, token: str, cookie: str) -> None:
        self._app = app
        self._token = token
        self._cookie = cookie

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        request = Request(scope)
        why = refusal(self._web_request(request), self._token, LINK)
        answer = self._app if why is None else PlainTextResponse(f"{why.why}\n", why.status)
        await answer(scope, receive, send_with_headers)

    def _web_request(self, request: Request) -> WebRequest:
        given = (
            request.cookies.get(self._cookie),
            request.headers.get("x-obk-token"),
            request.query_params.get(TOKEN),
        )
        return WebRequest(
            method=request.method,
            host=request.headers.get("host", ""),
            origin=request.headers.get("origin"),
            tokens=tuple(one for one in given if one is not None),
        )


def _changes(shown: Snapshot | None, snapshot: Snapshot) -> list[str]:
    """The events that update a page from one snapshot to the next."""
    view = snapshot.view
    if view is None:
        return [event("waiting", {})]
    data = view_data(view)
    data["is_waiting"] = snapshot.is_waiting
    data["has_picture"] = bool(snapshot.picture)
    changes = [event("view", data)]
    if shown is None or shown.view is None or shown.view.lines != view.lines:
        changes.append(event("log", {"lines": lines_data(view.lines)}))
    return changes


def _field_requests(request: Request) -> list[FieldRequest]:
    data = [text.partition(" ") for text in request.query_params.getlist("curve")]
    return [FieldRequest(topic=topic, field=field) for topic, _, field in dict.fromkeys(data)]


def _file(path: Path) -> Response:
    return Response(path.read_bytes(), media_type=KINDS[path.suffix])


def _error_response(status: int, why: str) -> Response:
    return JSONResponse({"success": False, "why": why, "members": []}, status)


def _sentence(error: ObkError) -> str:
    return f"{error.message}: {error.help}" if error.help else error.message
