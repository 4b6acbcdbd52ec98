"""What is meant by the device and the node that the user named.

Names as typed and the stack in; the device or the node out, or what would be right.
"""

from obelisk_spec.suggestions import did_you_mean, list_names
from obk_cli.config.model import ONE_DEVICE, Node, Stack
from obk_cli.config.tree import TreeMap
from obk_cli.joining.newcomer import Newcomer
from obk_cli.joining.refusal import Refused
from obk_cli.migrate.shape import devices_of

__all__ = ["choose_device", "find_double", "find_replaced"]


def find_replaced(stack: Stack, section: str, name: str) -> Node | Refused:
    """The node of a section by its name, in full or not, or by its executable."""
    nodes = list(stack.section(section))
    exact = [node for node in nodes if name in _names(node)] or [
        node for node in nodes if node.executable and name == node.executable.value
    ]
    if len(exact) == 1:
        return exact[0]
    if exact:
        return Refused(
            sentence=f"`{name}` is {len(exact)} nodes of `{section}`",
            help=f"say which: {list_names(node.node_name for node in exact)}",
        )
    names = [node.node_name for node in nodes]
    return Refused(
        sentence=f"section `{section}` has no node `{name}` to replace",
        help=did_you_mean(name, names) or "it has no node at all: add one",
    )


def choose_device(tree: TreeMap, stack: Stack, wanted: str | None) -> str | Refused:
    """The device that is wanted, or the only one."""
    here = (entry.key for entry in devices_of(tree))
    known = list(dict.fromkeys((*here, *(node.device for node in stack.nodes)))) or [ONE_DEVICE]
    if wanted in known:
        return wanted
    if wanted is not None:
        help = did_you_mean(wanted, known) or ""
        return Refused(sentence=f"the config has no device `{wanted}`", help=help)
    if len(known) > 1:
        return Refused(
            sentence=f"the config has {len(known)} devices, and the new node runs on one",
            help=f"say which: {list_names(known)}",
        )
    return known[0]


def find_double(stack: Stack, newcomer: Newcomer, old: Node | None) -> Refused | None:
    """The refusal of a node that is in the config already, unless it is the one that goes."""
    for node in stack.section(newcomer.section):
        if node is old or node.pkg is None or node.executable is None:
            continue
        if (node.pkg.value, node.executable.value) == (newcomer.pkg, newcomer.executable):
            return Refused(
                sentence=f"`{newcomer.executable}` of package `{newcomer.pkg}` is in the config "
                f"already, as `{node.full_name}` ({node.span})",
                help="leave it as it is, or choose another name for the new node",
            )
    return None


def _names(node: Node) -> tuple[str, ...]:
    own = (node.name.value,) if node.name else ()
    return (node.full_name, node.node_name, *own)
