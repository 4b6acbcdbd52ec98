"""What a config for a model needs to know of it: names of sensors and keyframes, actuators.

In: the text of an MJCF file. Out: `Model`. Looks at this one file only, and never runs MuJoCo.
"""

from collections.abc import Collection
from dataclasses import dataclass
from xml.etree import ElementTree

__all__ = ["Model", "ModelSensor", "read_model_text"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelSensor:
    """A named sensor; `of` is the name of what it is attached to."""

    name: str
    type: str
    of: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """A model; `path` is as the config writes it."""

    path: str
    sensors: tuple[ModelSensor, ...] = ()
    keyframes: tuple[str, ...] = ()
    actuators: int = 0

    def sensors_of(self, types: Collection[str], *, joints: bool) -> tuple[ModelSensor, ...]:
        """Those of these types: of all joints, else one a type of the object that has most."""
        fitting = [sensor for sensor in self.sensors if sensor.type in types]
        if joints:
            return tuple(fitting)
        by_object: dict[str, dict[str, ModelSensor]] = {}
        for sensor in fitting:
            by_object.setdefault(sensor.of, {}).setdefault(sensor.type, sensor)
        return tuple(max(by_object.values(), key=len, default={}).values())


def read_model_text(text: str, path: str) -> Model | None:
    """The model, None where the text is none."""
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError):
        return None
    if root.tag != "mujoco":
        return None
    sensors = (
        ModelSensor(
            name=element.get("name", ""),
            type=element.tag,
            of=element.get("site") or element.get("joint") or element.get("objname") or "",
        )
        for element in root.iterfind("sensor/*")
    )
    keys = (element.get("name", "") for element in root.iterfind("keyframe/key"))
    return Model(
        path=path,
        sensors=tuple(sensor for sensor in sensors if sensor.name),
        keyframes=tuple(key for key in keys if key),
        actuators=len(root.findall("actuator/*")),
    )
