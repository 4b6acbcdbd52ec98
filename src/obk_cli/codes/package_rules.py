"""OBK4xx: packages, executables, files. Data only."""

from obk_cli.codes.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK401",
        severity="error",
        title="a package is not found",
        cause="It is not in the workspace, not in the Python environment, not on "
        "AMENT_PREFIX_PATH.",
        cure="Mend the name, put the package into the workspace, or source the one that has it.",
    ),
    Rule(
        code="OBK402",
        severity="error",
        title="an executable is not in its package",
        cause="The package is there, but it has no executable of that name.",
        cure="Mend the name, or add the entry point to the package.",
    ),
    Rule(
        code="OBK403",
        severity="error",
        title="a model package is not found",
        cause="`robot_pkg` is searched in the workspace, the Python environment and "
        "AMENT_PREFIX_PATH.",
        cure="Mend the name, or put the package into the workspace.",
    ),
    Rule(
        code="OBK404",
        severity="warning",
        title="a file that the config names is missing",
        cause="The path is handed to a node, which may not start without it.",
        cure="Mend the path.",
    ),
)
