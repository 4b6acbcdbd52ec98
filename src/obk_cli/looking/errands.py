"""What a stack's launcher on this host does for a command: calls, single messages, short counts.

It has ROS loaded and knows everybody, so that this takes some ms. None: there is no launcher, or it
lacks the type, or it is too much for it; then a participant of our own has to do it.
"""

from collections.abc import Mapping, Sequence

from obk_cli.adapters.launcher_look import ask_launcher
from obk_cli.looking.delays import Delay
from obk_cli.looking.fill import require_fit
from obk_cli.looking.finding import find_service, find_topic, the_type
from obk_cli.looking.guard import moved_by
from obk_cli.looking.place import Place
from obk_cli.looking.plain_data import Plain
from obk_cli.looking.publishing import (
    Publication,
    Published,
    refuse_moving,
    topic_to_publish,
    wait_for_subscribers,
)
from obk_cli.looking.rates import LAUNCHER_COUNTS_S, Rate
from obk_cli.looking.selection import Selection, check_selection

__all__ = [
    "call_by_launcher",
    "delay_by_launcher",
    "message_by_launcher",
    "publish_by_launcher",
    "rates_by_launcher",
]


def call_by_launcher(
    place: Place, service: str, service_type: str | None, request: object, timeout_s: float
) -> Plain:
    """The response of a service.

    Args:
        place: where to look.
        service: full name, or the end of one.
        service_type: full, `pkg/srv/Name`; None: the one that it has.
        request: of YAML; checked before anything is asked.
        timeout_s: how long to wait for the service, and for its response [s].

    Raises:
        CommandFailedError: there is no such service, or no response in time.
        MisuseError: the request does not fit the type.
    """
    look = ask_launcher(place.runs)
    if look is None:
        return None
    name = find_service(look, place, service, timeout_s)
    types = (service_type,) if service_type else look.service_types()[name]
    kind = the_type("service", name, types)
    if not look.has_type(f"{kind}_Request"):
        return None
    require_fit(request, f"{kind}_Request", look.fields_of)
    return look.call(name, kind, request, timeout_s)


def message_by_launcher(
    place: Place, topic: str, selections: Sequence[Selection], timeout_s: float
) -> Plain:
    """The next message of a topic.

    Args:
        place: where to look.
        topic: full name, or the end of one.
        selections: fields that its type has to have.
        timeout_s: how long to wait for the topic, and for the message [s].

    Raises:
        CommandFailedError: there is no such topic or field, or no message in time.
    """
    look = ask_launcher(place.runs)
    if look is None:
        return None
    seen = find_topic(look, place, topic, timeout_s)
    kind = the_type("topic", seen.name, seen.heard_types)
    if not look.has_type(kind):
        return None
    for selection in selections:
        check_selection(selection, kind.replace("/msg/", "/"), look.fields_of)
    return look.next_message(seen.name, kind, timeout_s)


def publish_by_launcher(place: Place, publication: Publication) -> Published | None:
    """One message on a topic that moves no robot.

    On one that does, a launcher looks for publishers that are none of its stack's, and knows those
    that the user lets by their node; so they are left to a participant, which has such a name. Who
    hears the topic is waited for here: a command that is broken off leaves no publisher waiting.

    Raises:
        CommandFailedError: there is no such topic, it has another type, not enough hear it in time,
            or it moves a robot, which the publication may not.
        MisuseError: the message does not fit the type.
    """
    look = ask_launcher(place.runs)
    if look is None:
        return None
    seen, kind = topic_to_publish(look, place, publication)
    if not look.has_type(kind):
        return None
    require_fit(publication.message, kind, look.fields_of)
    if not publication.may_move:
        refuse_moving(seen, place)
    elif moved_by(seen, place.plans):
        return None

    def count() -> int:
        return sum(end.msg_type == kind for end in look.topic(seen.name).subscriptions)

    wait_for_subscribers(look, seen.name, kind, publication, count)
    confirmed = look.publish(seen.name, kind, publication.message, publication.subscribers)
    if confirmed is None:
        return None
    return Published(topic=seen.name, count=1, is_confirmed=confirmed)


def rates_by_launcher(
    place: Place, topics: Sequence[str], duration_s: float, timeout_s: float
) -> Mapping[str, Rate] | None:
    """How often the messages of topics come, by full name.

    Args:
        place: where to look.
        topics: full names, or the ends of some.
        duration_s: for how long they are counted [s].
        timeout_s: how long to wait for each topic [s].

    Raises:
        CommandFailedError: there is no such topic.
    """
    look = ask_launcher(place.runs) if duration_s <= LAUNCHER_COUNTS_S else None
    if look is None:
        return None
    seen = [find_topic(look, place, topic, timeout_s) for topic in topics]
    kinds = {one.name: the_type("topic", one.name, one.heard_types) for one in seen}
    return look.rates(kinds, duration_s)


def delay_by_launcher(
    place: Place, topic: str, window: int, duration_s: float, timeout_s: float
) -> tuple[str, Delay | None, int] | None:
    """The full name of a topic, how late its messages come, and how many had no stamp.

    Args:
        place: where to look.
        topic: full name, or the end of one.
        window: messages that the figures go back.
        duration_s: for how long they are heard [s].
        timeout_s: how long to wait for the topic [s].

    Raises:
        CommandFailedError: there is no such topic, or its messages have no stamp.
    """
    look = ask_launcher(place.runs) if duration_s <= LAUNCHER_COUNTS_S else None
    if look is None:
        return None
    seen = find_topic(look, place, topic, timeout_s)
    kind = the_type("topic", seen.name, seen.heard_types)
    if not look.has_type(kind):
        return None
    return (seen.name, *look.delay(seen.name, kind, window, duration_s))
