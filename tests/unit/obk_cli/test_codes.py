import re
from pathlib import Path

from obk_cli.codes import RULES

SOURCE = Path(__file__).parents[3] / "src"


def test_codes_are_in_order_and_each_rule_is_described() -> None:
    assert list(RULES) == sorted(RULES)
    for code, rule in RULES.items():
        assert re.fullmatch(r"OBK[0-5]\d\d", code)
        assert rule.cause.endswith("."), code
        assert rule.cure.endswith("."), code
        assert rule.title == rule.title.strip("."), code


def test_the_code_reports_no_rule_that_is_not_in_the_table() -> None:
    used: set[str] = set()
    for path in [*(SOURCE / "obk_cli").rglob("*.py"), *(SOURCE / "obelisk_spec").rglob("*.py")]:
        if "codes" not in path.parts:
            used.update(re.findall(r"\"(OBK\d\d\d)\"", path.read_text(encoding="utf-8")))
    assert used == RULES.keys()
