"""What a joined node was wired to, for people and as plain values.

A `Joined` in; lines, or values for JSON, out. Never prints.
"""

from collections.abc import Iterator

from obk_cli.joining.choose import Link
from obk_cli.joining.join import Joined

__all__ = ["joined_lines", "joined_values"]


def joined_lines(joined: Joined, *, is_done: bool = True) -> tuple[str, ...]:
    """The node, a line for each of its ends and timers, and what else there is to know."""
    verb = "added to" if is_done else "would be added to"
    width = max((len(name) for name in _names(joined)), default=0)
    lines = [f"`{joined.node_name}` {verb} {joined.source.path}:"]
    for link in joined.links:
        arrow = "->" if link.end.direction == "publishes" else "<-"
        end = f"{link.written} ({link.end.spelling}){_peers(link)}"
        lines.append(f"  {link.end.component:<{width}} {arrow} {end}")
        lines += [f"  {'':<{width}}    {note}" for note in _notes(link)]
    for tick in joined.ticks:
        period = f"every {tick.period_s:g} s, {tick.origin}"
        lines.append(f"  {tick.component:<{width}} {period}")
    return (*lines, *(f"note: {note}" for note in joined.notes))


def joined_values(joined: Joined) -> dict[str, object]:
    """The same for programs."""
    return {
        "config": joined.source.path,
        "node": joined.node_name,
        "links": [
            {
                "component": link.end.component,
                "direction": link.end.direction,
                "topic": link.topic,
                "msg_type": link.end.msg_type,
                "with": list(link.peers),
                "notes": list(_notes(link)),
            }
            for link in joined.links
        ],
        "timers": [
            {"component": tick.component, "period_s": tick.period_s, "from": tick.origin}
            for tick in joined.ticks
        ],
        "notes": list(joined.notes),
    }


def _names(joined: Joined) -> Iterator[str]:
    yield from (link.end.component for link in joined.links)
    yield from (tick.component for tick in joined.ticks)


def _peers(link: Link) -> str:
    if not link.peers:
        return ""
    verb = "to" if link.end.direction == "publishes" else "from"
    return f" {verb} {', '.join(f'`{peer}`' for peer in link.peers)}"


def _notes(link: Link) -> Iterator[str]:
    yield from link.notes
    if link.switch is not None:
        yield (
            f"to switch over write it at {link.switch.place}, where `{link.switch.reader}` "
            f"listens, or let the new node replace `{link.switch.writer}`"
        )
