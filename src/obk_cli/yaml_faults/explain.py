"""What went wrong in a text that is not YAML, in the user's words and at the right place.

PyYAML's errors and the source in, findings out. A parser notices many mistakes lines below where
they were made; the usual ones are looked for where they are made.
"""

import yaml

from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.source import SourceFile, Span
from obk_cli.yaml_faults.brackets import find_in_brackets
from obk_cli.yaml_faults.characters import find_braces, find_character
from obk_cli.yaml_faults.columns import find_in_columns
from obk_cli.yaml_faults.lines import find_in_lines
from obk_cli.yaml_faults.quotes import find_in_quotes
from obk_cli.yaml_faults.trouble import Cause, Trouble

__all__ = ["explain_yaml_error", "template_braces"]

_SEARCHES = (find_in_quotes, find_character, find_in_brackets, find_in_lines, find_in_columns)
"""The first that knows the cause tells it."""


def explain_yaml_error(error: yaml.MarkedYAMLError, source: SourceFile) -> Diagnostic:
    """A finding at the cause where that is known, else where the parser noticed."""
    trouble = Trouble.of(error, source)
    searches = _SEARCHES if trouble.is_short else ()
    cause = next((cause for search in searches if (cause := search(trouble))), None)
    return _finding(cause or _as_noticed(trouble))


def template_braces(key: Span) -> Diagnostic | None:
    """A finding where a key that is a mapping comes of `{{ name }}`."""
    cause = find_braces(key)
    return _finding(cause) if cause else None


def _as_noticed(trouble: Trouble) -> Cause:
    related = None
    if trouble.context and trouble.context_place and trouble.context_place[0] < trouble.line:
        place = Span.at(trouble.source, *trouble.context_place)
        related = Related(message=trouble.context, span=place)
    return Cause(message=f"not YAML: {trouble.problem}", span=trouble.span, related=related)


def _finding(cause: Cause) -> Diagnostic:
    related = (cause.related,) if cause.related else ()
    return found("OBK003", cause.message, cause.span, help=cause.help, related=related)
