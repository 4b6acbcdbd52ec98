"""A trial: the nodes of a stack in lockstep, and the test's actions on them.

A test is sequential code: time stands still between calls to `run`, so it can check, decide and
act at exact times. Actions without a time happen immediately.
"""

import functools
import gc
import math
import operator
import time
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from typing import Any, Final, Self

from rcl_interfaces.srv import SetParameters
from rclpy.exceptions import InvalidHandle
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from obelisk_py.core.exceptions import ObeliskError
from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.lockstep.scheduler import (
    FAULT,
    NS_PER_S,
    TIMER,
    LockstepError,
    ScheduledNode,
    TimingModel,
)
from obelisk_py.core.lockstep.surroundings import LockstepRun, StepEvents
from obelisk_py.core.lockstep.topics import Topic
from obelisk_py.core.messages import message_name
from obelisk_py.core.parameter_rules import guard_setting_service
from obelisk_py.core.robot import ObeliskRobot, ObeliskSimRobot
from obelisk_spec.runtime_protocol import rejection_text
from obelisk_spec.suggestions import did_you_mean
from obk_testing.arguments import (
    LONGEST_S,
    require_duration,
    require_number,
    require_time,
    require_vector,
)
from obk_testing.bodies import Bodies, Vector
from obk_testing.disturbances import Disturbances
from obk_testing.programs import LoadedNode, LoadedStack, find_node
from obk_testing.result import Intervention, StateLog, TrialFacts, TrialResult
from obk_testing.schedule import Schedule

__all__ = ["StackTrial"]

__tracebackhide__ = True
"""Makes pytest show the line in the test instead of lines in this module."""

