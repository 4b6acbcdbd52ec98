"""Which part of a stack a launch runs, and which launch leads where there are several."""

from dataclasses import dataclass

from obk_cli.plan.plan import Plan

__all__ = ["Share", "devices_of", "share_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """What one launch has of a stack."""

    devices: frozenset[str]
    """Those whose nodes run here."""
    is_part: bool
    """Whether other devices are left to other launches."""
    leads: bool = True
    """Whether the nodes of all devices are taken through their transitions from here."""


def devices_of(plan: Plan) -> tuple[str, ...]:
    """The devices of a stack, in the order of the config."""
    return tuple(dict.fromkeys(node.device for node in plan.processes))


def share_of(plan: Plan, device: str | None, lead: str | None = None) -> Share:
    """The part of one device, or the whole stack.

    Args:
        plan: the whole stack.
        device: one of its devices; None: all of them run here.
        lead: the device that leads; None: the first one with a controller, else the first one.
    """
    devices = devices_of(plan)
    if device is None or devices == (device,):
        return Share(devices=frozenset(devices), is_part=False)
    with_control = [node.device for node in plan.processes if node.section == "control"]
    leader = lead or next(iter(with_control), devices[0])
    return Share(
        devices=frozenset({device}),
        is_part=True,
        leads=leader == device,
    )
