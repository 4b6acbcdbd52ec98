"""The page of a running stack over HTTP, by starlette: files, a stream of events, transitions.

`web.guard` checks every request before anything else. The stream looks ten times a second
at what the watching thread has put down; transitions wait in threads of their own.
"""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Final, Protocol

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

import obk_cli.web
from obk_cli.clock import wall_s
from obk_cli.errors import ObkError
from obk_cli.monitor.model import StackView
from obk_cli.ros.types import fields_of, short_type
from obk_cli.runs.lifecycle import TRANSITIONS
from obk_cli.runs.protocol import ChangeAnswer, change_data
from obk_cli.web.data import event, lines_data, samples_data, view_data
from obk_cli.web.feed import Moment
from obk_cli.web.guard import HEADERS, WebRequest, refusal
from obk_cli.web.traces import Heard, Wish, number_fields

__all__ = ["TOKEN", "Change", "Drawn", "Site", "make_app"]

TOKEN: Final = "token"  # noqa: S105 - the word in front of it
"""The URL's parameter; the cookie `obk_PORT` and the header `X-Obk-Token` hold the same value."""
LOOK_S: Final = 0.1
"""Between two looks at what there is to tell [s]."""
MOST_CURVES: Final = 12
CHANGE: Final = 'expected {"transition": "activate", "node": "/name", "run": "name_of_its_folder"}'
PAGE: Final = Path(obk_cli.web.__file__).with_name("page")
KINDS: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}

Change = Callable[[StackView, str, tuple[str, ...]], ChangeAnswer]
"""Takes nodes, by full names, of a view's stack through a transition; without any the stack."""


class Drawn(Protocol):
    """What `Plots` offers."""

    def wanted(self, wishes: list[Wish]) -> AbstractContextManager[None]:
        """While entered, these fields are heard."""
        ...

    def heard(self, wish: Wish, after_ns: int) -> Heard:
        """What came of one after a time [ns since 1970]."""
        ...


class Site:
    """What a page can ask for."""

    def __init__(
        self,
        moment: Callable[[], Moment],
        drawn: Drawn,
        change: Change,
        is_ending: Callable[[], bool],
    ) -> None:
        """Join what is behind the page.

        Args:
            moment: what there is to show now.
            drawn: the fields that pages draw.
            change: carries transitions out.
            is_ending: whether the streams are to end.
        """
        self._moment = moment
        self._drawn = drawn
        self._change = change
        self._is_ending = is_ending

    async def graph(self, _: Request) -> Response:
        """The picture of the stack."""
        return Response(self._moment().picture, media_type=KINDS[".svg"])

    async def fields(self, request: Request) -> Response:
        """The fields of a topic that can be drawn."""
        name = request.query_params.get("topic", "")
        view = self._moment().view
        types = {topic.topic: topic.msg_type for topic in view.topics} if view else {}
        msg_type = types.get(name)
        if msg_type is None:
            return _refused(404, f"the type of {name} is not known")
        try:
            found = await run_in_threadpool(number_fields, short_type(msg_type), fields_of)
        except ObkError as error:
            return _refused(404, _sentence(error))
        return JSONResponse({"type": msg_type, "fields": found})

    async def events(self, request: Request) -> Response:
        """What changes, until the page is closed; `curve=TOPIC FIELD` asks for a field's values."""
        told = [text.partition(" ") for text in request.query_params.getlist("curve")]
        wishes = [Wish(topic=topic, field=field) for topic, _, field in dict.fromkeys(told)]
        if len(wishes) > MOST_CURVES:
            return _refused(400, f"more than {MOST_CURVES} curves")
        return StreamingResponse(self._events(wishes), media_type="text/event-stream")

    async def change(self, request: Request) -> Response:
        """A transition of a node or, without one, of the stack."""
        try:
            asked = await request.json()
            transition, node, run = (str(asked[key]) for key in ("transition", "node", "run"))
        except (ValueError, TypeError, KeyError):
            return _refused(400, CHANGE)
        view = self._moment().view
        if transition not in TRANSITIONS:
            return _refused(400, f"there is no transition `{transition}`")
        if view is not None and view.run != run:
            return _refused(409, f"the stack of {run or 'another host'} is not what runs now")
        if view is None or (node and node not in {one.node for one in view.nodes}):
            return _refused(404, f"there is no node {node}" if view else "no stack runs")
        try:
            answer = await run_in_threadpool(
                self._change, view, transition, (node,) if node else ()
            )
        except ObkError as error:
            answer = ChangeAnswer(success=False, why=_sentence(error))
        return JSONResponse(change_data(answer))

    async def _events(self, wishes: list[Wish]) -> AsyncIterator[str]:
        shown: Moment | None = None
        until_ns = dict.fromkeys(wishes, 0)
        with self._drawn.wanted(wishes):
            while not self._is_ending():
                moment = self._moment()
                if shown is None or moment.number != shown.number:
                    for text in _news(shown, moment):
                        yield text
                    shown = moment
                if wishes:
                    yield event("samples", self._samples(until_ns))
                await asyncio.sleep(LOOK_S)

    def _samples(self, until_ns: dict[Wish, int]) -> dict[str, Any]:
        """What came since the last time, which is noted."""
        curves = []
        for wish, after_ns in until_ns.items():
            heard = self._drawn.heard(wish, after_ns)
            if heard.samples:
                until_ns[wish] = heard.samples[-1][0]
            curves.append(
                {
                    "curve": f"{wish.topic} {wish.field}",
                    "labels": list(heard.labels),
                    "fault": heard.fault,
                    "rows": samples_data(heard.samples),
                }
            )
        return {"now_s": wall_s(), "curves": curves}


def make_app(site: Site, *, token: str, port: int) -> ASGIApp:
    """The application.

    Args:
        site: what a page can ask for.
        token: that a request has to know.
        port: of the server; cookies of one host are those of all its ports.
    """
    cookie = f"obk_{port}"

    def page(_: Request) -> Response:
        answer = _file("index.html")
        answer.set_cookie(cookie, token, httponly=True, samesite="strict")
        return answer

    files = [path.name for path in PAGE.iterdir() if path.suffix in KINDS]
    routes = [
        Route("/", page),
        *(Route(f"/{name}", lambda _, name=name: _file(name)) for name in files),
        Route("/graph", site.graph),
        Route("/fields", site.fields),
        Route("/events", site.events),
        Route("/change", site.change, methods=["POST"]),
    ]
    return _Guarded(Starlette(routes=routes), token, cookie)


class _Guarded:
    """Refuses requests, and adds the headers that all answers have."""

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
        why = refusal(self._asked(request), self._token)
        answer = self._app if why is None else PlainTextResponse(f"{why.why}\n", why.status)
        await answer(scope, receive, send_with_headers)

    def _asked(self, request: Request) -> WebRequest:
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


def _news(shown: Moment | None, moment: Moment) -> list[str]:
    """What a page that has seen one moment is told of another."""
    view = moment.view
    if view is None:
        return [event("waiting", {})]
    told = view_data(view)
    told["is_waiting"] = moment.is_waiting
    told["has_picture"] = bool(moment.picture)
    news = [event("view", told)]
    if shown is None or shown.view is None or shown.view.lines != view.lines:
        news.append(event("log", {"lines": lines_data(view.lines)}))
    return news


def _file(name: str) -> Response:
    path = PAGE / name
    return Response(path.read_bytes(), media_type=KINDS[path.suffix])


def _refused(status: int, why: str) -> Response:
    return JSONResponse({"success": False, "why": why, "members": []}, status)


def _sentence(error: ObkError) -> str:
    return f"{error.message}: {error.help}" if error.help else error.message
