"""Run nodes: `python -m benchmarks.loop.worker CONTESTANT RATE_HZ JOINTS RECORD NAME...`.

It prints `ready` after each of its nodes has received a message. When its standard input is closed,
writes the nodes' records to the file RECORD and exits.
"""

import os
import select
import sys
import threading
from pathlib import Path
from typing import Protocol

from benchmarks.loop.cases import LIBRARY
from benchmarks.loop.record import NodeRecord, write_records

__all__ = ["main"]

LOOK_EVERY_S = 0.02


class Nodes(Protocol):
    """All nodes of a process, of any contestant."""

    def spin(self) -> None:
        """Run until `end`."""

    def have_received(self) -> bool:
        """Whether each node has received a message."""

    def records(self) -> list[NodeRecord]:
        """The records of all nodes."""

    def end(self) -> None:
        """Make `spin` return."""


def main() -> None:
    """Run the nodes given on the command line."""
    contestant, rate_hz, joints, path, *names = sys.argv[1:]
    nodes: Nodes
    if contestant == LIBRARY:
        from benchmarks.loop.library_nodes import LibraryNodes

        nodes = LibraryNodes(names, int(rate_hz), int(joints))
    else:
        from benchmarks.loop.plain_nodes import PlainNodes

        nodes = PlainNodes(names, contestant, int(rate_hz), int(joints))
    threading.Thread(target=attend, args=(nodes, Path(path)), daemon=True).start()
    nodes.spin()


def attend(nodes: Nodes, path: Path) -> None:
    """Report when the nodes are ready, and stop them when standard input is closed."""
    while not nodes.have_received():
        if select.select([sys.stdin], [], [], LOOK_EVERY_S)[0]:
            os._exit(1)  # the parent has exited, and the nodes may not exist yet
    print("ready", flush=True)
    sys.stdin.buffer.read()
    write_records(path, nodes.records())
    nodes.end()


if __name__ == "__main__":
    main()
