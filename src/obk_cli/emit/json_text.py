"""JSON as the back ends write it: readable, always valid, always UTF-8."""

import json
import math
import re
from collections.abc import Mapping, Sequence

__all__ = ["json_text"]

_SURROGATE = re.compile("[\ud800-\udfff]")


def json_text(value: object) -> str:
    """The text of a JSON document; numbers that JSON lacks become text as YAML has it, `.inf`."""
    text = json.dumps(_finite(value), indent=2, ensure_ascii=False, allow_nan=False)
    # Half of a pair is no character of UTF-8, but JSON can name it.
    return _SURROGATE.sub(lambda found: f"\\u{ord(found[0]):04x}", text) + "\n"


def _finite(value: object) -> object:
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else (".inf" if value > 0 else "-.inf")
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_finite(item) for item in value]
    return value
