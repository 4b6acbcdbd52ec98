"""Writes the pages of reference that are generated: commands, keys of a config, messages, classes.

In: the help of `obk`, `schema/obelisk.schema.json`, the definitions in `interfaces/`, the table of
sensor groups and the source of `obelisk_py`. Out: `docs/reference/{commands,config,messages,
classes}.md`. `--check` writes nothing and fails where a page is stale.
"""

import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from class_page import class_page
from generated import ROOT, bring_up_to_date

from obelisk_spec.sensors import SENSOR_GROUPS, GroupRule
from obk_cli.cli.commands import VERBS, root_command

__all__ = ["generated_files", "main"]

PAGES = ROOT / "docs" / "reference"
SCHEMA = ROOT / "schema" / "obelisk.schema.json"
INTERFACES = ROOT / "interfaces"
HELP_WIDTH = 96
BY_NATURE = ("variable", "finite", "ros_number", "params")
"""Definitions that are a kind of value, with no keys of their own."""
IS_VARIABLE = r"\$\{"

Schema = Mapping[str, Any]


def generated_files() -> dict[Path, str]:
    """Path -> content of everything that is generated."""
    pages = {
        "commands": _commands(),
        "config": _config(),
        "messages": _messages(),
        "classes": class_page(),
    }
    return {
        PAGES / f"{name}.md": "\n\n".join(parts).rstrip() + "\n" for name, parts in pages.items()
    }


def _commands() -> Iterator[str]:
    yield "# Commands"
    yield (
        "What `obk --help` and `obk COMMAND --help` say; generated from it by `make docs`. "
        "Exit code 0: done; 1: it failed, or the config has errors; 2: the command itself is "
        "wrong; 130: interrupted."
    )
    root = root_command()
    yield _block(_help(root, "obk"))
    for verb in VERBS:
        yield f"## obk {verb}"
        yield from _help_of(root.get_command(click.Context(root), verb), f"obk {verb}")


def _help_of(command: click.Command, name: str) -> Iterator[str]:
    """The help of a command, and of those below it."""
    yield _block(_help(command, name))
    for inner in getattr(command, "commands", {}).values():
        yield f"### {name} {inner.name}"
        yield from _help_of(inner, f"{name} {inner.name}")


def _help(command: click.Command, name: str) -> str:
    context = command.context_class(
        command, info_name=name, terminal_width=HELP_WIDTH, max_content_width=HELP_WIDTH
    )
    return command.get_help(context)


def _block(text: str) -> str:
    lines = (line.rstrip() for line in text.strip().splitlines())
    return "```text\n" + "\n".join(lines) + "\n```"


def _config() -> Iterator[str]:
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    kinds = schema["$defs"]
    yield "# Keys of a config"
    yield (
        "Generated from `schema/obelisk.schema.json` by `make docs`; `obk schema` prints the "
        "schema, and [editors](../how-to/migrating.md#in-the-editor) show the same texts. Where "
        "text or a number stands there may be `${NAME}` or `${NAME:-text}`, an environment "
        "variable. Keys without effect are accepted for older configs, and reported."
    )
    yield "## Stack"
    yield schema["description"]
    yield _keys(schema, kinds, ())
    yield "Any other key at the top level is the name of a [device](#device)."
    node = kinds["node"]
    for name, kind in kinds.items():
        if name in BY_NATURE:
            continue
        yield f"## {kind['title']}"
        more = name != "node" and node["properties"].keys() <= kind["properties"].keys()
        yield kind["description"] + (" It has the keys of a [node](#node), and:" if more else "")
        yield _keys(kind, kinds, tuple(node["properties"]) if more else ())


def _keys(kind: Schema, kinds: Schema, besides: Sequence[str]) -> str:
    """The table of what a mapping may hold, without the keys that are described elsewhere."""
    rows = ["| key | holds | is |", "|---|---|---|"]
    required = set(kind.get("required", ()))
    for key, value in kind["properties"].items():
        if key not in besides:
            holds = _cell(_nature(value, kinds))
            name = f"**`{key}`**" if key in required else f"`{key}`"
            rows.append(f"| {name} | {holds} | {_cell(_words(value))} |")
    if required - set(besides):
        rows[0] = "| key (bold: required) | holds | is |"
    return "\n".join(rows)


