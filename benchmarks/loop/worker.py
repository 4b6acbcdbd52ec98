"""A process of nodes: `python -m benchmarks.loop.worker CONTESTANT RATE_HZ JOINTS RECORD NAME...`.

Writes `ready` to its standard output once a message has come to each of its nodes. When its
standard input ends it writes what the nodes noted to the file RECORD, and ends.
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
    """The nodes of a process, whatever they are made of."""

    def spin(self) -> None:
        """Run until `end`."""

    def have_heard(self) -> bool:
        """Whether a message came to each of them."""

    def records(self) -> list[NodeRecord]:
        """What was noted."""

    def end(self) -> None:
        """Let `spin` come back."""


def main() -> None:
    """Run the nodes that the command line names."""
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
    """Report when the nodes are ready, and end them when they are not needed any more."""
    while not nodes.have_heard():
        if select.select([sys.stdin], [], [], LOOK_EVERY_S)[0]:
            os._exit(1)  # no process waits for it any more, and the nodes may not exist yet
    print("ready", flush=True)
    sys.stdin.buffer.read()
    write_records(path, nodes.records())
    nodes.end()


if __name__ == "__main__":
    main()
