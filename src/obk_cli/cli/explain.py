"""`obk explain CODE`: print what a rule means, how to fix its findings, and an example."""

import json
from importlib import resources
from typing import Annotated

import typer

from obelisk_spec.suggestions import did_you_mean
from obk_cli.config.suppressions import may_be_silenced
from obk_cli.diagnostics.rules import LOCKSTEP_FAMILY, RULES, Rule
from obk_cli.errors import MisuseError

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk explain OBK203"
_NEVER_SILENT = "This rule cannot be silenced, because a config with this error cannot be compiled."


def command(
    code: Annotated[
        str, typer.Argument(metavar="[CODE]", help="Rule code. Default: list all rules.")
    ] = "",
) -> None:
    """Explain a rule and how to fix what it reports."""
    if not code:
        print(
            "\n".join(f"{rule.code}  {rule.severity:<7}  {rule.title}" for rule in RULES.values())
        )
        return
    rule = RULES.get(code.upper())
    if rule is None:
        raise MisuseError(f"unknown rule `{code}`", help=did_you_mean(code, RULES))
    print(_page(rule))


def _page(rule: Rule) -> str:
    parts = [
        f"{rule.code} ({rule.severity}): {rule.title}",
        f"Why:  {rule.cause}\nFix:  {rule.fix}",
    ]
    text = (
        resources.files("obk_cli.diagnostics.rules")
        .joinpath("examples.json")
        .read_text(encoding="utf-8")
    )
    example: dict[str, str] = json.loads(text)[rule.code]
    parts += [
        f"Wrong:\n{_indented(example['wrong'])}",
        f"Right:\n{_indented(example['right'])}",
        f"Output for the wrong example:\n{_indented(example['report'])}",
    ]
    if rule.code.startswith(LOCKSTEP_FAMILY):
        parts.append("Reported by `obk validate --for-test` only.")
    parts.append(_how_to_silence(rule.code) if may_be_silenced(rule) else _NEVER_SILENT)
    return "\n\n".join(parts)


def _how_to_silence(code: str) -> str:
    return (
        f"Silence this rule on one line with `# obk: ignore[{code}]`, or for one run of a command "
        f"with `--ignore {code}`."
    )


def _indented(text: str) -> str:
    return "\n".join(f"    {line}".rstrip() for line in text.splitlines())