def _words(value: Schema) -> str:
    """What a key means, with its default."""
    said = str(value.get("description") or value.get("title", ""))
    if (default := value.get("default")) is not None:
        said += f" Where nothing is written: `{json.dumps(default).strip(chr(34))}`."
    return said


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _nature(value: Schema, kinds: Schema) -> str:
    """What kind of value it is, in words: `text, or a list of such`, `number above 0`."""
    natures = [n for n in dict.fromkeys(_natures(value, kinds)) if n != "variable"]
    for one in natures:
        if f"list of {one}" in natures:
            natures = [f"{one}, or a list of such", *natures]
            natures = [n for n in natures if n not in (one, f"list of {one}")]
    return " or ".join(natures) or "anything"


def _natures(value: Schema, kinds: Schema) -> Iterator[str]:
    for choice in (*value.get("anyOf", ()), *value.get("oneOf", ())):
        yield from _natures(choice, kinds)
    if "enum" in value:
        yield ", ".join(f"`{json.dumps(one).strip(chr(34))}`" for one in value["enum"] if one)
    elif "const" in value:
        yield f"`{value['const']}`"
    elif "$ref" in value:
        yield from _named(value["$ref"].rpartition("/")[2], kinds)
    elif cases := [case["then"] for case in value.get("allOf", ()) if "then" in case]:
        for case in cases:
            yield from _natures(case, kinds)
    elif "type" in value:
        types = value["type"] if isinstance(value["type"], list) else [value["type"]]
        yield from (_plain(one, value, kinds) for one in types if one != "null")


def _named(name: str, kinds: Schema) -> Iterator[str]:
    if name in ("finite", "ros_number"):
        yield "number"
    elif name == "params":
        yield "mapping of parameters"
    elif name == "variable":
        yield name
    else:
        title = kinds[name]["title"]
        yield f"[{title.lower()}](#{re.sub(r'[^a-z0-9]+', '-', title.lower())})"


def _plain(type_: str, value: Schema, kinds: Schema) -> str:
    match type_:
        case "array":
            inner = _nature(value.get("items", {}), kinds)
            size = value.get("minItems")
            if size is not None and size == value.get("maxItems"):
                return f"list of {size}, each a {inner}"
            return f"list of {inner}"
        case "object":
            named = value.get("additionalProperties")
            if isinstance(named, dict):
                return f"mapping of names to ({_nature(named, kinds)})"
            keys = ", ".join(f"`{key}`" for key in value.get("properties", ()))
            return f"mapping with {keys}" if keys else "mapping"
        case "string":
            return "variable" if value.get("pattern") == IS_VARIABLE else "text"
        case "boolean":
            return "`true`, `false`"
        case "integer":
            return f"whole number{_bounds(value)}"
    whole = "whole " if value.get("multipleOf") == 1 else ""
    return f"{whole}number{_bounds(value)}"


def _bounds(value: Schema) -> str:
    """In words; those that only keep numbers representable are left out."""
    least, most = value.get("minimum"), value.get("maximum")
    if least == 0 and most is not None and most <= 1:
        return f" from 0 to {most}"
    if "exclusiveMinimum" in value or (least is not None and 0 < least < 1e-3):
        return " above 0"
    return f" of at least {least}" if least is not None and abs(least) < 1e6 else ""


def _messages() -> Iterator[str]:
    yield "# Messages"
    yield (
        "The definitions of `interfaces/`, word for word, and what the simulator publishes; "
        "generated by `make docs`. Messages of your own: [own messages](../how-to/own-messages.md)."
    )
    yield "## What a sensor group publishes"
    yield (
        "`msg_type` of a [sensor group](config.md#sensor-group), and which of the model's sensors "
        "it takes. See [the simulated robot](sensors.md)."
    )
    rows = [
        f"| `{name}` | `{rule.published}` | {_taken(rule)} |"
        for name, rule in SENSOR_GROUPS.items()
        if rule.takes or rule.patterns
    ]
    yield "\n".join(("| `msg_type` | is published as | takes |", "|---|---|---|", *rows))
    for package in sorted(INTERFACES.glob("obelisk_*_msgs")):
        yield f"## {package.name}"
        for path in sorted(package.glob("*/*.[ms][sr][gv]")):
            yield f"### {path.stem}"
            yield _block(path.read_text(encoding="utf-8"))


def _taken(rule: GroupRule) -> str:
    if rule.patterns:
        return "rays: " + ", ".join(f"`{pattern}`" for pattern in rule.patterns)
    where = {
        None: "",
        "scalar joint": ", on hinges and slides",
        "one site": ", all at one site",
        "one object": ", all on one object",
    }
    return ", ".join(f"`{sensor}`" for sensor in rule.takes) + where[rule.objects]


def main(arguments: list[str]) -> int:
    """Write the pages, or with `--check` name those that are stale; the process's exit code."""
    return bring_up_to_date(generated_files(), [], arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
