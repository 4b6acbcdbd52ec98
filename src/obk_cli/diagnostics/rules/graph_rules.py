"""OBK2xx: nodes and the topics between them. Data only."""

from obk_cli.diagnostics.rules.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK201",
        severity="info",
        title="a section has no node",
        cause="Most stacks have a controller, an estimator and a robot. A stack without any node "
        "is an error.",
        fix="Nothing, if the stack does without it. Otherwise add a node to the section, or "
        "include the file that has it.",
    ),
    Rule(
        code="OBK202",
        severity="error",
        title="two nodes with one name",
        cause="ROS lets both run, and every request by name reaches either of them. The name of a "
        "joystick's node is always the same.",
        fix="Give one of them another `name` or `namespace`; switch all joysticks off but one.",
    ),
    Rule(
        code="OBK203",
        severity="error",
        title="a subscriber without a publisher",
        cause="Nothing in the config publishes the topic, so the subscriber would wait for ever. "
        "It is an error if the config publishes a topic of a similar name, or one of the same "
        "Obelisk message. The other topics are probably published outside the stack: one warning "
        "lists them.",
        fix="Correct the topic, or add it to `external_topics` if a node outside the stack "
        "publishes it.",
    ),
    Rule(
        code="OBK204",
        severity="info",
        title="published and never read",
        cause="Nothing in the config subscribes to the topic.",
        fix="None is needed if a tool or another stack reads it; otherwise remove the publisher.",
    ),
    Rule(
        code="OBK205",
        severity="error",
        title="publisher and subscriber of different types",
        cause="ROS connects the ends of a topic only where their message types are the same, and a "
        "process cannot have two types on one topic. It is a warning if one of the nodes is in "
        "C++, where the code decides and `msg_type` is only a note.",
        fix="Make the types the same, or use two topics.",
    ),
    Rule(
        code="OBK206",
        severity="error",
        title="QoS that cannot match",
        cause="A subscriber that asks for more than the publisher offers receives nothing.",
        fix="Make the publisher `reliable` or `transient_local`, or the subscriber ask for less.",
    ),
    Rule(
        code="OBK207",
        severity="error",
        title="an undefined callback group",
        cause="The name is not among the node's `callback_groups`.",
        fix="Define the group in the node, or correct the name.",
    ),
    Rule(
        code="OBK208",
        severity="warning",
        title="an unused callback group",
        cause="No component of the node is in the group.",
        fix="Remove it, or put components into it.",
    ),
    Rule(
        code="OBK209",
        severity="warning",
        title="the loop is open",
        cause="The robot feeds the estimator, the estimator the controller, the controller the "
        "robot; one of these does not subscribe to the one before it.",
        fix="Subscribe to a topic of the block before.",
    ),
    Rule(
        code="OBK210",
        severity="warning",
        title="two controllers command one topic",
        cause="The robot executes whichever command arrives last.",
        fix="Give each controller a topic of its own, or let one of them pass the other's on.",
    ),
    Rule(
        code="OBK211",
        severity="info",
        title="a timer faster than its input",
        cause="The callback runs on the same input several times.",
        fix="Nothing, if that is wanted; else make the timer as slow as what it works on.",
    ),
    Rule(
        code="OBK212",
        severity="error",
        title="commands are not watched although the config asks for it",
        cause="`max_age_sec` and `stale_action` are read for a robot's subscriber `sub_ctrl` only, "
        "and the second with the first only; `damp` needs a class that implements "
        "`apply_damping`. Set here they have no effect: the robot would not stop.",
        fix="Move them to the robot's `sub_ctrl`, both together, or remove them.",
    ),
    Rule(
        code="OBK213",
        severity="warning",
        title="a command is too old before the next one is due",
        cause="`max_age_sec` leaves no time for a command that is a little late, so the robot "
        "stops while its controller runs.",
        fix="Make `max_age_sec` at least two periods of the controller's timer; five to ten are "
        "usual.",
    ),
    Rule(
        code="OBK214",
        severity="warning",
        title="one node publishes a topic twice",
        cause="A subscriber cannot distinguish the messages of the two. Most often an entry was "
        "copied, and its topic is still that of the first.",
        fix="Give each its own topic.",
    ),
    Rule(
        code="OBK215",
        severity="warning",
        title="a sensor faster than the simulation",
        cause="A sensor is sampled after a step, so its period cannot be shorter than one.",
        fix="Make `dt` a multiple of the model's step, or lower `time_step`.",
    ),
    Rule(
        code="OBK216",
        severity="info",
        title="a period that may be meant as a rate",
        cause="Periods are in seconds. Ten and more are unusual for a loop or a sensor; `500` is "
        "often written where 500 Hz are meant.",
        fix="Write the period, `0.002` for 500 Hz; silence the rule if it is to be so long.",
    ),
    Rule(
        code="OBK218",
        severity="warning",
        title="two nodes publish one sensor topic",
        cause="A subscriber gets the messages of both in turn, as if one sensor jumped between two "
        "values.",
        fix="Give each sensor its own topic, or remove one of the publishers.",
    ),
    Rule(
        code="OBK220",
        severity="warning",
        title="a period 1000 times longer than the others",
        cause="`2` is often written where `0.002` is meant. A timer of the loop or a sensor is "
        "compared with the fastest of the loop, unless it runs at 1 Hz or faster; the longest "
        "period also with all others. It is an info for a timer of your own, which may be slow on "
        "purpose.",
        fix="Write the decimals; silence the rule if the period is right.",
    ),
)
