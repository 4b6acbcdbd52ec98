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
        fix="No change is needed if this is intended. Otherwise add a node to the section, or "
        "include the file that defines it.",
    ),
    Rule(
        code="OBK202",
        severity="error",
        title="two nodes with the same name",
        cause="ROS runs both, and a request by name may reach either one. Joystick nodes all "
        "have the same name.",
        fix="Give one of them a different `name` or `namespace`. Set `on: false` for all joysticks "
        "but one.",
    ),
    Rule(
        code="OBK203",
        severity="error",
        title="a subscriber without a publisher",
        cause="Nothing in the config publishes the topic, so the subscriber would wait forever. "
        "The finding is an error if the config publishes a topic with the same Obelisk message "
        "type, or one with a similar name and the same or an unknown type. Other topics are "
        "probably published outside the stack, and are reported as a warning.",
        fix="Correct the topic, or add it to `external_topics` if a node outside the stack "
        "publishes it.",
    ),
    Rule(
        code="OBK204",
        severity="info",
        title="a topic without subscribers",
        cause="Nothing in the config subscribes to the topic.",
        fix="No change is needed if a tool or another stack subscribes to it. Otherwise remove the "
        "publisher.",
    ),
    Rule(
        code="OBK205",
        severity="error",
        title="different message types on one topic",
        cause="ROS connects a publisher and a subscriber only if their message types are the "
        "same. A process cannot use two types on one topic. The finding is only a warning if one "
        "of the nodes is in C++: its code determines the type, and `msg_type` has no effect.",
        fix="Use the same type at both ends, or use two topics.",
    ),
    Rule(
        code="OBK206",
        severity="error",
        title="incompatible QoS",
        cause="A subscriber that requests more than the publisher offers receives nothing.",
        fix="Make the publisher `reliable` or `transient_local`, or relax the QoS of the "
        "subscriber.",
    ),
    Rule(
        code="OBK207",
        severity="error",
        title="an undefined callback group",
        cause="The node's `callback_groups` do not contain this name.",
        fix="Define the group in the node, or correct the name.",
    ),
    Rule(
        code="OBK208",
        severity="warning",
        title="an unused callback group",
        cause="No component of the node is in the group, and its code does not mention the group.",
        fix="Remove the group, or assign components to it.",
    ),
    Rule(
        code="OBK209",
        severity="warning",
        title="the loop is open",
        cause="The robot feeds the estimator, the estimator the controller, and the controller "
        "the robot. One of these links is missing.",
        fix="Subscribe to a topic of the preceding block.",
    ),
    Rule(
        code="OBK210",
        severity="warning",
        title="two controllers or two estimators publish to one topic",
        cause="The robot executes whichever command arrives last, and a controller receives the "
        "estimates of both estimators in turn.",
        fix="Remove one of the two, or give each its own topic. If two controllers move the same "
        "part of the robot, let one of them forward the commands of the other.",
    ),
    Rule(
        code="OBK211",
        severity="info",
        title="a timer faster than its input",
        cause="The callback processes the same input several times.",
        fix="No change is needed if this is intended. Otherwise run the timer at the rate of its "
        "input.",
    ),
    Rule(
        code="OBK212",
        severity="error",
        title="a command watchdog without effect",
        cause="`max_age_sec` and `stale_action` apply only to a robot's `sub_ctrl` subscriber. "
        "`stale_action` also needs `max_age_sec`, and `damp` needs a class that "
        "implements `apply_damping`. Here they have no effect: the robot would not stop.",
        fix="Move both to the robot's `sub_ctrl`, or remove them.",
    ),
    Rule(
        code="OBK213",
        severity="warning",
        title="a command timeout shorter than two control periods",
        cause="`max_age_sec` leaves no margin for a slightly late command, so the robot stops "
        "although its controller is running.",
        fix="Set `max_age_sec` to at least two periods of the controller's timer; five to ten "
        "are usual.",
    ),
    Rule(
        code="OBK214",
        severity="warning",
        title="one node has two publishers on a topic",
        cause="A subscriber cannot distinguish the messages of the two publishers. Usually an "
        "entry was copied and still has the topic of the original.",
        fix="Give each publisher its own topic.",
    ),
    Rule(
        code="OBK215",
        severity="warning",
        title="a sensor faster than the simulation",
        cause="Sensors are sampled after a step, so their period cannot be shorter than a step.",
        fix="Make `dt` a multiple of the model's step, or lower `time_step`.",
    ),
    Rule(
        code="OBK216",
        severity="warning",
        title="a period that looks like a rate",
        cause="Periods are in seconds. Periods of 10 s or more are unusual for a loop or a sensor; "
        "`500` often stands for 500 Hz or 500 ms. For a custom timer, which may be slow on "
        "purpose, the finding is info-level.",
        fix="Write the period, such as `0.002` for 500 Hz. Silence the rule if the long period is "
        "intended.",
    ),
    Rule(
        code="OBK218",
        severity="warning",
        title="two nodes publish to one sensor topic",
        cause="A subscriber receives the messages of both in turn, as if one sensor jumped "
        "between two values.",
        fix="Give each sensor its own topic, or remove one of the publishers.",
    ),
    Rule(
        code="OBK220",
        severity="warning",
        title="a period about 1000 times longer than the others",
        cause="`2` is often written instead of `0.002`. The rule reports a timer or sensor in "
        "the control loop that is slower than 1 Hz if the fastest one in the loop is about 1000 "
        "times faster. It also reports the longest period in the config if all others are "
        "about 1000 times shorter. For a custom timer, which may be slow on purpose, the finding "
        "is info-level.",
        fix="Correct the period. If the period is intended, silence the rule.",
    ),
)
