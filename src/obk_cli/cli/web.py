"""`obk web`: a running stack as a page in the browsers of this host."""

import os
import threading
import webbrowser
from typing import Annotated, Final

import typer

from obk_cli.cli.looking_options import TIMEOUT_S, DomainOption, here, with_types
from obk_cli.errors import EXIT_DONE
from obk_cli.monitor.stack_follower import Target, Watcher
from obk_cli.optional_deps import require_extra
from obk_cli.runs.folder import runs_folder

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk web --open"
PORT: Final = 8420
PERIOD_S: Final = 0.5


def command(
    run: Annotated[
        str | None, typer.Option(help="The stack, by its config's name or its run folder's.")
    ] = None,
    domain: DomainOption = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Of this host; 0: one that is free.")
    ] = PORT,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
) -> None:
    """Show a running stack as a page: states with buttons, the graph with rates, plots, the log.

    Prints the page's address and serves until Ctrl-C, for browsers of this host only; from another
    one `ssh -L 8420:127.0.0.1:8420 HOST` leads here. Whoever has the address, with its token, can
    move the robot. Where no stack runs, and when one has ended, the page waits for the next.
    """
    for module in ("starlette", "uvicorn"):
        require_extra(module, "web")
    target = Target(environment=here(domain, TIMEOUT_S).environment, domain=domain, run=run)
    is_there = target.choose(target.place()) is not None

    from obk_cli.adapters.web_app import TICKET, TOKEN, Site, make_app
    from obk_cli.adapters.web_server import HOST, WebServer, take_port
    from obk_cli.web.feed import Feed
    from obk_cli.web.guard import Ticket, new_token
    from obk_cli.web.plots import Plots

    with take_port(port) as taken:
        number, token = taken.getsockname()[1], new_token()
        server, plots = WebServer(), Plots()
        watcher = Watcher(target, with_types, PERIOD_S, beside=plots.turn)
        feed = Feed(watcher, runs_folder(os.environ), server.end)
        site = Site(lambda: feed.moment, plots, target.change, lambda: server.is_ending)
        ticket = Ticket(word=new_token(), user=os.geteuid()) if open_ else None
        url = f"http://{HOST}:{number}/?"
        print(f"the stack is shown at {url}{TOKEN}={token}\nCtrl-C ends", flush=True)
        if run is not None and not is_there:
            print(f"no stack `{run}` runs on this host yet: the page waits for it", flush=True)
        feed.start()
        if ticket is not None:
            # Some browsers are waited for, and they wait for the page.
            address = f"{url}{TICKET}={ticket.word}"
            threading.Thread(target=webbrowser.open, args=[address], daemon=True).start()
        server.run(make_app(site, token=token, port=number, ticket=ticket), taken)
        feed.stop()
    raise typer.Exit(EXIT_DONE)
