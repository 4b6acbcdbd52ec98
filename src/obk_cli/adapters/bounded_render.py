"""Templates that are not the tool's own, rendered in a process with little time and memory.

In: templates and variables. Out: files in memory. A template that runs for ever or wants all of
the memory ends that process and nothing else.
"""

import base64
import json
import resource
import subprocess
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import PurePosixPath
from types import MappingProxyType
from typing import Any, Final

import msgspec

from obk_cli.scaffold.fields import Filling
from obk_cli.scaffold.questions import MessageType
from obk_cli.scaffold.render import RenderedFile, Template, TemplateFaultError, render_templates

__all__ = ["render_bounded"]

_CPU_S = 5
_DEADLINE_S = 60.0
"""For the process as a whole [s]: on a busy machine it waits for its turn to compute."""

_MEMORY_BYTES = 512 * 1024 * 1024
_LONGEST_OUTPUT_BYTES = 32 * 1024 * 1024
_KIND: Final = "="
"""The key, none of a field's, under which JSON has a variable's class."""
_KINDS: Final[Mapping[str, type[Any]]] = MappingProxyType(
    {"MessageType": MessageType, "Filling": Filling}
)
"""Those that variables of templates are of."""


def render_bounded(
    templates: Iterable[Template], variables: Mapping[str, object], *, cpu_s: int = _CPU_S
) -> tuple[RenderedFile, ...]:
    """As `render_templates`; all templates together may compute for `cpu_s` [s].

    Raises:
        TemplateFaultError: as there, or the templates take too long or too much memory.
    """
    given = tuple(templates)
    folders = ", ".join(sorted({template.folder for template in given if template.folder}))
    too_much = TemplateFaultError(
        f"{folders}: a template wants more than {cpu_s} s of computing, "
        f"or more than {_MEMORY_BYTES // 1024**2} MiB of memory"
    )
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", __spec__.name, str(cpu_s)],
            input=_question(given, variables),
            capture_output=True,
            timeout=_DEADLINE_S,
            check=False,
        )
    except subprocess.TimeoutExpired as fault:
        raise too_much from fault
    try:
        answer = json.loads(done.stdout)
    except ValueError as fault:  # it was ended before it could answer
        raise too_much from fault
    if "fault" in answer:
        raise TemplateFaultError(answer["fault"])
    return tuple(
        RenderedFile(path=PurePosixPath(path), content=base64.b64decode(content))
        for path, content in answer["files"]
    )


def _limit(what: int, most: int) -> None:
    _, hard = resource.getrlimit(what)
    bound = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(what, (bound, bound))


def _question(templates: Iterable[Template], variables: Mapping[str, object]) -> bytes:
    given = [[t.name, base64.b64encode(t.content).decode(), t.folder] for t in templates]
    # Names and folders of files may hold bytes that are no text: JSON has them as lone surrogates.
    question = {"templates": given, "variables": dict(variables)}
    return json.dumps(question, default=_as_json).encode("ascii")


def _as_json(value: Any) -> dict[str, object]:
    return {_KIND: type(value).__name__, **asdict(value)}


def _from_json(data: dict[str, Any]) -> object:
    return msgspec.convert(data, _KINDS[data[_KIND]]) if _KIND in data else data


def _answer(data: bytes) -> dict[str, object]:
    question = json.loads(data, object_hook=_from_json)
    templates = [
        Template(name=name, content=base64.b64decode(content), folder=folder)
        for name, content, folder in question["templates"]
    ]
    variables = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in question["variables"].items()
    }
    try:
        files = render_templates(templates, variables)
    except TemplateFaultError as fault:
        return {"fault": fault.message}
    if sum(len(file.content) for file in files) > _LONGEST_OUTPUT_BYTES:
        return {"fault": f"the templates make more than {_LONGEST_OUTPUT_BYTES // 1024**2} MiB"}
    return {"files": [[str(f.path), base64.b64encode(f.content).decode()] for f in files]}


def _main() -> None:
    _limit(resource.RLIMIT_CPU, int(sys.argv[1]))
    _limit(resource.RLIMIT_AS, _MEMORY_BYTES)
    json.dump(_answer(sys.stdin.buffer.read()), sys.stdout)


if __name__ == "__main__":
    _main()
