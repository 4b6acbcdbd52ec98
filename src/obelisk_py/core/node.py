"""`ObeliskNode`: a life-cycle node whose publishers, subscriptions and timers come from settings.

The constructor registers components; configure builds them from ROS parameters, activate starts
them, deactivate stops them, cleanup destroys them, so that configure can run again.
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any, Final

from rclpy.callback_groups import (
    CallbackGroup,
    MutuallyExclusiveCallbackGroup,
    ReentrantCallbackGroup,
)
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from obelisk_py.core.components import ComponentKind, ComponentTable, RegisteredComponent, spellings
from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError
from obelisk_py.core.parameters import Getter
from obelisk_py.core.rate_monitor.diagnostics import RateMonitoredNode
from obelisk_py.core.settings import (
    NodeSettings,
    check_component,
    entry_names,
    find_settings,
    message_class_of,
    parse_node_settings,
    timer_settings,
    topic_settings,
)
from obelisk_spec.components import CALLBACK_GROUP_TYPES, component_identity
from obelisk_spec.runtime_protocol import USE_SIM_TIME

__all__ = ["ObeliskNode"]

CALLBACK_GROUPS: dict[str, Callable[[], CallbackGroup]] = {
    "MutuallyExclusiveCallbackGroup": MutuallyExclusiveCallbackGroup,
    "ReentrantCallbackGroup": ReentrantCallbackGroup,
}

SETTINGS: Final = "obelisk_settings"
"""The ROS parameter with the settings of components that have none of their own."""

Default = str | Mapping[str, Any] | None


class ObeliskNode(RateMonitoredNode):
    """A life-cycle node wired by a config: `obk_publishers`, `obk_subscriptions`, `obk_timers`.

    `opened`, an `ExitStack`, is closed at cleanup, shutdown and error, before the publishers go.
    """

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        """Make the node; register components in the constructor of the inheriting class.

        Args:
            node_name: name in the ROS graph, unless it is remapped.
            kwargs: passed to `rclpy.node.Node`.
        """
        super().__init__(node_name, **kwargs)
        self.declare_parameter("params_path", "")
        self.declare_parameter(SETTINGS, "")
        self._parameter_rules.add((SETTINGS,), lambda value: parse_node_settings(value(SETTINGS)))
        # The clock of timers is chosen when they are made.
        self._parameter_rules.add((USE_SIM_TIME,))
        self.obk_publishers: ComponentTable[LifecyclePublisher] = ComponentTable(
            ComponentKind.PUBLISHER
        )
        self.obk_subscriptions: ComponentTable[Subscription] = ComponentTable(
            ComponentKind.SUBSCRIPTION
        )
        self.obk_timers: ComponentTable[Timer] = ComponentTable(ComponentKind.TIMER)
        self.obk_callback_groups: dict[str, CallbackGroup] = {}
        self.opened = ExitStack()
        self._components: list[RegisteredComponent] = []
        self._registration_open = True
        self._is_built = False

    @property
    def t(self) -> float:
        """The node clock's time [s]: since 1970, or simulated time with `use_sim_time`."""
        return float(self.get_clock().now().nanoseconds * 1e-9)

    @property
    def params_path(self) -> str:
        """The ROS parameter `params_path` as in the config; empty if the config has none."""
        return str(self.get_parameter("params_path").value)

    def register_obk_publisher(
        self,
        ros_parameter: str | None = None,
        key: str | None = None,
        msg_type: type[Any] | None = None,
        default: Default = None,
        *,
        required: bool = True,
    ) -> None:
        """Register a publisher, which configure creates.

        Args:
            ros_parameter: the ROS parameter that carries its settings; declared here.
            key: its name in `obk_publishers`.
            msg_type: its message class; without it the settings name the type.
            default: its settings if neither the parameter nor `obelisk_settings` has any.
            required: without settings, fail configure instead of leaving it out.

        Raises:
            ObeliskConfigError: no name, a name twice, or the node was configured already.
        """
        self._register(
            RegisteredComponent(
                kind=ComponentKind.PUBLISHER,
                ros_parameter=ros_parameter,
                key=key,
                msg_type=msg_type,
                default=default,
                required=required,
            )
        )

    def register_obk_subscription(
        self,
        ros_parameter: str | None = None,
        callback: Callable[[Any], Any] | None = None,
        key: str | None = None,
        msg_type: type[Any] | None = None,
        default: Default = None,
        *,
        required: bool = True,
    ) -> None:
        """Register a subscription, which configure creates.

        Args:
            ros_parameter: the ROS parameter that carries its settings; declared here.
            callback: called with each message.
            key: its name in `obk_subscriptions`.
            msg_type: its message class; without it the settings name the type.
            default: its settings if neither the parameter nor `obelisk_settings` has any.
            required: without settings, fail configure instead of leaving it out.

        Raises:
            ObeliskConfigError: no name, no callback, a name twice, or configured already.
        """
        self._register(
            RegisteredComponent(
                kind=ComponentKind.SUBSCRIPTION,
                ros_parameter=ros_parameter,
                key=key,
                callback=callback,
                msg_type=msg_type,
                default=default,
                required=required,
            )
        )

    def register_obk_timer(
        self,
        ros_parameter: str | None = None,
        callback: Callable[[], Any] | None = None,
        key: str | None = None,
        default: Default = None,
        *,
        required: bool = True,
    ) -> None:
        """Register a timer, which configure creates and activate starts.

        Args:
            ros_parameter: the ROS parameter that carries its settings; declared here.
            callback: called at each period.
            key: its name in `obk_timers`.
            default: its settings if neither the parameter nor `obelisk_settings` has any.
            required: without settings, fail configure instead of leaving it out.

        Raises:
            ObeliskConfigError: no name, no callback, a name twice, or configured already.
        """
        self._register(
            RegisteredComponent(
                kind=ComponentKind.TIMER,
                ros_parameter=ros_parameter,
                key=key,
                callback=callback,
                default=default,
                required=required,
            )
        )

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build callback groups, publishers, subscriptions and (stopped) timers.

        Raises:
            ObeliskConfigError: settings are missing or wrong; all of them are named at once.
        """
        self._registration_open = False
        result = super().on_configure(state)
        node = parse_node_settings(str(self.get_parameter(SETTINGS).value))
        self.obk_callback_groups = {
            name: CALLBACK_GROUPS[kind]() for name, kind in node.callback_groups.items()
        }
        self._warn_of_unknown_components(node)
        faults: list[str] = []
        for component in self._components:
            try:
                self._build(component, node)
            except ObeliskError as error:
                faults.append(str(error))
        if faults:
            self._release()
            raise ObeliskConfigError("\n".join(faults))
        self._is_built = True
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let the publishers send and start the timers."""
        result = super().on_activate(state)
        self._start()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the timers and hold the publishers."""
        self._hold(state)
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Destroy what configure built."""
        self._release()
        return super().on_cleanup(state)

    def destroy_node(self) -> None:
        """Close `opened`, as cleanup does, and destroy the node."""
        self.opened.close()
        super().destroy_node()

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and destroy what configure built, whatever the state."""
        self._hold(state)
        self._release()
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and destroy what configure built; success leads back to `unconfigured`."""
        self._hold(state)
        self._release()
        return super().on_error(state)

    def _settle(self, state: str) -> None:
        super()._settle(state)
        if state == "active":
            self._start()
            return
        self._hold(LifecycleState(state_id=0, label=state))
        if state != "inactive":
            self._release()
        elif not self._is_built:
            self.fail("it did not call super().on_configure(state): nothing is built", "configure")

    def _start(self) -> None:
        for timer in self.obk_timers.values():
            if timer.is_canceled():
                timer.reset()

    def _hold(self, state: LifecycleState) -> None:
        """Stop everything that configure built; a user's override may not have done so."""
        for timer in self.obk_timers.values():
            timer.cancel()
        for entity in self._managed_entities:
            entity.on_deactivate(state)

    def _register(self, component: RegisteredComponent) -> None:
        if not self._registration_open:
            raise ObeliskConfigError(
                f"the {component} was registered after configure; "
                "components are registered in the constructor"
            )
        for other in self._components:
            if other.kind is component.kind and other.names & component.names:
                raise ObeliskConfigError(f"the {component} is registered already, as the {other}")
        if component.ros_parameter:
            self.declare_parameter(component.ros_parameter, "")
            self._hold_to_rules(component, component.ros_parameter)
        self._components.append(component)

    def _hold_to_rules(self, component: RegisteredComponent, parameter: str) -> None:
        def check(value: Getter) -> None:
            check_component(component, value(parameter), value(SETTINGS))

        self._parameter_rules.add((parameter,), check)

    def _build(self, component: RegisteredComponent, node: NodeSettings) -> None:
        parameter = component.ros_parameter
        text = str(self.get_parameter(parameter).value) if parameter else ""
        raw = find_settings(component, text, node)
        if raw is None:
            self._without_settings(component)
            return
        config_key = raw.get("key")
        names = component.names | spellings(config_key)
        name = component.key or str(config_key or parameter).removesuffix("_setting")
        if component.kind is ComponentKind.TIMER:
            self.obk_timers.add(name, names, self._timer(name, component, raw))
        elif component.kind is ComponentKind.PUBLISHER:
            self.obk_publishers.add(name, names, self._publisher(component, raw))
        else:
            self.obk_subscriptions.add(name, names, self._subscription(component, raw))

    def _without_settings(self, component: RegisteredComponent) -> None:
        where = (
            f"the parameter `{component.ros_parameter}`"
            if component.ros_parameter
            else f"an entry with `key: {component.key}` in the parameter `obelisk_settings`"
        )
        if component.required:
            raise ObeliskConfigError(f"the {component} has no settings: set {where}")
        # `obk validate` reports it; at each launch it would be noise.
        self.get_logger().debug(f"the optional {component} is left out: {where} is not set")

    def _publisher(
        self, component: RegisteredComponent, raw: Mapping[str, Any]
    ) -> LifecyclePublisher:
        settings = topic_settings(component, raw)
        publisher: LifecyclePublisher = self.create_lifecycle_publisher(
            message_class_of(component, settings.msg_type),
            settings.topic,
            settings.qos,
            callback_group=self._group(component, settings.callback_group),
        )
        return publisher

    def _subscription(self, component: RegisteredComponent, raw: Mapping[str, Any]) -> Subscription:
        settings = topic_settings(component, raw)
        assert component.callback is not None
        return self.create_subscription(
            message_class_of(component, settings.msg_type),
            settings.topic,
            component.callback,
            settings.qos,
            callback_group=self._group(component, settings.callback_group),
        )

    def _timer(self, name: str, component: RegisteredComponent, raw: Mapping[str, Any]) -> Timer:
        settings = timer_settings(component, raw)
        assert component.callback is not None
        return self.create_monitored_timer(
            component_identity(str(raw.get("ros_parameter") or name)),
            settings.period_s,
            component.callback,
            group=self._group(component, settings.callback_group),
            clock=self._timer_clock(),
        )

    def _timer_clock(self) -> Clock:
        # A jump of the wall clock must not stop or hurry a control loop; only simulated time is
        # followed.
        if self.get_parameter(USE_SIM_TIME).value:
            return self.get_clock()
        return Clock(clock_type=ClockType.STEADY_TIME)

    def _group(self, component: RegisteredComponent, name: str | None) -> CallbackGroup | None:
        if name is None:
            return None
        if name not in self.obk_callback_groups:
            types = ", ".join(CALLBACK_GROUP_TYPES)
            have = ", ".join(self.obk_callback_groups) or f"none (types: {types})"
            raise ObeliskConfigError(
                f"the {component} is in the callback group `{name}`; there are: {have}"
            )
        return self.obk_callback_groups[name]

    def _warn_of_unknown_components(self, node: NodeSettings) -> None:
        """Warn about settings of components that the code does not register."""
        for kind, entries in node.components.items():
            known = [c for c in self._components if c.kind is kind]
            for entry in entries:
                names = entry_names(entry)
                if not any(component.names & names for component in known):
                    have = ", ".join(f"`{c.key or c.ros_parameter}`" for c in known) or "none"
                    self.get_logger().warning(
                        f"the config has a {kind.noun} "
                        f"`{entry.get('key') or entry.get('ros_parameter')}` that this node's code "
                        f"does not register; it registers: {have}"
                    )

    def _release(self) -> None:
        self._is_built = False
        self.opened.close()
        for timer in self.obk_timers.values():
            self.destroy_timer(timer)
        for subscription in self.obk_subscriptions.values():
            self.destroy_subscription(subscription)
        for publisher in self.obk_publishers.values():
            self.destroy_lifecycle_publisher(publisher)
        for table in (self.obk_timers, self.obk_subscriptions, self.obk_publishers):
            table.clear()
        self.obk_callback_groups = {}
        # A group keeps a dead reference for every entity that it ever held.
        group = self.default_callback_group
        group.entities = {entity for entity in group.entities if entity() is not None}
