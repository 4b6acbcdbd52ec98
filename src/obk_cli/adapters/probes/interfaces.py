"""The compiled messages of Obelisk: loaded in a process of their own, compared with sources."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import obk_cli
from obelisk_spec.messages import OBELISK_MESSAGES
from obk_cli.adapters.probes.child import python_command, told_in_json, try_program
from obk_cli.doctor.interfaces import InterfaceFacts
from obk_cli.optional_deps import distribution_version

__all__ = ["probe_interfaces"]

LOAD_S: Final = 20.0


def probe_interfaces() -> InterfaceFacts:
    """Load every package's compiled part, and look whether its definitions changed since."""
    command = python_command("obk_cli.adapters.probes.interfaces_program", *OBELISK_MESSAGES)
    trial = try_program(command, timeout_s=LOAD_S)
    not_told = f"the process that loaded them {trial.told}"
    answers: dict[str, str] = told_in_json(trial) or dict.fromkeys(OBELISK_MESSAGES, not_told)
    sources = Path(obk_cli.__file__).resolve().parents[2] / "interfaces"
    return InterfaceFacts(
        version=distribution_version("obelisk-interfaces"),
        faults={package: fault for package, fault in answers.items() if fault},
        loaded=tuple(package for package, fault in answers.items() if not fault),
        stale=tuple(_stale(sources, Path(sys.prefix) / "share")),
        has_sources=sources.is_dir(),
    )


def _stale(sources: Path, share: Path) -> Iterator[str]:
    """Definitions whose installed copy is another text, or not there."""
    for package in OBELISK_MESSAGES:
        installed = share / package
        if not installed.is_dir():
            continue  # it comes from a ROS 2 that is sourced
        for source in sorted((sources / package).glob("*/*.[ms][sr][gv]")):
            name = source.relative_to(sources)
            copy = share / name
            if not copy.is_file() or copy.read_bytes() != source.read_bytes():
                yield str(name)
