"""Find the bodies of simulated robots, to push them and to change their masses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.lockstep.surroundings import LockstepRun
from obelisk_spec.suggestions import did_you_mean
from obk_cli.plan.plan import Plan
from obk_testing.programs import find_node

__all__ = ["Bodies", "Vector"]

__tracebackhide__ = True
"""Makes pytest show the line in the test instead of lines in this module."""

Vector = Sequence[float] | NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class _ScaledBody:
    """A body whose mass a test has changed."""

    robot: str
    """Full name of the simulator."""
    body: int
    factor: float


class Bodies:
    """The bodies in the models of a run's simulators."""

    def __init__(self, plan: Plan, lockstep: LockstepRun) -> None:
        """Use the simulators of a run, whose nodes are those of the plan."""
        self._plan = plan
        self._lockstep = lockstep
        self._scaled: list[_ScaledBody] = []
        self._models: dict[str, Any] = {}
        """The models with these masses, by the simulator's full name."""

    def push(
        self, body: str, force: Vector, duration: float, torque: Vector, robot: str | None
    ) -> None:
        """Push a body; for arguments and errors see `StackTrial.push`."""
        simulator = self._lockstep.simulators[self._robot_with(body, robot)].robot
        simulator.push_body(_body_of(simulator.mj_model, body), force, duration, torque)

    def scale_mass(self, body: str, factor: float, robot: str | None) -> None:
        """Multiply the mass of a body; for arguments and errors see `StackTrial.scale_mass`."""
        name = self._robot_with(body, robot)
        model = self._lockstep.simulators[name].robot.mj_model
        scaled = _ScaledBody(robot=name, body=_body_of(model, body), factor=factor)
        self._scaled.append(scaled)
        _scale_mass(model, scaled)

    def restore_masses(self, robot: str, model: Any) -> None:
        """Change the masses again if a simulator, which was restarted, has another model."""
        if self._models.get(robot) is not model:
            self._models[robot] = model
            for scaled in self._scaled:
                if scaled.robot == robot:
                    _scale_mass(model, scaled)

    def _robot_with(self, body: str, robot: str | None) -> str:
        """The full name of the simulator whose model has a body."""
        simulators: Mapping[str, Any] = self._lockstep.simulators
        if not simulators:
            nodes = self._lockstep.nodes
            for node in self._plan.nodes:
                if node.model and not nodes[node.full_name].is_alive:
                    raise LookupError(
                        f"{node.full_name} was killed or has ended, so it has no bodies"
                    )
            raise LookupError("the stack has no MuJoCo simulator of Obelisk, so it has no bodies")
        names = sorted(simulators)
        if robot is not None:
            name = find_node(self._plan, robot).full_name
            if name not in names:
                raise LookupError(f"{name} is not a simulator that is running: {', '.join(names)}")
            names = [name]
        models = {name: simulators[name].robot.mj_model for name in names}
        found = [name for name, model in models.items() if body in _bodies(model)]
        if len(found) > 1:
            raise LookupError(
                f"the models of {', '.join(found)} have a body `{body}`: pass `robot=`"
            )
        return found[0] if found else names[0]


def _bodies(model: Any) -> list[str]:
    return [model.body(number).name for number in range(model.nbody)]


def _body_of(model: Any, name: str) -> int:
    names = _bodies(model)
    if name not in names:
        raise LookupError(
            f"the model has no body `{name}`: {did_you_mean(name, names) or ', '.join(names)}"
        )
    return names.index(name)


def _scale_mass(model: Any, scaled: _ScaledBody) -> None:
    import mujoco  # only installed with a simulator

    model.body_mass[scaled.body] *= scaled.factor
    model.body_inertia[scaled.body] *= scaled.factor
    mujoco.mj_setConst(model, mujoco.MjData(model))
