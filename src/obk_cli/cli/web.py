"""`obk web`: show a running stack as a page in a browser on this host."""

import html
import os
import threading
import webbrowser
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Final

import typer

from obk_cli.cli.options import TIMEOUT_S, DomainOption, graph_target, with_types
from obk_cli.errors import EXIT_DONE
from obk_cli.monitor.parameters import StackParameters
from obk_cli.monitor.stack_follower import StackFollower, StackSelector
from obk_cli.optional_deps import require_extra
from obk_cli.process.signals import handle_end_signals
from obk_cli.runs.folder import runs_folder

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk web --open"
PORT: Final = 8420
PERIOD_S: Final = 0.5


def command(
    run: Annotated[
        str | None,
        typer.Option(metavar="RUN", help="Stack, by the name of its config or run folder."),
    ] = None,
    domain: DomainOption = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port on this host; 0 for any free port.")
    ] = PORT,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
) -> None:
    """Show a running stack as a page: states with buttons, the parameters, rates, plots, the log.

    The command prints the page's URL with its token and serves browsers on this host until Ctrl-C;
    to use another host, run `ssh -L 8420:127.0.0.1:8420 HOST` there. Anyone who has the URL can
    move the robot. If no stack is running, the page waits for the next one.
    """
    for module in ("starlette", "uvicorn"):
        require_extra(module, "web")
    target = StackSelector(
        environment=graph_target(domain, TIMEOUT_S).environment, domain=domain, run=run
    )
    is_there = target.find_run(target.graph_target()) is not None

    from obelisk_spec.page_access import TOKEN, new_token
    from obk_cli.web.app import HOST, PageApi, WebServer, make_app, take_port
    from obk_cli.web.feed import Feed
    from obk_cli.web.history import recorded_fields
    from obk_cli.web.plots import Plots
    from obk_cli.web.saving import update_of_stack

    with take_port(port) as listener, ExitStack() as temporary:
        number, token = listener.getsockname()[1], new_token()
        server, plots = WebServer(), Plots()
        runs = runs_folder(os.environ)
        follower = StackFollower(target, with_types, PERIOD_S, on_turn=plots.turn)
        feed = Feed(follower, runs, server.end)
        site = PageApi(
            lambda: feed.snapshot,
            plots,
            lambda view, requests: recorded_fields(view, runs, requests),
            target.change,
            StackParameters(runs),
            lambda view: update_of_stack(view, runs, target.environment, os.environ),
            lambda: server.is_ending,
        )
        url = f"http://{HOST}:{number}/?{TOKEN}={token}"
        feed.start()
        # From here on, Ctrl-C is the normal way to exit. An exception would leave a half-built
        # event loop.
        with handle_end_signals(lambda _signal: server.end()):
            print(f"serving the stack at {url}\nCtrl-C stops the server", flush=True)
            if run is not None and not is_there:
                print(f"no stack `{run}` is running here yet; the page waits for it", flush=True)
            if open_:
                folder = temporary.enter_context(TemporaryDirectory(prefix="obk_web_"))
                address = _redirect(Path(folder), url).as_uri()
                # Some browsers block the call until the page has loaded.
                threading.Thread(target=webbrowser.open, args=[address], daemon=True).start()
            server.run(make_app(site, token=token, port=number), listener)
        feed.stop()
    raise typer.Exit(EXIT_DONE)


def _redirect(folder: Path, url: str) -> Path:
    """Create a file that redirects a browser to `url`, in a folder that only this user can read.

    Any user of the host can read the command line of a browser, so the token must not be in it.
    Jupyter does the same.
    """
    target = html.escape(url, quote=True)
    path = folder / "open.html"
    path.write_text(
        f'<!doctype html><meta charset="utf-8"><title>obk web</title>'
        f'<meta http-equiv="refresh" content="0;url={target}"><a href="{target}">obk web</a>\n'
    )
    return path
