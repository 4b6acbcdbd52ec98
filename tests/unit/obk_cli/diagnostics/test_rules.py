import re
from pathlib import Path

import pytest

from obk_cli.cli.explain import command as explain
from obk_cli.diagnostics.rules import RULES

SOURCE = Path(__file__).parents[4] / "src"


def test_codes_are_in_order_and_each_rule_is_described() -> None:
    assert list(RULES) == sorted(RULES)
    for code, rule in RULES.items():
        assert re.fullmatch(r"OBK[0-6]\d\d", code)
        assert rule.cause.endswith("."), code
        assert rule.fix.endswith("."), code
        assert rule.title == rule.title.strip("."), code


def test_the_code_reports_no_rule_that_is_not_in_the_table() -> None:
    used: set[str] = set()
    for path in [*(SOURCE / "obk_cli").rglob("*.py"), *(SOURCE / "obelisk_spec").rglob("*.py")]:
        if "rules" not in path.parts:
            used.update(re.findall(r"\"(OBK\d\d\d)\"", path.read_text(encoding="utf-8")))
    assert used == RULES.keys()


@pytest.mark.parametrize(
    ("code", "may_be"), [("OBK003", False), ("OBK014", True), ("OBK203", True)]
)
def test_an_explained_rule_states_whether_it_may_be_silenced(
    code: str, may_be: bool, repository: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    explain(code)
    page = (repository / "docs/reference/rules" / f"{code}.md").read_text(encoding="utf-8")
    for reported in (capsys.readouterr().out, page):
        assert (f"ignore[{code}]" in reported) == may_be
        assert ("cannot be silenced" in reported) != may_be or code == "OBK014"
