"""A run's folder: claimed before anything starts, told how the run ended."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from obk_cli.adapters.claims import claim_run
from obk_cli.adapters.clock import local_time, wall_s
from obk_cli.adapters.process_start import this_process
from obk_cli.adapters.ros_environment import RosEnvironment
from obk_cli.adapters.versions import run_versions
from obk_cli.emit.plan_json import emit_plan
from obk_cli.errors import ObkError
from obk_cli.launch.events import Ended
from obk_cli.launch.runs import MadeFrom, Run, note_end, runs_folder
from obk_cli.plan.plan import Plan
from obk_cli.running.options import LaunchOptions
from obk_cli.running.output import Output

__all__ = ["Claim", "claimed"]


@dataclass(slots=True, kw_only=True)
class Claim:
    """A run's folder, and what is told of the run there."""

    run: Run
    folder: Path | None
    fault: OSError | None = None
    """Why there is no folder."""
    ended: Ended | None = None

    def tell(self, output: Output) -> None:
        """Say where the logs are, or why there are none."""
        if self.fault is not None:
            output.unwritable(self.fault)
        else:
            output.note(f"{self.run.name}: logs in {self.folder}")


@contextmanager
def claimed(plan: Plan, environment: RosEnvironment, options: LaunchOptions) -> Iterator[Claim]:
    """While entered, this launch has its nodes' names on this machine.

    Raises:
        CommandFailedError: the stack or one of its nodes runs already.
    """
    run = _run(plan, environment, options)
    try:
        folder = claim_run(
            runs_folder(environment.variables),
            run,
            local_time(),
            made_from=MadeFrom(plan=emit_plan(plan), versions=run_versions()),
            keep=options.kept_runs,
            replace_other=options.replaces,
        )
    except OSError as error:
        yield Claim(run=run, folder=None, fault=error)
        return
    claim = Claim(run=run, folder=folder)
    try:
        yield claim
    except ObkError as error:
        claim.ended = Ended(exit_code=error.exit_code, cause=error.message)
        raise
    finally:
        # Where it cannot be noted, the launcher's end will tell.
        with suppress(OSError):
            note_end(folder, run, claim.ended, wall_s())


def _run(plan: Plan, environment: RosEnvironment, options: LaunchOptions) -> Run:
    pid, started = this_process()
    devices = options.share.devices
    tiers = [[p for p in tier if p.device in devices] for tier in plan.tiers]
    return Run(
        name=plan.name,
        pid=pid,
        started=started,
        domain=environment.domain,
        config=options.config,
        nodes=tuple(p.full_name for tier in tiers for p in tier if p.has_lifecycle),
        other_nodes=tuple(p.full_name for tier in tiers for p in tier if not p.has_lifecycle),
        devices=tuple(sorted(devices)) if options.share.is_part else (),
        leads=options.share.leads,
    )
