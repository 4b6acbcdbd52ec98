"""OBK108, OBK321: a simulator gets one `sim` block, under the parameter that it reads."""

from collections.abc import Iterator

from obk_cli.check.context import CheckContext
from obk_cli.config import SIM_PARAMETER, Node, Sim
from obk_cli.diagnostics import Diagnostic, Related, found

__all__ = ["check_sim_blocks"]


def check_sim_blocks(context: CheckContext) -> Iterator[Diagnostic]:
    """No block takes the place of another, and the simulator has one."""
    for node in context.stack.section("robot"):
        yield from _check_twice(node)
        if not node.is_simulator:
            continue
        if node.is_simulated is not None and not node.is_simulated.value:
            yield found(
                "OBK321",
                f"`{node.node_name}` is a simulator, and `is_simulated: false` leaves out its "
                "`sim` block",
                node.is_simulated.span,
                help="remove this line, or name the executable of the hardware",
            )
        else:
            yield from _check_given(node)


def _check_twice(node: Node) -> Iterator[Diagnostic]:
    seen: dict[str, Sim] = {}
    for sim in node.sims:
        first = seen.setdefault(sim.parameter, sim)
        if first is not sim:
            yield found(
                "OBK108",
                f"two `sim` blocks of `{node.node_name}` go into the parameter `{sim.parameter}`",
                sim.span,
                help="remove one, or give it the `ros_parameter` that the code declares for it",
                related=(Related(message="the first one", span=first.span),),
            )


def _check_given(node: Node) -> Iterator[Diagnostic]:
    assert node.executable is not None  # it is the simulator's
    given = {*(sim.parameter for sim in node.sims), *(p.name for p in node.params)}
    if SIM_PARAMETER in given:
        return
    other = next((sim.ros_parameter for sim in node.sims if sim.ros_parameter), None)
    if other is None:
        yield found(
            "OBK321",
            f"`{node.node_name}` is a simulator and has no `sim` block",
            node.executable.span,
            help="add `sim: {model_xml_path: ...}`",
        )
    else:
        yield found(
            "OBK321",
            f"the simulator reads its block from `{SIM_PARAMETER}`, this one goes into "
            f"`{other.value}`",
            other.span,
            help="leave `ros_parameter` out",
        )
