"""Generate the pages of the rules and the examples of `obk explain`.

It reads the table of rules, and the reject and accept cases of the tests. It writes one page per
rule, an index, and `examples.json` next to the table. `--check` writes nothing and fails if a file
is stale.
"""

import json
import sys
from collections.abc import Iterator, Mapping
from difflib import SequenceMatcher
from pathlib import Path

from generated import ROOT, bring_up_to_date

from obelisk_spec.suggestions import did_you_mean
from obk_cli.compiler import Options, compile_config
from obk_cli.config.suppressions import may_be_silenced
from obk_cli.diagnostics.rules import LOCKSTEP_FAMILY, RULES, Rule
from obk_cli.diagnostics.source import LONGEST_FILE_BYTES
from obk_cli.report import report_text
from obk_cli.workspace.environment import MachineEnvironment

__all__ = ["generated_files", "main"]

CASES = ROOT / "tests" / "cases"
EXAMPLES = ROOT / "src" / "obk_cli" / "diagnostics" / "rules" / "examples.json"
PAGES = ROOT / "docs" / "reference" / "rules"
FAMILIES = {
    "OBK0": "The text and its files",
    "OBK1": "Keys, values, names",
    "OBK2": "Nodes and topics",
    "OBK3": "The simulated robot and its model",
    "OBK4": "Packages, executables, code",
    "OBK5": "Style",
    "OBK6": "Lockstep runs (`obk validate --for-test`)",
}
DUMMY = ROOT / "examples" / "dummy" / "dummy.yaml"
CONTEXT = 2
"""Lines of context around the lines that differ."""

Example = Mapping[str, str]


def generated_files() -> dict[Path, str]:
    """Path -> content of all generated files."""
    special = _examples_without_case()
    examples = {code: special.get(code) or _example(code) for code in RULES}
    pages = {PAGES / f"{code}.md": _page(rule, examples[code]) for code, rule in RULES.items()}
    text = json.dumps(examples, indent=1, ensure_ascii=False) + "\n"
    return {EXAMPLES: text, PAGES / "README.md": _index(), **pages}


def _examples_without_case() -> dict[str, Example]:
    """Examples of faults that no config can show: commands instead of files."""
    too_long = b"#" * (LONGEST_FILE_BYTES + 1)
    correct = "obk validate stack.yaml"
    return {
        "OBK001": {
            "file": "a terminal",
            "wrong": "obk validate stakc.yaml",
            "right": correct,
            "report": _report("OBK001", "stakc.yaml", "there is no such file"),
        },
        "OBK007": {
            "file": "a terminal",
            "wrong": "obk validate recording.yaml  # 48 MiB of measurements",
            "right": correct,
            "report": _report("OBK007", "recording.yaml", too_long),
        },
        "OBK300": {
            "file": "a terminal",
            "wrong": "pip install obelisk-cli\nobk validate dummy.yaml",
            "right": "pip install 'obelisk-cli[sim]'\nobk validate dummy.yaml",
            "report": _report("OBK300", "dummy.yaml", DUMMY.read_bytes()),
        },
    }


class _WithoutMujoco(MachineEnvironment):
    """This machine, as if MuJoCo were not installed."""

    def read_model(self, path: Path) -> None:
        """Read nothing."""


def _report(code: str, path: str, data: bytes | str) -> str:
    """The findings with one code in a file with the content `data`, or with a reading error."""
    folder = DUMMY.parent
    options = Options(
        variables={},
        working_folder=folder,
        environment=_WithoutMujoco(folder, folder, {}),
        read=lambda _: data,
        meant=lambda _: did_you_mean(path, ("stack.yaml",)),
    )
    findings = compile_config(path, options).diagnostics
    own = (found for found in findings if found.code == code)
    return report_text(own, colour=False, verbose=True)


def _example(code: str) -> Example:
    """The first case of a rule: the difference between the wrong and the right file."""
    accepted = CASES / "accept" / code
    wrong = min(p for p in (CASES / "reject" / code).glob("*.yaml") if (accepted / p.name).exists())
    right = accepted / wrong.name
    report = wrong.with_suffix(".txt").read_text(encoding="utf-8").strip()
    if wrong.read_bytes() == right.read_bytes():
        rejected = CASES / "reject" / code
        parts = sorted(p for p in rejected.rglob("*") if p.suffix in (".part", ".xml"))
        pairs = [(part, accepted / part.relative_to(rejected)) for part in parts]
        wrong, right = next(
            (a, b) for a, b in pairs if b.exists() and a.read_bytes() != b.read_bytes()
        )
    wrong_lines, right_lines = _lines(wrong), _lines(right)
    return {
        "file": wrong.name,
        "wrong": "\n".join(_differing(wrong_lines, right_lines)),
        "right": "\n".join(_differing(right_lines, wrong_lines)),
        "report": report.replace("<cases>/", "").replace("<repository>/", ""),
    }


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8", errors="replace").splitlines()


def _differing(lines: list[str], other: list[str]) -> Iterator[str]:
    """The lines that differ from the other text, with context."""
    end: int | None = None
    for group in SequenceMatcher(None, lines, other).get_grouped_opcodes(CONTEXT):
        if end is not None:
            yield "# ..."
        start, end = group[0][1], group[-1][2]
        yield from lines[start:end]


def _page(rule: Rule, example: Example) -> str:
    language = "xml" if example["file"].endswith(".xml") else "yaml"
    language = language if "." in example["file"] else "sh"
    on_request = " --for-test" if rule.code.startswith(LOCKSTEP_FAMILY) else ""
    verbose = " --verbose" if rule.severity == "info" else ""
    command = f"obk validate{on_request}{verbose}"
    parts = [
        f"# {rule.code}: {rule.title}",
        f"Severity: {rule.severity}.",
        f"**Why.** {rule.cause}",
        f"**Fix.** {rule.fix}",
        "Wrong:",
        f"```{language}\n{example['wrong']}\n```",
        "Right:",
        f"```{language}\n{example['right']}\n```",
        f"Output of `{command}` for the incorrect config:",
        f"```text\n{example['report']}\n```",
    ]
    parts.append(
        f"To silence this rule, add `# obk: ignore[{rule.code}]` to the line, pass "
        f"`--ignore {rule.code}`, or set `obk: {{ignore: [{rule.code}]}}` in the config."
        if may_be_silenced(rule)
        else "This rule cannot be silenced, because its findings make the config unusable."
    )
    return "\n\n".join(parts) + "\n"


def _index() -> str:
    parts = [
        "# Rules",
        "The rules that `obk validate` checks. `obk explain CODE` prints a rule in the terminal. "
        "The pages are generated by `make docs` from the table of rules and the test cases.",
    ]
    for family, title in FAMILIES.items():
        rows = [
            f"| [{code}]({code}.md) | {rule.severity} | {rule.title} |"
            for code, rule in RULES.items()
            if code.startswith(family)
        ]
        parts += [f"## {title}", "\n".join(("| code | severity | finds |", "|---|---|---|", *rows))]
    return "\n\n".join(parts) + "\n"


def main(arguments: list[str]) -> int:
    """Write the files, or with `--check` list stale ones; return the exit code."""
    return bring_up_to_date(generated_files(), [PAGES], arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
