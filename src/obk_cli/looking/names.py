"""Which topic, node or service a user means: by its name, or by the end of it. Pure."""

from collections.abc import Collection, Iterable
from typing import Literal

from obelisk_spec.suggestions import did_you_mean, list_names, near_names
from obk_cli.errors import CommandFailedError

__all__ = ["Kind", "absolute", "meant", "one_meant"]

Kind = Literal["topic", "node", "service"]


def absolute(name: str) -> str:
    """The name with a slash before it."""
    return name if name.startswith("/") else f"/{name}"


def meant(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """The known full names that a name may stand for.

    The very one, else those that end in it: `est` for `/obelisk/dummy/est`, `control_0` for
    `/obelisk_control_0`.
    """
    every = tuple(dict.fromkeys(known))
    if absolute(name) in every:
        return (absolute(name),)
    if name.startswith("/"):
        return ()
    return tuple(one for one in every if one.endswith((f"/{name}", f"/obelisk_{name}")))


def one_meant(kind: Kind, name: str, known: Collection[str], domain: int) -> str:
    """The one full name that is meant.

    Args:
        kind: what it is the name of.
        name: as a user gives it.
        known: full names that are there.
        domain: the ROS domain in which they are.

    Raises:
        CommandFailedError: there is none, or there are several.
    """
    fitting = meant(name, known)
    if len(fitting) > 1:
        raise CommandFailedError(
            f"`{name}` means several {kind}s", help=f"name one of {list_names(fitting)}"
        )
    if not fitting:
        raise CommandFailedError(
            f"there is no {kind} `{name}` in the ROS domain {domain}",
            help=_near(name, sorted(known)),
        )
    return fitting[0]


def _near(name: str, known: Collection[str]) -> str | None:
    """What may be meant, by whole names or by their last parts; else what there is."""
    tails = {full.rpartition("/")[2].removeprefix("obelisk_"): full for full in known}
    near = [] if name.startswith("/") else [tails[tail] for tail in near_names(name, tails)]
    if near and not near_names(name, known):
        return f"did you mean {' or '.join(f'`{full}`' for full in near)}?"
    return did_you_mean(name, known)
