"""The one table of rules: what each code means, why it hurts, what to do.

Feeds findings (severity), `obk explain`, the documentation and the tests. Data only; a module for
each family.
"""

from collections.abc import Mapping
from types import MappingProxyType

from obk_cli.diagnostics.rules import (
    graph_rules,
    model_rules,
    package_rules,
    schema_rules,
    style_rules,
    text_rules,
)
from obk_cli.diagnostics.rules.rule import Rule, Severity

__all__ = ["RULES", "Rule", "Severity", "rule_of"]

_FAMILIES = (text_rules, schema_rules, graph_rules, model_rules, package_rules, style_rules)

RULES: Mapping[str, Rule] = MappingProxyType(
    {rule.code: rule for family in _FAMILIES for rule in family.RULES}
)
"""Code -> rule, in the order of the codes."""


def rule_of(code: str) -> Rule:
    """The rule of a code that the tool itself reports.

    Raises:
        KeyError: no rule has that code.
    """
    return RULES[code]
