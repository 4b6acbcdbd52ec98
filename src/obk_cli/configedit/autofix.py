"""Apply the safe fixes for a config's findings, and verify them by compiling again.

The result is the new text of the config's files and the findings that were fixed; nothing is
written here. A fix is kept only if the config has no additional errors with it and, for style
fixes, the same plan.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from obk_cli.compiler import Options, Outcome, compile_config
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.edits import Edit, apply_edits, touched_lines
from obk_cli.diagnostics.source import SourceFile
from obk_cli.plan.lower import lower_stack
from obk_cli.plan.plan import Origin, Plan

__all__ = ["Fixed", "fix_config", "plan_without_places"]

_OF_READING = ("OBK0", "OBK1")
_MOST_ROUNDS = 20
"""Maximum number of rounds; a fix may uncover another finding with a fix."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fixed:
    """The result of fixing a config."""

    before: Outcome
    after: Outcome
    done: tuple[Diagnostic, ...] = ()
    """The fixed findings, each with its location in the text just before its fix."""
    refused: tuple[Diagnostic, ...] = ()
    """Findings whose fix added errors or changed the meaning, and was rolled back."""
    outside: tuple[Diagnostic, ...] = ()
    """Findings in files that may not be edited."""
    files: tuple[tuple[SourceFile, str], ...] = ()
    """Every changed file: the old source and the new text."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _State:
    """The current contents of the files, and the result of compiling them."""

    outcome: Outcome
    texts: dict[Path, str] = field(default_factory=dict)


def fix_config(path: str, options: Options, may_edit: Callable[[Path], bool]) -> Fixed:
    """Apply the safe fixes in files that may be edited."""
    fixer = _Fixer(path, options, may_edit)
    before = compile_config(path, options)
    state = _State(outcome=before)
    for _ in range(_MOST_ROUNDS):
        following = fixer.round(state)
        if following is None:
            break
        state = following
    return Fixed(
        before=before,
        after=state.outcome,
        done=tuple(fixer.done),
        refused=tuple(fixer.refused),
        outside=tuple(fixer.outside(state.outcome)),
        files=tuple((fixer.originals[p], text) for p, text in state.texts.items()),
    )


class _Fixer:
    """Remembers which fixes were tried, so that none is tried twice."""

    def __init__(self, path: str, options: Options, may_edit: Callable[[Path], bool]) -> None:
        self.done: list[Diagnostic] = []
        self.refused: list[Diagnostic] = []
        self.originals: dict[Path, SourceFile] = {}
        self._path = path
        self._options = options
        self._may_edit = may_edit

    def round(self, state: _State) -> _State | None:
        """Apply all fixes at once, otherwise the first one that works; None when no fix works."""
        chosen = self._choose(state.outcome)
        if not chosen:
            return None
        together = self._attempt(state, chosen)
        if together is not None:
            self.done += chosen
            return together
        for finding in chosen:
            alone = self._attempt(state, [finding])
            if alone is not None:
                self.done.append(finding)
                return alone
            self.refused.append(finding)
        return state

    def outside(self, outcome: Outcome) -> Iterator[Diagnostic]:
        """Findings whose fix is in a file that may not be edited."""
        return (f for f in outcome.diagnostics if f.fix and not self._is_editable(f))

    def _choose(self, outcome: Outcome) -> list[Diagnostic]:
        """Fixes that do not overlap; style fixes come after all others."""
        refused = {(f.code, f.message) for f in self.refused}
        able = [
            f
            for f in outcome.diagnostics
            if f.fix and (f.code, f.message) not in refused and self._is_editable(f)
        ]
        serious = [finding for finding in able if finding.severity != "info"]
        if not serious and plan_without_places(outcome) is None:
            return []
        chosen: list[Diagnostic] = []
        taken: set[tuple[Path, int]] = set()
        for finding in serious or able:
            lines = {(self._real(path), line) for path, line in touched_lines(finding.fix)}
            if taken.isdisjoint(lines):
                chosen.append(finding)
                taken |= lines
        return chosen

    def _is_editable(self, finding: Diagnostic) -> bool:
        paths = {edit.span.path for edit in finding.fix}
        return all(not path.startswith("<") and self._may_edit(self._real(path)) for path in paths)

    def _real(self, path: str) -> Path:
        return (self._options.working_folder / path).resolve()

    def _attempt(self, state: _State, chosen: Sequence[Diagnostic]) -> _State | None:
        """The contents with these fixes; None if they are worse than before."""
        edits = dict.fromkeys(edit for finding in chosen for edit in finding.fix)
        texts = dict(state.texts)
        by_file: dict[Path, list[Edit]] = {}  # a file may be included through several paths
        for edit in edits:
            by_file.setdefault(self._real(edit.span.path), []).append(edit)
        for real, of_file in by_file.items():
            source = of_file[0].span.source
            self.originals.setdefault(real, source)
            texts[real] = apply_edits(source, of_file)
        outcome = compile_config(self._path, replace(self._options, read=self._reader(texts)))
        is_style = all(finding.severity == "info" for finding in chosen)
        is_other = is_style and plan_without_places(state.outcome) != plan_without_places(outcome)
        if _errors(outcome) > _errors(state.outcome) or is_other:
            return None
        return _State(outcome=outcome, texts=texts)

    def _reader(self, texts: dict[Path, str]) -> Callable[[str], bytes | str]:
        def read(path: str) -> bytes | str:
            text = texts.get(self._real(path))
            return self._options.read(path) if text is None else text.encode("utf-8")

        return read


def _errors(outcome: Outcome) -> int:
    return sum(finding.severity == "error" for finding in outcome.diagnostics)


def plan_without_places(outcome: Outcome) -> Plan | None:
    """The config's plan without locations; None if the config cannot be read completely."""
    is_read = not any(
        finding.severity == "error" and finding.code.startswith(_OF_READING)
        for finding in outcome.diagnostics
    )
    if outcome.config is None or outcome.environment is None or not is_read:
        return None
    plan = lower_stack(outcome.config, outcome.environment)
    nowhere = Origin(path="", line=0, column=0)
    return replace(
        plan,
        nodes=tuple(
            replace(
                node,
                origin=nowhere,
                rates=tuple(replace(rate, origin=nowhere) for rate in node.rates),
            )
            for node in plan.nodes
        ),
    )
