"""`obk explain CODE`: what a rule means, a wrong and a right example, how to mend what it finds."""

import json
from importlib import resources
from typing import Annotated

import typer

from obelisk_spec.near import did_you_mean
from obk_cli.codes import RULES, Rule
from obk_cli.errors import MisuseError

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk explain OBK203"


def command(
    code: Annotated[str, typer.Argument(metavar="[CODE]", help="A rule; none lists all.")] = "",
) -> None:
    """Tell what a rule means and how to mend what it finds."""
    if not code:
        print(
            "\n".join(f"{rule.code}  {rule.severity:<7}  {rule.title}" for rule in RULES.values())
        )
        return
    asked = RULES.get(code.upper())
    if asked is None:
        raise MisuseError(f"there is no rule `{code}`", help=did_you_mean(code, RULES))
    print(_page(asked))


def _page(rule: Rule) -> str:
    parts = [
        f"{rule.code} ({rule.severity}): {rule.title}",
        f"Why:  {rule.cause}\nCure: {rule.cure}",
    ]
    text = resources.files("obk_cli.codes").joinpath("examples.json").read_text(encoding="utf-8")
    example: dict[str, str] | None = json.loads(text).get(rule.code)
    if example:
        parts += [
            f"Wrong:\n{_indented(example['wrong'])}",
            f"Right:\n{_indented(example['right'])}",
            f"What is said of the wrong one:\n{_indented(example['report'])}",
        ]
    parts.append(
        f"Silence it on a line with `# obk: ignore[{rule.code}]`, in a run with "
        f"`--ignore {rule.code}`."
    )
    return "\n\n".join(parts)


def _indented(text: str) -> str:
    return "\n".join(f"    {line}".rstrip() for line in text.splitlines())
