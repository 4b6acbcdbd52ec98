"""OBK0xx: the text and the files it comes from. Data only."""

from obk_cli.diagnostics.rules.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK001",
        severity="error",
        title="a file cannot be read",
        cause="The file is not there, is a folder, or may not be read.",
        cure="Check the path, relative to the folder you stand in, and the file's permissions.",
    ),
    Rule(
        code="OBK002",
        severity="error",
        title="a file is not UTF-8",
        cause="The bytes are in another encoding, or the file is not text.",
        cure="Save the file as UTF-8.",
    ),
    Rule(
        code="OBK003",
        severity="error",
        title="the text is not YAML",
        cause="Usual causes: a tab in the indentation, no space after a colon, lines of one "
        "block that start in different columns, an open quote or bracket.",
        cure="Mend the text at the place named, or just above it.",
    ),
    Rule(
        code="OBK004",
        severity="error",
        title="a key stands twice in one mapping",
        cause="YAML would silently keep one of the two.",
        cure="Remove one, or make the two a list.",
    ),
    Rule(
        code="OBK005",
        severity="error",
        title="a tag that would build an object",
        cause="A config holds plain values only, so that reading it can run nothing.",
        cure="Remove the tag.",
    ),
    Rule(
        code="OBK006",
        severity="error",
        title="more values than a config has",
        cause="All files of a config together may hold 150,000 values, an alias counted as all "
        "that it stands for: aliases of aliases multiply, and a small file can mean billions.",
        cure="Use fewer levels of aliases, or write the values out; name the file that was meant "
        "if this one holds data and not a config.",
    ),
    Rule(
        code="OBK007",
        severity="error",
        title="more text than a config has",
        cause="All files of a config together may be 10 MiB long, as may what variables make of "
        "them, and 100 files be included. No config is longer; most likely one of the files is not "
        "the one that was meant.",
        cure="Name the file that was meant, or make several configs.",
    ),
    Rule(
        code="OBK008",
        severity="error",
        title="an included file cannot be read",
        cause="Paths of `include:` are relative to the file that includes.",
        cure="Mend the path.",
    ),
    Rule(
        code="OBK009",
        severity="error",
        title="files include each other in a circle",
        cause="A file would have to be merged into itself.",
        cure="Remove one of the includes in the chain that is shown.",
    ),
    Rule(
        code="OBK010",
        severity="error",
        title="an included file is not a mapping",
        cause="Only mappings can be merged into a config.",
        cure="Give the included file keys such as `control:` or `robot:`.",
    ),
    Rule(
        code="OBK011",
        severity="error",
        title="an environment variable is not set",
        cause="`${NAME}` is replaced when the config is read, and nothing stands in for it.",
        cure="Set the variable, write a default as `${NAME:-text}`, or `$${` for a literal `${`.",
    ),
    Rule(
        code="OBK012",
        severity="error",
        title="`--set` does not fit the config",
        cause="The path leads to nothing that could be set, or the option is not `path=value`.",
        cure="Write for example `--set robot[0].sim[0].time_step=0.001`.",
    ),
    Rule(
        code="OBK013",
        severity="error",
        title="values are nested too deeply",
        cause="A config needs a dozen levels; this text has over a hundred.",
        cure="Remove the needless brackets or indentation.",
    ),
    Rule(
        code="OBK014",
        severity="warning",
        title="what cannot be silenced",
        cause="An `ignore` in a comment, in the config or on the command line names no rule, or "
        "one whose findings leave no config to go on with, so it has no effect.",
        cure="Mend the code; the beginning of codes, such as `OBK4`, stands for all of them.",
    ),
    Rule(
        code="OBK016",
        severity="info",
        title="a fragment that another config includes",
        cause="Another config of the workspace includes this file, so `obk validate` does not "
        "report what the file lacks: keys, nodes, publishers and subscribers that the other "
        "config may have.",
        cure="Validate the config that includes it.",
    ),
)
