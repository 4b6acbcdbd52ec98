"""OBK5xx: what is read, and could be written better. Data only."""

from obk_cli.diagnostics.rules.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK501",
        severity="info",
        title="an older name of a key",
        cause="It is read as the newer one.",
        cure="Write the newer name.",
    ),
    Rule(
        code="OBK502",
        severity="warning",
        title="a path into one person's home",
        cause="On another machine, and for another person, there is no such folder.",
        cure="Write the path relative to the config, name its package, or use `${HOME}`.",
    ),
    Rule(
        code="OBK503",
        severity="warning",
        title="`n_u` is not the model's",
        cause="`n_u` is a legacy key; the number of controls comes from the model.",
        cure="Leave `n_u` out.",
    ),
    Rule(
        code="OBK504",
        severity="warning",
        title="`time_step` is not the model's",
        cause="The simulator uses the config's `time_step` instead of the step that the model was "
        "tuned with. The original Obelisk ignores `time_step` and uses the model's.",
        cure="Leave `time_step` out to get the original's numbers, or make the two agree.",
    ),
    Rule(
        code="OBK505",
        severity="info",
        title="a list that mixes int and float",
        cause="ROS lists hold one type; the whole list is read as floats.",
        cure="Write every number with a decimal point.",
    ),
    Rule(
        code="OBK506",
        severity="info",
        title="a key without effect",
        cause="The key is accepted for the sake of older configs, or another key leaves it nothing "
        "to decide.",
        cure="Remove it.",
    ),
    Rule(
        code="OBK507",
        severity="info",
        title="a default written out",
        cause="The key says what holds without it; many configs do so, and it is harmless.",
        cure="Leave the key out, or leave it there.",
    ),
)
