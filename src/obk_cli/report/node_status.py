"""How one node of a running stack is, in words: its state, its process, what is out of order."""

from obelisk_spec.suggestions import with_number
from obk_cli.runs.protocol import NodeStatus

__all__ = ["status_text"]


def status_text(node: NodeStatus) -> str:
    """The words behind a node's name, on one line."""
    return "  ".join(
        [
            f"{node.state or 'no life cycle':<13}",
            f"process {node.pid}" if node.pid is not None else "not running here",
            *(["HANGS"] if node.hangs else ()),
            *([f"started again {with_number(node.restarts, 'time')}"] if node.restarts else ()),
        ]
    )
