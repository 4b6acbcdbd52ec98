"""`ObeliskNode`: a lifecycle node whose publishers, subscriptions and timers are set by a config.

Components are registered in the constructor, or in `on_configure` before the call to super.
`configure` creates them from ROS parameters, `activate` starts them, `deactivate` stops them, and
`cleanup` destroys them, so that `configure` can run again.
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, Final, Unpack

from rclpy.callback_groups import (
    CallbackGroup,
    MutuallyExclusiveCallbackGroup,
    ReentrantCallbackGroup,
)
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle.managed_entity import SimpleManagedEntity
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from obelisk_py.core.components import (
    ComponentKind,
    ComponentTable,
    RegisteredComponent,
    RegistrationArguments,
    registered_component,
    spellings,
)
from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError, ObeliskMsgError
from obelisk_py.core.intra_process import disconnect_all
from obelisk_py.core.parameter_rules import Getter
from obelisk_py.core.rate_monitor import RateMonitoredNode
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
from obelisk_py.core.timer_phase import LoopStage
from obelisk_spec.components import (
    CALLBACK_GROUP_TYPES,
    CALLBACK_GROUPS_PARAMETER,
    STANDARD_COMPONENTS,
    component_identity,
)
from obelisk_spec.registration import is_required_by_default
from obelisk_spec.runtime_protocol import USE_SIM_TIME

__all__ = ["ObeliskNode"]

CALLBACK_GROUPS: dict[str, Callable[[], CallbackGroup]] = {
    "MutuallyExclusiveCallbackGroup": MutuallyExclusiveCallbackGroup,
    "ReentrantCallbackGroup": ReentrantCallbackGroup,
}

# A literal, because `obk validate` reads names of parameters from this file.
SETTINGS: Final = "obelisk_settings"
"""The ROS parameter with the settings of components that have no parameter of their own."""

Settings = str | Mapping[str, Any] | None


class ObeliskNode(RateMonitoredNode):
    """A lifecycle node wired by a config: `obk_publishers`, `obk_subscriptions`, `obk_timers`.

    `opened` is an `ExitStack`. It is closed in `cleanup`, in `shutdown` and after an error, before
    the publishers are destroyed. `fail(cause, where)` puts the node into error processing, from any
    thread; exceptions in callbacks do so by themselves.
    """

    loop_stage: LoopStage = LoopStage.SENSE
    """The phase of the node's timers; see `timer_phase`."""

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        """Create the node; subclasses register their components in the constructor.

        Args:
            node_name: name in the ROS graph, unless it is remapped.
            kwargs: passed to `rclpy.node.Node`.
        """
        super().__init__(node_name, **kwargs)
        self.declare_parameter("params_path", "")
        self.node_name = self.get_name()
        """The name in the ROS graph; kept for existing code."""
        self.declare_parameter(SETTINGS, "")
        # A literal, because `obk validate` reads constructors without running them.
        self.declare_parameter("callback_group_settings", "")
        self._parameter_rules.add(
            (SETTINGS, CALLBACK_GROUPS_PARAMETER),
            lambda value: parse_node_settings(value(SETTINGS), value(CALLBACK_GROUPS_PARAMETER)),
        )
        # The clock of a timer is chosen when the timer is created.
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
        self._group_attributes: dict[str, list[Any]] = {}
        """Callback group -> the previous value of its attribute, as a list of at most one item."""
        self._registered_components: list[RegisteredComponent] = []
        self._setting_parameters: set[str] = set()
        self._registration_open = True
        self._has_message_types = False
        """Whether a base class's constructor received a message type, as in G2 and G3."""
        self._is_built = False
        self._configuration = 0
        """Number of times that the node was cleaned up."""

    @property
    def t(self) -> float:
        """The node clock's time [s]: since 1970, or simulated time with `use_sim_time`."""
        return float(self.get_clock().now().nanoseconds * 1e-9)

    @property
    def params_path(self) -> str:
        """The ROS parameter `params_path` as in the config; empty if the config has none."""
        return str(self.get_parameter("params_path").value)

    def register_obk_publisher(
        self, *arguments: str | type[Any] | Settings, **named: Unpack[RegistrationArguments]
    ) -> None:
        """Register a publisher that `configure` creates: `(key, msg_type)`.

        Existing code may also pass `(ros_parameter, msg_type, key, default_config_str)` or
        `(ros_parameter, key, msg_type, default)`.

        Args:
            arguments: any of the above, in this order; all can also be passed by name.
            named:
                key: name in `obk_publishers`.
                msg_type: message class; if omitted, the settings name the type.
                ros_parameter: ROS parameter with the settings; declared by this call.
                default: settings to use if neither the parameter nor `obelisk_settings` has any.
                required: whether `configure` fails without settings; otherwise it omits the
                    publisher with a warning. Defaults to True with a `ros_parameter`, otherwise
                    False.

        Raises:
            ObeliskConfigError: an argument is missing or has the wrong type, the name is already
                registered, or the node is configured.
        """
        self._register(ComponentKind.PUBLISHER, arguments, named)

    def register_obk_subscription(
        self,
        *arguments: str | type[Any] | Callable[..., Any] | Settings,
        **named: Unpack[RegistrationArguments],
    ) -> None:
        """Register a subscription that `configure` creates: `(key, callback, msg_type)`.

        Existing code may also pass `(ros_parameter, callback, msg_type, key, default_config_str)`
        or `(ros_parameter, callback, key, msg_type, default)`.

        Args:
            arguments: any of the above, in this order; all can also be passed by name.
            named: as for a publisher, and:
                callback: called with each message.

        Raises:
            ObeliskConfigError: an argument is missing or has the wrong type, the name is already
                registered, or the node is configured.
        """
        self._register(ComponentKind.SUBSCRIPTION, arguments, named)

    def register_obk_timer(
        self,
        *arguments: str | Callable[..., Any] | Settings,
        **named: Unpack[RegistrationArguments],
    ) -> None:
        """Register a timer that `configure` creates and `activate` starts: `(key, callback)`.

        Existing code may also pass `(ros_parameter, callback, key, default_config_str)`.

        Args:
            arguments: any of the above, in this order; all can also be passed by name.
            named: as for a publisher, without `msg_type`, and:
                callback: called once per period.

        Raises:
            ObeliskConfigError: an argument is missing or has the wrong type, the name is already
                registered, or the node is configured.
        """
        self._register(ComponentKind.TIMER, arguments, named)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Create callback groups, publishers, subscriptions and (stopped) timers.

        Raises:
            ObeliskConfigError: settings are missing or invalid; the message lists all of them.
            ObeliskMsgError: likewise, if the first fault is an invalid message type.
        """
        if self._is_built:  # called again by a test, without on_cleanup
            self._destroy_components()
        self._registration_open = False
        result = super().on_configure(state)
        try:
            self._build_all()
        except Exception:
            self._destroy_components()
            raise
        self._is_built = True
        return result

    def _build_all(self) -> None:
        node = parse_node_settings(
            self._parameter_text(SETTINGS), self._parameter_text(CALLBACK_GROUPS_PARAMETER)
        )
        self._make_groups(node.callback_groups)
        self._warn_of_unknown_components(node)
        faults: list[ObeliskError] = []
        for component in self._registered_components:
            try:
                self._build_component(component, node)
            except ObeliskError as error:
                faults.append(error)
        if not faults:
            return
        # Tests of existing code may expect the error for a message type.
        kind = ObeliskMsgError if isinstance(faults[0], ObeliskMsgError) else ObeliskConfigError
        raise kind("\n".join(map(str, faults)))

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Enable the publishers and start the timers."""
        result = super().on_activate(state)
        self._start_components()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the timers and disable the publishers."""
        self._stop_components(state)
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Destroy everything that `configure` created."""
        self._destroy_components()
        return super().on_cleanup(state)

    def destroy_node(self) -> None:
        """Close `opened`, like `cleanup`, and destroy the node."""
        self.opened.close()
        disconnect_all(self.publishers)
        super().destroy_node()

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and destroy everything that `configure` created, in any state."""
        self._stop_components(state)
        self._destroy_components()
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and destroy what `configure` created; success returns to `unconfigured`."""
        self._stop_components(state)
        self._destroy_components()
        return super().on_error(state)

    def _settle(self, state: str) -> None:
        super()._settle(state)
        if state == "active":
            self._enable_publishers()
            self._start_components()
            return
        self._stop_components(LifecycleState(state_id=0, label=state))
        if state != "inactive":
            self._destroy_components()
        elif not self._is_built:
            self.fail(
                "it did not call super().on_configure(state), so it has no components", "configure"
            )

    def _enable_publishers(self) -> None:
        """Enable all publishers, in case a user's override did not, or disabled them and failed."""
        for entity in self._managed_entities:
            if isinstance(entity, SimpleManagedEntity) and not entity.is_activated:
                entity.on_activate(LifecycleState(state_id=0, label="active"))

    def _start_components(self) -> None:
        for timer in self.obk_timers.values():
            if timer.is_canceled():
                self.surroundings.start_timer(timer, self.loop_stage)

    def _stop_components(self, state: LifecycleState) -> None:
        """Stop everything that `configure` created, in case a user's override did not."""
        for timer in self.obk_timers.values():
            timer.cancel()
        for entity in self._managed_entities:
            entity.on_deactivate(state)

    def _register(
        self, kind: ComponentKind, arguments: tuple[Any, ...], named: Mapping[str, Any]
    ) -> None:
        if "_registered_components" not in vars(self):
            raise ObeliskConfigError(
                f"register_obk_{kind.noun} was called before super().__init__(...); components are "
                "registered after it"
            )
        component = registered_component(self.get_name(), kind, arguments, named)
        if not self._registration_open:
            raise ObeliskConfigError(
                f"the {component} was registered after the `configure` transition; components are "
                "registered in "
                "the constructor, or in on_configure before super().on_configure(state)"
            )
        if component.ros_parameter is None and self._is_given_as_text(component.key):
            component = replace(component, ros_parameter=component.key)
        if self.state_label == "unconfigured":
            # A test may call on_configure directly, several times.
            self._registered_components = [
                other
                for other in self._registered_components
                if other.configuration == self._configuration or not _is_same(other, component)
            ]
        for other in self._registered_components:
            if _is_same(other, component):
                raise ObeliskConfigError(f"the {component} is already registered, as the {other}")
        if component.ros_parameter and component.ros_parameter not in self._setting_parameters:
            self._setting_parameters.add(component.ros_parameter)
            self.declare_parameter(component.ros_parameter, "")
            self._hold_to_rules(component.ros_parameter)
        # The next `configure` transition registers these again.
        is_of_configure = self.state_label == "configuring"
        self._registered_components.append(
            replace(component, is_of_configure=is_of_configure, configuration=self._configuration)
        )

    def _is_given_as_text(self, name: str | None) -> bool:
        """Whether the launcher passes a string as the ROS parameter with this name.

        In G2, `(name, msg_type)` names a ROS parameter, which need not end in `_setting`.
        """
        given = self._parameter_overrides.get(name)
        return given is not None and isinstance(given.value, str)

    def _hold_to_rules(self, parameter: str) -> None:
        def check(value: Getter) -> None:
            for component in self._registered_components:
                if component.ros_parameter == parameter:
                    check_component(component, value(parameter), value(SETTINGS))

        self._parameter_rules.add((parameter,), check)

    def _parameter_text(self, parameter: str) -> str:
        return str(self.get_parameter(parameter).value)

    def _build_component(self, component: RegisteredComponent, node: NodeSettings) -> None:
        parameter = component.ros_parameter
        text = self._parameter_text(parameter) if parameter else ""
        raw = find_settings(component, text, node)
        if raw is None:
            self._without_settings(component)
            return
        config_key = raw.get("key")
        names = component.names | spellings(config_key)
        name = component.key or str(config_key or parameter).removesuffix("_setting")
        if component.kind is ComponentKind.TIMER:
            self.obk_timers.add(name, names, self._make_timer(name, component, raw))
        elif component.kind is ComponentKind.PUBLISHER:
            self.obk_publishers.add(name, names, self._make_publisher(component, raw))
        else:
            self.obk_subscriptions.add(name, names, self._make_subscription(component, raw))

    def _without_settings(self, component: RegisteredComponent) -> None:
        where = (
            f"the parameter `{component.ros_parameter}`"
            if component.ros_parameter
            else f"an entry with `key: {component.key}` in the parameter `obelisk_settings`"
        )
        if self._is_required(component):
            raise ObeliskConfigError(f"the {component} has no settings: set {where}")
        message = f"the {component} has no settings and is left out; to use it, set {where}"
        if component.required is None:
            self.get_logger().warning(message)
        else:
            # `obk validate` reports it; a warning at each launch would be noise.
            self.get_logger().debug(message)

    def _is_required(self, component: RegisteredComponent) -> bool:
        if component.required is not None:
            return component.required
        if self._has_message_types and component.key in STANDARD_COMPONENTS:
            # A G2 constructor looks like a G3 one. Only the G2 launcher passes all settings as
            # separate ROS parameters.
            return not self._parameter_text(SETTINGS) and any(
                map(self._parameter_text, self._setting_parameters)
            )
        return is_required_by_default(component.ros_parameter)

    def _make_publisher(
        self, component: RegisteredComponent, raw: Mapping[str, Any]
    ) -> LifecyclePublisher:
        settings = topic_settings(component, raw)
        publisher: LifecyclePublisher = self.create_lifecycle_publisher(
            message_class_of(component, settings.msg_type),
            settings.topic,
            settings.qos,
            callback_group=self._callback_group_of(component, settings.callback_group),
        )
        return publisher

    def _make_subscription(
        self, component: RegisteredComponent, raw: Mapping[str, Any]
    ) -> Subscription:
        settings = topic_settings(component, raw)
        assert component.callback is not None
        group = self._callback_group_of(component, settings.callback_group)
        message_class = message_class_of(component, settings.msg_type)
        try:
            return self.create_subscription(
                message_class,
                settings.topic,
                component.callback,
                settings.qos,
                callback_group=group,
            )
        except RuntimeError as error:  # for example, the callback takes no argument
            raise ObeliskConfigError(f"the {component}: {error}") from error

    def _make_timer(
        self, name: str, component: RegisteredComponent, raw: Mapping[str, Any]
    ) -> Timer:
        settings = timer_settings(component, raw)
        assert component.callback is not None
        return self.create_monitored_timer(
            component_identity(str(raw.get("ros_parameter") or component.ros_parameter or name)),
            settings.period_s,
            component.callback,
            group=self._callback_group_of(component, settings.callback_group),
            clock=self._timer_clock(),
        )

    def _timer_clock(self) -> Clock:
        # A jump of the wall clock must not stop or speed up a control loop, so timers use the
        # node's clock only for simulated time.
        if self.get_parameter(USE_SIM_TIME).value:
            return self.get_clock()
        return Clock(clock_type=ClockType.STEADY_TIME)

    def _callback_group_of(
        self, component: RegisteredComponent, name: str | None
    ) -> CallbackGroup | None:
        if name is None:
            return None
        if name not in self.obk_callback_groups:
            types = ", ".join(CALLBACK_GROUP_TYPES)
            have = ", ".join(self.obk_callback_groups) or f"none (types: {types})"
            fault = f"the {component} is in the callback group `{name}`; available: {have}"
            if self._is_required(component):
                raise ObeliskConfigError(fault)
            self.get_logger().warning(f"{fault}; it uses the node's default group")
            return None
        return self.obk_callback_groups[name]

    def _make_groups(self, kinds: Mapping[str, str]) -> None:
        self.obk_callback_groups = {name: CALLBACK_GROUPS[kind]() for name, kind in kinds.items()}
        for name, group in self.obk_callback_groups.items():
            # Existing code reads groups as attributes, and may have set them to None before.
            other = vars(self).get(name)
            if hasattr(type(self), name) or not isinstance(other, CallbackGroup | None):
                self.get_logger().warning(
                    f"the callback group `{name}` is only available in obk_callback_groups: the "
                    "node has another attribute with that name"
                )
            else:
                self._group_attributes[name] = [other] if name in vars(self) else []
                setattr(self, name, group)

    def _warn_of_unknown_components(self, node: NodeSettings) -> None:
        """Warn about settings of components that the code does not register."""
        for kind, entries in node.components.items():
            known = [c for c in self._registered_components if c.kind is kind]
            for entry in entries:
                names = entry_names(entry)
                if not any(component.names & names for component in known):
                    have = ", ".join(f"`{c.key or c.ros_parameter}`" for c in known) or "none"
                    self.get_logger().warning(
                        f"the config has a {kind.noun} "
                        f"`{entry.get('key') or entry.get('ros_parameter')}` that this node's code "
                        f"does not register; it registers: {have}"
                    )

    def _destroy_components(self) -> None:
        self._is_built = False
        self._configuration += 1
        self._registration_open = True
        self._registered_components = [
            c for c in self._registered_components if not c.is_of_configure
        ]
        self.opened.close()
        for timer in self.obk_timers.values():
            self.destroy_timer(timer)
        for subscription in self.obk_subscriptions.values():
            self.destroy_subscription(subscription)
        disconnect_all(self.obk_publishers.values())
        for publisher in self.obk_publishers.values():
            self.destroy_lifecycle_publisher(publisher)
        for table in (self.obk_timers, self.obk_subscriptions, self.obk_publishers):
            table.forget()
        for name, before in self._group_attributes.items():
            vars(self).pop(name, None)
            for value in before:
                setattr(self, name, value)
        self._group_attributes = {}
        self.obk_callback_groups = {}
        # A group keeps a dead reference for every entity that it has ever held.
        group = self.default_callback_group
        group.entities = {entity for entity in group.entities if entity() is not None}


def _is_same(one: RegisteredComponent, other: RegisteredComponent) -> bool:
    return one.kind is other.kind and bool(one.names & other.names)
