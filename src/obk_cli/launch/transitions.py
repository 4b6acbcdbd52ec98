"""The transitions that lead a node up and down, one by one."""

from obk_cli.runs.lifecycle import ACTIVE, INACTIVE, TRANSITIONS, UNCONFIGURED, Transition

__all__ = ["way_down", "way_up"]


def way_up(state: str) -> tuple[Transition, ...]:
    """The transitions that lead from `unconfigured` to a state; none to where none lead."""
    names = {INACTIVE: ("configure",), ACTIVE: ("configure", "activate")}
    return tuple(TRANSITIONS[name] for name in names.get(state, ()))


def way_down(state: str) -> tuple[Transition, ...]:
    """The transitions that lead from a state to `finalized`, one by one."""
    names = {
        ACTIVE: ("deactivate", "cleanup", "shutdown"),
        INACTIVE: ("cleanup", "shutdown"),
        UNCONFIGURED: ("shutdown",),
    }
    return tuple(TRANSITIONS[name] for name in names.get(state, ()))
