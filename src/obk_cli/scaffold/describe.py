"""Describe what was or would be created: file lists, diffs, next steps, JSON.

Pure.
"""

import difflib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from io import StringIO
from pathlib import PurePath

from obk_cli.scaffold.kinds import NODE_KINDS, SECTIONS
from obk_cli.scaffold.package_spec import PackageSpec
from obk_cli.scaffold.variables import TOPICS_TO_FILL_IN, config_snippet
from obk_cli.scaffold.write import Action, Decision

__all__ = [
    "Added",
    "NewFiles",
    "describe_json",
    "describe_text",
    "file_lines",
    "opening_line",
    "unified_diff",
]

_UNCHANGED = frozenset({Action.IDENTICAL, Action.KEEP})


def unified_diff(decisions: Iterable[Decision]) -> str:
    """The diff of all changed files; a new file is compared with `/dev/null`."""
    changed = (decision for decision in decisions if decision.action not in _UNCHANGED)
    return "".join(line for decision in changed for line in _file_diff(decision))


def _file_diff(decision: Decision) -> Iterable[str]:
    path = decision.file.path
    old, new = _lines(decision.before or b""), _lines(decision.file.content)
    if old is None or new is None:
        yield f"Binary files a/{path} and b/{path} differ\n"
        return
    before = "/dev/null" if decision.before is None else f"a/{path}"
    for line in difflib.unified_diff(old, new, before, f"b/{path}"):
        yield line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"


def _lines(content: bytes) -> list[str] | None:
    try:
        text = content.decode()
    except UnicodeDecodeError:
        return None
    return list(StringIO(text, newline="\n"))  # `splitlines` also splits at form feeds


@dataclass(frozen=True, slots=True, kw_only=True)
class Added:
    """The changes to a config to which the new node was added; `config` as the user wrote it."""

    config: str
    is_connected: bool
    """Whether every topic that the replaced node published still has a publisher."""
    lines: tuple[str, ...]
    values: Mapping[str, object]
    diff: str


@dataclass(frozen=True, slots=True, kw_only=True)
class NewFiles:
    """The result of `obk new`; `folder` and `programs` are as the user would type them."""

    spec: PackageSpec
    folder: str
    decisions: tuple[Decision, ...]
    dry_run: bool
    programs: str
    """Prefix of `python` and `obk`: empty in an active environment, otherwise its `bin/`."""
    added: Added | None = None

    @property
    def next_commands(self) -> tuple[str, ...]:
        """Commands to run next."""
        spec = self.spec
        if spec.kind == "msgs":
            return (f"{self.programs}obk build {spec.package}",)
        if spec.kind == "config":
            config = PurePath(self.folder, f"{spec.node}.yaml")
            return (f"{self.programs}obk validate {config}", f"{self.programs}obk launch {config}")
        if spec.language == "cpp":
            return (f"colcon build --packages-select {spec.package}",)
        test = PurePath(self.folder, "test", f"test_{spec.node}.py")
        stack = self.added.config if self.added else "CONFIG"
        is_connected = self.added is None or self.added.is_connected
        # Settings of a new package or its workspace load the plugin; existing ones may not.
        is_new = all(decision.action is not Action.EDIT for decision in self.decisions)
        pytest = "python -m pytest" if is_new else "python -m pytest -p obk_testing.plugin"
        command = "launch" if is_connected else "validate"
        return (f"{self.programs}{pytest} {test}", f"{self.programs}obk {command} {stack}")


def describe_text(outcome: NewFiles) -> str:
    """The tree with the result for each file, the piece of config, and the next commands.

    For a dry run, also the diff.
    """
    what = f"{_subject(outcome.spec)} in {outcome.folder}/"
    return "\n".join(
        [
            opening_line(what, outcome.decisions, dry_run=outcome.dry_run),
            *file_lines(outcome.decisions),
            *(("", *outcome.added.lines) if outcome.added else _config_lines(outcome.spec)),
            "",
            "next:",
            *(f"  {command}" for command in outcome.next_commands),
            *(("", _diff(outcome)) if outcome.dry_run else ()),
        ]
    )


def describe_json(outcome: NewFiles) -> str:
    """The same as one JSON object."""
    spec = outcome.spec
    is_node = spec.kind in NODE_KINDS
    result = {
        "kind": spec.kind,
        "language": spec.language if is_node else None,
        "package": spec.package,
        "node": spec.node,
        "folder": outcome.folder,
        "dry_run": outcome.dry_run,
        "files": [
            {"path": str(d.file.path), "action": d.action.value}
            for d in _in_order(outcome.decisions)
        ],
        "section": SECTIONS[spec.kind] if is_node else None,
        "config": config_snippet(spec) if is_node else None,
        "added_to": dict(outcome.added.values) if outcome.added else None,
        "next": list(outcome.next_commands),
    }
    if outcome.dry_run:
        result["diff"] = _diff(outcome)
    return json.dumps(result, indent=2)


def opening_line(what: str, decisions: Iterable[Decision], *, dry_run: bool) -> str:
    """Whether something was or would be created, or is unchanged."""
    if all(decision.action in _UNCHANGED for decision in decisions):
        return f"unchanged: {what}"
    return f"would create {what}" if dry_run else f"created {what}"


def file_lines(decisions: Iterable[Decision]) -> tuple[str, ...]:
    """One line per file, in tree order."""
    return tuple(f"  {d.action.value:<9} {d.file.path}" for d in _in_order(decisions))


def _diff(outcome: NewFiles) -> str:
    """The diff of the package's files and of the config."""
    of_files = unified_diff(_in_order(outcome.decisions))
    return f"{of_files}{outcome.added.diff}" if outcome.added else of_files


def _subject(spec: PackageSpec) -> str:
    if spec.kind == "msgs":
        return f"the message package `{spec.package}`"
    if spec.kind == "config":
        return f"the config `{spec.node}`"
    return f"the {spec.kind} `{spec.node}`, package `{spec.package}`,"


def _config_lines(spec: PackageSpec) -> tuple[str, ...]:
    if spec.kind not in NODE_KINDS:
        return ()
    return (
        "",
        f"add this under `{SECTIONS[spec.kind]}:` in your config and replace {TOPICS_TO_FILL_IN} "
        "with your topic prefix (or use --add-to CONFIG):",
        *(f"  {line}" for line in config_snippet(spec).splitlines()),
    )


def _in_order(decisions: Iterable[Decision]) -> list[Decision]:
    return sorted(decisions, key=lambda decision: decision.file.path.parts)
