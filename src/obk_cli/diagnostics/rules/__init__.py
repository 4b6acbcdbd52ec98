"""All rules by code: what each means, its cause and its fix.

Findings take their severity from here; `obk explain`, the documentation and SARIF use the rest.
"""

from collections.abc import Mapping
from itertools import chain
from types import MappingProxyType

from obk_cli.diagnostics.rules import (
    config_rules,
    determinism_rules,
    graph_rules,
    model_rules,
    package_rules,
)
from obk_cli.diagnostics.rules.rule import Rule, Severity

__all__ = ["LOCKSTEP_FAMILY", "RULES", "Rule", "Severity"]

LOCKSTEP_FAMILY = "OBK6"
"""Rules about lockstep runs, which are only checked on request."""
_EVERY = chain(
    config_rules.RULES,
    graph_rules.RULES,
    model_rules.RULES,
    package_rules.RULES,
    determinism_rules.RULES,
)

RULES: Mapping[str, Rule] = MappingProxyType(
    {rule.code: rule for rule in sorted(_EVERY, key=lambda rule: rule.code)}
)
"""Code -> rule, in the order of the codes."""
