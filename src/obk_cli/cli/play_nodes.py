"""Launch and record some nodes of a config: `python -m obk_cli.cli.play_nodes REQUEST`.

`obk play --real-time` starts it. The nodes follow `/clock`.
"""

import json
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from obelisk_spec.runtime_protocol import USE_SIM_TIME
from obk_cli.cli.build import on_overlays
from obk_cli.cli.config_options import make_options, valid_plan
from obk_cli.cli.launch_plan import gated_executables
from obk_cli.compiler import compile_config
from obk_cli.errors import EXIT_FAILED, ObkError
from obk_cli.launch.console import open_console
from obk_cli.launch.options import LaunchOptions, require_libraries
from obk_cli.launch.process_groups import share_of
from obk_cli.launch.run import run_plan
from obk_cli.plan.plan import Plan
from obk_cli.record.recorder_job import RecordRequest
from obk_cli.ros.environment import ros_environment

__all__ = ["NodesRequest"]


@dataclass(frozen=True, slots=True, kw_only=True)
class NodesRequest:
    """What to run."""

    config: str
    overrides: list[str]
    nodes: list[str]
    """Full names."""
    outputs: list[str]
    """Topics to record."""

    def to_json(self) -> str:
        """The request as the argument of this program."""
        return json.dumps(asdict(self))


def only_nodes(plan: Plan, names: list[str]) -> Plan:
    """The plan with these nodes only, all of which follow `/clock`."""
    chosen = (node for node in plan.nodes if node.full_name in names)
    return replace(
        plan,
        nodes=tuple(
            replace(node, parameters={**node.parameters, USE_SIM_TIME: True}) for node in chosen
        ),
    )


def _run(request: NodesRequest) -> int:
    outcome = compile_config(request.config, make_options(request.overrides, None))
    plan = only_nodes(valid_plan(outcome, "never"), request.nodes)
    share = share_of(plan, None)
    require_libraries(plan, share)
    folder = Path(request.config).resolve().parent
    environment = ros_environment("localhost")
    packages, environment = on_overlays(folder, environment, plan, may_build=True, color="never")
    options = LaunchOptions(
        config=request.config,
        folder=Path.cwd(),
        share=share,
        recording=RecordRequest(topics=dict.fromkeys(request.outputs)),
        gated_executables=gated_executables(plan, outcome.environment),
    )
    with open_console(
        sys.stdout.fileno(), as_json=False, colour=False, quiet=False, terminal=""
    ) as console:
        return run_plan(plan, packages, environment, options, console).exit_code


def main(arguments: list[str]) -> int:
    """Run a request; return the exit code."""
    try:
        return _run(NodesRequest(**json.loads(arguments[0])))
    except ObkError as error:
        print(f"error: {error.message}" + (f"\n  help: {error.help}" if error.help else ""))
        return EXIT_FAILED


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