_ANSWER_S: Final = 1.0
"""Timeout for a service to respond to a test, in simulated time [s]."""
_KEYFRAME: Final = "ic_keyframe"
_BEFORE: Final = {"configure": "unconfigured", "activate": "inactive"}
"""The state that a transition starts from."""
_STUB_DEPTH: Final = 10
_LARGEST_SIGMA: Final = 1e300
_WORLD: Final = "world"
"""The body to which the others are attached."""
_OFFERED: Final = QoSProfile(
    depth=_STUB_DEPTH,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""A profile that matches every subscription."""
_AFTER_TIMERS: Final = 1 << 60
"""Positions after those of all timers."""


class StackTrial:
    """The active nodes of a stack, from time 0 on."""

    def __init__(
        self,
        stack: LoadedStack,
        *,
        seed: int = 0,
        schedule: Schedule | None = None,
        parameters: Mapping[str, Mapping[str, Any]] | None = None,
        keyframe: str | None = None,
        watch: Iterable[str] = (),
        record: Iterable[str] | None = None,
    ) -> None:
        """Create the nodes and bring them up.

        Args:
            stack: the stack.
            seed: seed of noise, unseeded generators and the schedule; 0 keeps the noise as
                configured.
            schedule: None for the schedule of the seed, see `Schedule.varied`.
            parameters: node -> parameter -> value, set before the nodes are configured.
            keyframe: the initial keyframe of the model; None to use the config's.
            watch: topics that count as subscribed even without a subscriber.
            record: topics to record; None for all.

        Raises:
            LockstepError: a node cannot be brought up or cannot run in lockstep.
            LookupError: a node or topic does not exist.
            TypeError: `watch` or `record` is a string.
            ValueError: the seed is negative.
        """
        watched, recorded = _topics_in("watch", watch), _topics_in("record", record)
        seed = operator.index(seed)  # NumPy's integers are not seeds for `random`
        require_number("the seed", seed)
        self.stack = stack
        self.seed = seed
        # Simulators are active at time 0, so that a test can act on them immediately.
        names = [node.planned.full_name for node in stack.nodes if not node.planned.model]
        self.schedule = Schedule.varied(seed, names) if schedule is None else schedule
        self.nodes: dict[str, Any] = {}
        """The node objects by full name."""
        self._faults: dict[str, None] = {}
        self._states: StateLog | None = None
        self._is_closed = self._has_begun = False
        self.wall_s = 0.0
        """Wall time of all calls to `run` [s]."""
        self.interventions: list[Intervention] = []
        """The test's actions on the stack."""
        self._looked_at: dict[tuple[str, ...], None] = {}
        self._compute_s = self._by_full_name(self.schedule.compute)
        self._start_s = self._by_full_name(self.schedule.bring_up)
        self._parameters = {n: dict(p) for n, p in self._by_full_name(parameters or {}).items()}
        self._lockstep = LockstepRun(
            seed=seed,
            timing=TimingModel(
                latency=self.schedule.latency,
                jitter=self.schedule.jitter,
                random_phases=self.schedule.phases,
            ),
            watched=watched,
            is_recorded=lambda topic: record is None or topic in recorded,
            on_simulator=self._observe,
        )
        self._bodies = Bodies(stack.plan, self._lockstep)
        self._disturbances = Disturbances(self._lockstep.scheduler, seed)
        for node in stack.plan.nodes:
            if node.env:
                self._lockstep.scheduler.note(
                    ("env", node.full_name),
                    f"{node.full_name} runs without its environment variables "
                    f"({', '.join(node.env)}): all nodes share this process",
                )
        for warning in stack.warnings:
            option = warning.span.source.text
            self._lockstep.scheduler.note(
                ("set", warning),
                f"set={[option]}: warning[{warning.code}]: {warning.message}"
                + (f"; {warning.help}" if warning.help else ""),
            )
        if keyframe is not None:
            simulators = [node for node in stack.plan.nodes if node.model]
            for node in simulators:
                self._parameters.setdefault(node.full_name, {})[_KEYFRAME] = keyframe
        stack.generators.begin_trial(seed)
        stack.participant.enter()
        self._has_begun = True
        try:
            self._bring_up()
            for topic in (*watched, *recorded):
                self._require_topic(topic)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        return self._lockstep.scheduler.now_ns / NS_PER_S

    def run(self, duration: float) -> TrialResult:
        """Advance the simulated time.

        Args:
            duration: simulated time [s].

        Returns:
            The trial from its start until now.

        Raises:
            LockstepError: nodes trigger each other endlessly, or a thread does not end its turn.
            ValueError: the duration is negative or not finite.
        """
        require_time("the duration", duration)
        scheduler = self._lockstep.scheduler
        start_s = time.perf_counter()
        try:
            with self._lockstep.entered():
                scheduler.run_until(scheduler.now_ns + round(duration * NS_PER_S))
        finally:
            self.wall_s += time.perf_counter() - start_s
        return self._result()

    def parameter_paths(self) -> Iterator[str]:
        """Yield the config paths of the parameters that the test set at the start of the trial."""
        for name, parameters in self._parameters.items():
            yield from (f"{self.stack.places[name]}.params.{one}" for one in parameters)

    def result(self) -> TrialResult:
        """Return the trial from its start until now."""
        with self._lockstep.entered():
            for name, node in self.nodes.items():
                if isinstance(node, ObeliskRobot):
                    scheduled = self._lockstep.nodes[name]
                    self._lockstep.scheduler.run_as(scheduled, node.report_rejections)
        return self._result()

    def _result(self) -> TrialResult:
        self._collect_faults()
        lockstep = self._lockstep
        return TrialResult(
            facts=TrialFacts(
                config=self.stack.config,
                plan=self.stack.plan,
                seed=self.seed,
                schedule=asdict(self.schedule),
                interventions=tuple(self.interventions),
                looked_at=self._looked_at,
            ),
            duration_s=self.t,
            topics=lockstep.topics.by_name,
            states=self._states,
            faults=(*self._faults, *self._lasting_rejections()),
            notes=tuple(lockstep.scheduler.notes),
            log=tuple(lockstep.interception.log),
            ways=self._unpublished(),
        )

    def at(self, t: float, call: Callable[[], object]) -> None:
        """Schedule a call at a time [s], after the steps and before the messages of that time.

        Raises:
            ValueError: the time is in the past, or not finite.
        """
        require_time("the time", t)
        due_ns = round(t * NS_PER_S)
        if due_ns < self._lockstep.scheduler.now_ns:
            raise ValueError(f"the time is {t}, expected at least the current time, {self.t:g}")
        self._lockstep.scheduler.push(due_ns, FAULT, None, lambda: (call(), None)[1])

    # --- the robot

    def push(
        self,
        body: str,
        force: Vector,
        duration: float,
        torque: Vector = (0.0, 0.0, 0.0),
        robot: str | None = None,
    ) -> None:
        """Push a body of the model, starting now.

        Args:
            body: name of the body.
            force: force at its center of mass, in the world frame [N], shape `(3,)`.
            duration: duration, rounded up to steps of the simulator [s]; infinity for the rest of
                the trial.
            torque: torque in the world frame [N m], shape `(3,)`.
            robot: the simulator; None if only one has such a body.

        Raises:
            LookupError: no model has such a body, several have it, or the stack has no simulator.
            ValueError: the duration is not positive, a number is not finite, or the body cannot
                move.
        """
        require_vector("the force", force)
        require_vector("the torque", torque)
        require_duration(duration)
        if body == _WORLD:
            raise ValueError(f"`{_WORLD}` cannot move")
        self._bodies.push(body, force, min(duration, LONGEST_S), torque, robot)
        self._log_intervention(f"push {body} with {_list(force)} N, {_list(torque)} N m", duration)

    def scale_mass(self, body: str, factor: float, robot: str | None = None) -> None:
        """Multiply the mass and inertia of a body of the model, for the rest of the trial.

        Args:
            body: name of the body.
            factor: above 0; 2 doubles the weight.
            robot: the simulator; None if only one has such a body.

        Raises:
            LookupError: no model has such a body, several have it, or the stack has no simulator.
            ValueError: the factor is not above 0.
        """
        if not 0 < factor < math.inf:
            raise ValueError(f"factor {factor}: expected a number above 0")
        self._bodies.scale_mass(body, factor, robot)
        self._log_intervention(f"scale the mass of {body} by {factor:g}")

    # --- topics

    def drop(self, topic: str, share: float = 1.0, duration: float = float("inf")) -> None:
        """Drop a fraction of the messages published from now on, selected by the seed.

        Args:
            topic: full name.
            share: fraction of the messages to drop, 0 to 1.
            duration: how long messages are dropped [s].

        Raises:
            LookupError: no node has the topic.
            ValueError: the share is not from 0 to 1, or the duration is not positive.
        """
        require_number("the share", share, most=1.0)
        require_duration(duration)
        self._disturbances.drop(self._topic(topic), share, duration)
        self._log_intervention(f"drop {share:g} of {topic}", duration)

    def delay(self, topic: str, seconds: float, duration: float = float("inf")) -> None:
        """Delay the messages published from now on.

        Args:
            topic: full name.
            seconds: additional latency [s].
            duration: how long messages are delayed [s].

        Raises:
            LookupError: no node has the topic.
            ValueError: the latency is negative, or the duration is not positive.
        """
        require_time("the delay", seconds)
        require_duration(duration)
        self._disturbances.delay(self._topic(topic), seconds, duration)
        self._log_intervention(f"delay {topic} by {seconds:g} s", duration)

    def noise(self, topic: str, field: str, sigma: float, duration: float = float("inf")) -> None:
        """Add noise to a numeric field of the messages published from now on, drawn by the seed.

        Args:
            topic: full name.
            field: path of a float or double, of an array of them, or of a message that contains
                only these, such as `linear_acceleration` or `linear_acceleration.x`.
            sigma: standard deviation, in the unit of the field.
            duration: how long noise is added [s].

        Raises:
            LookupError: the messages have no such field, or it has another type.
            ValueError: the standard deviation is negative, or the duration is not positive.
        """
        require_number("sigma", sigma, most=_LARGEST_SIGMA)
        require_duration(duration)
        self._disturbances.noise(self._topic(topic), field, sigma, duration)
        self._log_intervention(f"add noise of {sigma:g} to {topic}.{field}", duration)

    def publish(self, topic: str, message: Any) -> None:
        """Publish a message now, from outside the stack; it arrives without latency.

        `drop`, `delay` and `noise` apply to it.

        Raises:
            LookupError: no node has the topic.
            TypeError: the topic has another type.
        """
        self._require_type(topic, type(message))
        self._log_intervention(f"publish on {topic}")
        with self._lockstep.entered():
            self._lockstep.topics.publish(topic, message)

    def feed(self, topic: str, data: bytes, time_ns: int, *, after_timers: bool = False) -> None:
        """Publish a recorded message at a given time, from outside the stack.

        Args:
            topic: full name; a node must subscribe to it.
            data: the serialized message.
            time_ns: time of publication [ns].
            after_timers: whether its publisher ran after the timers of that time.
        """
        found, scheduler = self._topic(topic), self._lockstep.scheduler

        def publish() -> None:
            self._lockstep.topics.publish_bytes(found, data, scheduler.delay_ns(topic))

        if after_timers:
            place = _AFTER_TIMERS + scheduler.next_place()
            scheduler.push_at_place(time_ns, TIMER, place, None, publish)
        else:
            scheduler.push(time_ns, FAULT, None, publish)

    def message_type(self, topic: str) -> str:
        """Return the full type name of a topic's messages.

        Raises:
            LookupError: no node has the topic.
        """
        return message_name(self._topic(topic).message_class)

    # --- nodes

    def freeze(self, node: str, duration: float) -> None:
        """Freeze a node for some time [s]; messages and timers that become due run afterwards.

        The simulation of a frozen robot stands still, and does not make up for missed steps. With
        several freezes, the node is frozen until the last one ends.

        Raises:
            ValueError: the duration is not positive.
        """
        require_duration(duration)
        scheduler, scheduled = self._lockstep.scheduler, self._scheduled(node)
        self._log_intervention(f"freeze {node}", duration)
        scheduler.freeze(scheduled)
        if self.t + duration <= LONGEST_S:
            self.at(self.t + duration, lambda: scheduler.thaw(scheduled))

    def kill(self, node: str) -> None:
        """Kill a node, as with SIGKILL."""
        scheduled = self._scheduled(node)
        self._collect_faults()
        self._log_intervention(f"kill {node}")
        self._lockstep.kill(scheduled)

    def restart(self, node: str, after: float = 0.0) -> None:
        """Kill a node, and create and bring up a new one after some time [s].

        Raises:
            ValueError: the time is negative or not finite.
        """
        require_time("the time until the restart", after)
        name = find_node(self.stack.plan, node).full_name
        self.kill(name)
        self._log_intervention(f"restart {node}", after)
        self.at(self.t + after, functools.partial(self._remake, name))

    def call(self, service: str, request: Any = None) -> Any:
        """Call a service, and advance the time until it responds.

        Args:
            service: full name.
            request: None for an empty request.

        Returns:
            The response.

        Raises:
            LookupError: no node provides the service.
            TypeError: the service has another type.
            LockstepError: the service does not respond within 1 s.
        """
        services, scheduler = self._lockstep.services, self._lockstep.scheduler
        if not services.has(service):
            near = did_you_mean(service, services.names()) or ", ".join(services.names())
            raise LookupError(f"no node provides the service {service}: {near}")
        expected = services.request_class(service)
        if not (request is None or isinstance(request, expected)):
            raise TypeError(
                f"{service} has requests of type {expected.__name__}, not {type(request).__name__}"
            )
        self._log_intervention(f"call {service}")
        answers: list[Any] = []
        with self._lockstep.entered():
            services.call(service, request, None, answers.append)
            end_ns = scheduler.now_ns + round(_ANSWER_S * NS_PER_S)
            while not answers and scheduler.now_ns < end_ns:
                scheduler.run_until(scheduler.next_due_ns(end_ns))
        if not answers:
            raise LockstepError(
                f"{service} did not respond within {_ANSWER_S:g} s of simulated time"
            )
        return answers[0]

    def set_parameter(self, node: str, name: str, value: Any) -> None:
        """Set a parameter of a node now.

        Raises:
            LookupError: the node has no such parameter.
            LockstepError: the node rejects the value, and the message has the node's reason; or the
                node was killed.
        """
        full_name = find_node(self.stack.plan, node).full_name
        if not self._lockstep.nodes[full_name].is_alive:
            raise LockstepError(f"{full_name} was killed or has ended, so it has no parameters")
        self._log_intervention(f"set `{name}` of {node} to {value!r}")
        with self._lockstep.entered():
            self._set_parameter(full_name, name, value)

    def stub(
        self, name: str, on: str, do: Callable[[Any], Mapping[str, Any] | None], kind: type[Any]
    ) -> None:
        """Stand in for a node that `stack(..., without=[...])` left out.

        Args:
            name: full name of the node.
            on: the topic that it subscribes to.
            do: called with each message; returns the messages to publish, topic -> message. A
                topic that does not exist or has another type ends the run with an error.
            kind: the message class of `on`.

        Raises:
            LookupError: no node has the topic `on`.
            TypeError: the topic has another type.
        """
        self._require_type(on, kind)

        def make() -> GuardedLifecycleNode:
            namespace, _, own = name.rpartition("/")
            node = GuardedLifecycleNode(own, namespace=namespace or "/")
            publishers: dict[str, Any] = {}

            def answer(message: Any) -> None:
                for topic, published in (do(message) or {}).items():
                    if topic not in publishers:
                        self._check_output(topic, type(published))
                        publishers[topic] = node.create_publisher(type(published), topic, _OFFERED)
                    publishers[topic].publish(published)

            node.create_subscription(kind, on, answer, _STUB_DEPTH)
            return node

        with self._lockstep.entered():
            self.nodes[name] = self._lockstep.make_node(name, make)

    def close(self) -> None:
        """Shut down and release the nodes; further calls have no effect."""
        if self._is_closed:
            return
        self._is_closed = True
        lockstep = self._lockstep
        nodes = [weakref.ref(node) for node in self.nodes.values()]
        with lockstep.entered():
            while self.nodes:
                name, node = self.nodes.popitem()
                _destroy(lockstep, lockstep.nodes[name], node)
                lockstep.nodes[name].node = None
                del node
            lockstep.close()
        # Nodes keep their names in rcl until they are collected. Objects that a C extension holds
        # need a second collection.
        for _ in range(2):
            gc.collect()
            if not any(node() for node in nodes):
                break
        if self._has_begun:
            self.stack.participant.leave()

    # --- implementation

    def _by_full_name(self, given: Mapping[str, Any]) -> dict[str, Any]:
        plan = self.stack.plan
        return {find_node(plan, name).full_name: value for name, value in given.items()}

    def _bring_up(self) -> None:
        with self._lockstep.entered():
            for node in self.stack.nodes:
                self._make(node)
            for name in self.nodes:
                self._transition(name, "configure")
            for name in self.nodes:
                start_s = self._start_s.get(name, 0.0)
                if start_s > 0.0:
                    self.at(start_s, functools.partial(self._try_transition, name, "activate"))
                else:
                    self._transition(name, "activate")
            self._lockstep.scheduler.check()

    def _make(self, loaded: LoadedNode) -> None:
        name = loaded.planned.full_name
        compute_s = self._compute_s.get(name, 0.0)
        try:
            node = self.nodes[name] = self._lockstep.make_node(name, loaded.make, compute_s)
        except ObeliskError as error:
            # The message names the mistake; a traceback of the library would hide it.
            raise LockstepError(
                f"{loaded.planned.origin}: {name} cannot be created: {error}"
            ) from None
        if name in self.stack.unclear_robots and not isinstance(node, ObeliskSimRobot):
            raise LockstepError(
                f"{loaded.planned.origin}: the robot {name} ({type(node).__name__}) is not a "
                "simulator that obk knows, and tests never access hardware. If it is simulated, "
                "set `is_simulated: true`"
            )
        for parameter, value in self._parameters.get(name, {}).items():
            self._set_parameter(name, parameter, value)

    def _remake(self, name: str) -> None:
        _destroy(self._lockstep, self._lockstep.nodes[name], self.nodes.pop(name))
        self._make(next(node for node in self.stack.nodes if node.planned.full_name == name))
        self._try_transition(name, "configure")
        self._try_transition(name, "activate")

    def _set_parameter(self, name: str, parameter: str, value: Any) -> None:
        node, scheduled = self.nodes[name], self._lockstep.nodes[name]
        if not node.has_parameter(parameter):
            near = did_you_mean(parameter, node.list_parameters([], 0).names)
            raise LookupError(f"{name} has no parameter `{parameter}`: {near}")
        make: Any = Parameter
        request = SetParameters.Request(
            parameters=[make(parameter, value=value).to_parameter_msg()]
        )
        serve = guard_setting_service(node, SetParameters, functools.partial(_set_parameters, node))
        response = self._lockstep.scheduler.run_as(
            scheduled, functools.partial(serve, request, SetParameters.Response())
        )
        if not response.results[0].successful:
            reason = response.results[0].reason
            raise LockstepError(f"{name} rejects `{parameter}` = {value!r}: {reason}")

    def _transition(self, name: str, label: str) -> None:
        node = self.nodes[name]
        trigger = getattr(node, f"trigger_{label}")
        result = self._lockstep.scheduler.run_as(self._lockstep.nodes[name], trigger)
        self._lockstep.scheduler.check()
        if result != TransitionCallbackReturn.SUCCESS:
            raise LockstepError(f"{name} did not {label}: {node.last_fault}")

    def _try_transition(self, name: str, label: str) -> None:
        """Start a transition during the run, unless the node has ended or is in another state."""
        node, scheduled = self.nodes[name], self._lockstep.nodes[name]
        if scheduled.is_alive and node.state_label == _BEFORE[label]:
            self._lockstep.scheduler.run_as(scheduled, getattr(node, f"trigger_{label}"))

    def _observe(self, steps: StepEvents) -> None:
        """Record the states of a simulator, and scale the masses of its bodies."""
        data, scheduler = steps.robot.mj_data, self._lockstep.scheduler
        name, model = steps.robot.get_fully_qualified_name(), steps.robot.mj_model
        self._bodies.restore_masses(name, model)  # a restarted robot reads its model again
        states = self._states
        if states is None:
            states = self._states = StateLog(name, model)
        if states.robot == name:  # only the first simulator, restarted or not
            qpos, qvel = data.qpos, data.qvel  # views of MuJoCo's memory
            steps.after_step.append(lambda: states.add(scheduler.now_ns, qpos, qvel))

    def _topic(self, name: str) -> Topic:
        self._require_topic(name, self._lockstep.topics.by_name)
        return self._lockstep.topics.by_name[name]

    def _require_topic(self, name: str, known: Iterable[str] | None = None) -> None:
        """Check that a topic is known, by default in the plan or to a node.

        Raises:
            LookupError: it is not.
        """
        if known is None:
            nodes = (*self.stack.plan.nodes, *self.stack.left_out)
            ends = (end for node in nodes for end in (*node.publishes, *node.subscribes))
            known = {*self._lockstep.topics.by_name, *(end.topic for end in ends)}
        if name not in known:
            near = did_you_mean(name, known) or ", ".join(sorted(known))
            raise LookupError(f"no node has the topic `{name}`: {near}")

    def _require_type(self, topic: str, kind: type[Any]) -> None:
        expected = self._topic(topic).message_class
        if kind is not expected:
            raise TypeError(
                f"{topic} has messages of type {message_name(expected)}, not {kind.__name__}"
            )

    def _check_output(self, topic: str, kind: type[Any]) -> None:
        """End the run, and not only the stub, if its output is a mistake."""
        try:
            self._require_topic(topic)
            if topic in self._lockstep.topics.by_name:
                self._require_type(topic, kind)
        except (LookupError, TypeError) as error:
            raise self._lockstep.scheduler.stop(error) from None

    def _log_intervention(self, text: str, duration: float = 0.0) -> None:
        self.interventions.append(Intervention(t=self.t, duration=duration, text=text))

    def _scheduled(self, node: str) -> ScheduledNode:
        if node in self._lockstep.nodes:
            return self._lockstep.nodes[node]
        return self._lockstep.nodes[find_node(self.stack.plan, node).full_name]

    def _collect_faults(self) -> None:
        for name, node in self.nodes.items():
            if node.last_fault is not None:
                self._faults[f"{name}: {node.last_fault}"] = None
        self._faults |= dict.fromkeys(self._lockstep.faults)

    def _lasting_rejections(self) -> Iterator[str]:
        """Yield a fault for each robot that rejects all commands now, as at the end of a run."""
        for name, node in self.nodes.items():
            if isinstance(node, ObeliskRobot) and self._lockstep.nodes[name].is_alive:
                lasting = node.lasting_rejection()
                if lasting is not None:
                    yield rejection_text(name, lasting.seconds, lasting.reason)

    def _unpublished(self) -> dict[str, str]:
        """Return why topics in the plan have no messages."""
        listened = {end.topic for node in self.stack.plan.nodes for end in node.subscribes}
        topics = self._lockstep.topics.by_name

        def is_unpublished(name: str) -> bool:
            topic = topics.get(name)
            if topic is None:
                return name not in listened
            return topic.lacked_subscribers and not topic.log

        return {
            end.topic: f"{end.topic} has no messages: no node subscribes, so {node.full_name} does "
            f"not publish it. Pass `watch=['{end.topic}']` to the stack"
            for node in self.stack.plan.nodes
            for end in node.publishes
            if is_unpublished(end.topic)
        }


def _topics_in(argument: str, topics: Iterable[str] | None) -> tuple[str, ...]:
    if isinstance(topics, str):
        raise TypeError(f"{argument}={topics!r} is a string, expected a list of topics")
    return tuple(topics or ())


def _set_parameters(node: Any, request: Any, response: Any) -> Any:
    """Respond as rclpy's parameter service does."""
    response.results += node.set_parameters(
        [Parameter.from_parameter_msg(message) for message in request.parameters]
    )
    return response


def _list(vector: Vector) -> str:
    return "[" + ", ".join(f"{number:.4g}" for number in vector) + "]"


def _destroy(lockstep: LockstepRun, scheduled: ScheduledNode, node: Any) -> None:
    """Shut down a node and the nodes that its code has created; nothing is published."""
    lockstep.kill(scheduled)
    for each in (*reversed(scheduled.others), node):
        lockstep.executor.remove_node(each)
        with suppress(InvalidHandle):  # its own code may have destroyed it
            if isinstance(each, GuardedLifecycleNode) and each.state_label != "finalized":
                lockstep.scheduler.run_as(scheduled, each.trigger_shutdown)
            lockstep.scheduler.run_as(scheduled, each.destroy_node)
    scheduled.others.clear()
