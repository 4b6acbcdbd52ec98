"""Read configs in custom launch files; kept for existing code, does not need `launch`.

`obk launch` and `obk compile --to launch` do more: they check the config and resolve its includes,
variables and paths.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_share_path

from obelisk_py.core.components import ComponentKind
from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_spec.components import (
    CALLBACK_GROUPS_PARAMETER,
    SETTING_SUFFIX,
    SETTINGS_PARAMETER,
    component_identity,
    format_component_setting,
    format_setting,
)
from obelisk_spec.yaml_core import YamlTextError, load_yaml_core

__all__ = ["get_parameters_dict", "load_config_file"]


def load_config_file(file_path: str | Path, package_name: str = "obelisk_ros") -> dict[str, Any]:
    """Load a config without resolving anything in it.

    Args:
        file_path: absolute, relative to the working directory, or relative to the `config` folder
            in the package's share directory.
        package_name: the package.

    Raises:
        FileNotFoundError: the file does not exist; the message lists the searched paths.
        ObeliskConfigError: the file is not a YAML mapping.
    """
    places = list(_places(Path(file_path), package_name))
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        tried = ", ".join(map(str, places))
        raise FileNotFoundError(f"config not found: `{file_path}`; searched: {tried}")
    try:
        config = load_yaml_core(found.read_text(encoding="utf-8"))
    except YamlTextError as error:
        raise ObeliskConfigError(f"{found}: {error}") from error
    if not isinstance(config, dict):
        raise ObeliskConfigError(f"{found}: not a mapping, as a config must be")
    return config


def _places(path: Path, package_name: str) -> Iterator[Path]:
    yield path.absolute()
    if not path.is_absolute():
        try:
            yield get_package_share_path(package_name) / "config" / path
        except (PackageNotFoundError, ValueError):  # ValueError: it cannot be a package's name
            return


def get_parameters_dict(node_settings: Mapping[str, Any]) -> dict[str, Any]:
    """Compute the ROS parameters of a node in a config, as `obk launch` passes them.

    Args:
        node_settings: the node's mapping, with `publishers`, `subscribers`, `timers`,
            `callback_groups`, `sim`, `params` and `params_path`, all optional.

    Returns:
        One string per component and `sim` block, all components together in `obelisk_settings`, and
        the node's own parameters.
    """
    parameters: dict[str, Any] = {}
    together: dict[str, Any] = {}
    for kind in ComponentKind:
        entries = [_entry(entry) for entry in _listed(node_settings.get(kind.value))]
        if entries:
            together[kind.value] = entries
        for entry in entries:
            own = {key: value for key, value in entry.items() if key != "ros_parameter"}
            parameters[entry["ros_parameter"]] = format_component_setting(own)
    groups = _given(node_settings.get("callback_groups") or {})
    if groups:
        together["callback_groups"] = groups
        parameters[CALLBACK_GROUPS_PARAMETER] = format_component_setting(groups)
    if together:
        parameters[SETTINGS_PARAMETER] = format_setting(together)
    for block in _listed(node_settings.get("sim")):
        settings = {key: value for key, value in block.items() if key != "ros_parameter"}
        parameters[block.get("ros_parameter", "mujoco_setting")] = format_setting(settings)
    if node_settings.get("params_path") is not None:
        parameters["params_path"] = str(node_settings["params_path"])
    return {**parameters, **dict(_dotted(node_settings.get("params") or {}, ""))}


def _entry(written: Mapping[str, Any]) -> dict[str, Any]:
    """Return a component's settings with both of its names."""
    name = written.get("ros_parameter") or written.get("key")
    if not isinstance(name, str):
        raise ObeliskConfigError(f"{dict(written)} has neither `ros_parameter` nor `key`")
    key = component_identity(name)
    return {"key": key, "ros_parameter": f"{key}{SETTING_SUFFIX}", **_given(written)}


def _given(written: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in written.items() if value not in (None, "None")}


def _listed(value: Any) -> list[Mapping[str, Any]]:
    """Return a list; a single mapping counts as a list of one."""
    return [value] if isinstance(value, Mapping) else list(value or ())


def _dotted(params: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in params.items():
        if isinstance(value, Mapping):
            yield from _dotted(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value
