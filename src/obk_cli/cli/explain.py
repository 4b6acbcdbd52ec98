"""`obk explain CODE`: what a rule means and how to mend what it finds."""

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
    return (
        f"{rule.code} ({rule.severity}): {rule.title}\n\n"
        f"Why:  {rule.cause}\n"
        f"Cure: {rule.cure}\n\n"
        f"Silence it on a line with `# obk: ignore[{rule.code}]`, in a run with "
        f"`--ignore {rule.code}`."
    )
