"""The files of `config_path`: read and put in place as `scan_config`.

In: a `sim` block, a way to find files, variables. Out: a block whose groups carry their ray
casters, and a sentence for each file that gives none. Whether those are right is not asked here.
"""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_spec.yaml_core import YamlTextError, expand_variables, load_yaml_core

__all__ = ["with_ray_casters"]


def with_ray_casters(
    block: Mapping[str, Any], find: Callable[[str], Path], environment: Mapping[str, str]
) -> tuple[Mapping[str, Any], list[str]]:
    """The block with its files put in place, and what is wrong with them.

    Args:
        block: as it came; one that is malformed is given back as it is.
        find: the file of a path; raises ObeliskConfigError where there is none.
        environment: what `${NAME}` stands for in the files.
    """
    groups, errors = block.get("sensor_settings"), []
    if not isinstance(groups, list):
        return block, []
    filled = []
    for index, group in enumerate(groups):
        path = group.get("config_path") if isinstance(group, Mapping) else None
        if isinstance(path, str) and not group.get("scan_config"):
            try:
                group = {**group, "scan_config": _read(find(path), environment)}
            except ObeliskConfigError as error:
                errors.append(f"sensor_settings[{index}].config_path: {error}")
        filled.append(group)
    return {**block, "sensor_settings": filled}, errors


def _read(path: Path, environment: Mapping[str, str]) -> Mapping[str, Any]:
    expand = partial(expand_variables, environment=environment)
    try:
        value = load_yaml_core(path.read_text(encoding="utf-8"), expand)
    except (OSError, UnicodeDecodeError, YamlTextError) as error:
        raise ObeliskConfigError(f"{path} cannot be read: {error}") from error
    if isinstance(value, Mapping):
        value = value.get("scan_config", value)
    if not isinstance(value, Mapping):
        raise ObeliskConfigError(
            f"{path} holds no ray caster: a mapping with `site_name` and `pattern`"
        )
    return value
