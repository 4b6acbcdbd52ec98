"""What was made, for people and for programs.

In: the answers, the decisions, how the folder is called from here. Out: text. Never prints.
"""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import PurePath

from obk_cli.scaffold.decide import Decision
from obk_cli.scaffold.questions import Answers
from obk_cli.scaffold.snippet import SECTIONS, config_snippet

__all__ = ["Outcome", "describe_json", "describe_text"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """A run of `obk new`; `folder` and `programs` are as the user would type them."""

    answers: Answers
    folder: str
    decisions: tuple[Decision, ...]
    dry_run: bool
    programs: str
    """In front of `python` and `obk`: empty in an active environment, else its `bin/`."""

    @property
    def next_commands(self) -> tuple[str, str]:
        """What to type now."""
        test = PurePath(self.folder, "test", f"test_{self.answers.node}.py")
        return (f"{self.programs}python -m pytest {test}", f"{self.programs}obk launch CONFIG")


def describe_text(outcome: Outcome) -> str:
    """The tree with what happened to each file, the piece of config, the next two commands."""
    answers = outcome.answers
    verb = "would make" if outcome.dry_run else "made"
    test, launch = outcome.next_commands
    return "\n".join(
        [
            f"{verb} the {answers.kind} `{answers.node}`, package `{answers.package}`, "
            f"in {outcome.folder}/",
            *(f"  {d.action.value:<9} {d.file.path}" for d in _in_order(outcome.decisions)),
            "",
            f"what your config says under `{SECTIONS[answers.kind]}:` to run it:",
            *(f"  {line}" for line in config_snippet(answers).splitlines()),
            "",
            "next:",
            f"  {test}",
            f"  {launch}",
        ]
    )


def describe_json(outcome: Outcome) -> str:
    """The same as one JSON object."""
    answers = outcome.answers
    result = {
        "kind": answers.kind,
        "package": answers.package,
        "node": answers.node,
        "folder": outcome.folder,
        "dry_run": outcome.dry_run,
        "files": [
            {"path": str(d.file.path), "action": d.action.value}
            for d in _in_order(outcome.decisions)
        ],
        "section": SECTIONS[answers.kind],
        "config": config_snippet(answers),
        "next": list(outcome.next_commands),
    }
    return json.dumps(result, indent=2)


def _in_order(decisions: Iterable[Decision]) -> list[Decision]:
    return sorted(decisions, key=lambda decision: decision.file.path.parts)
