"""How many messages are missing, by the publisher's numbers."""

from obk_cli.recording.tally import Tally


def tally(*sequence: int, publishers: int = 1) -> tuple[int, int]:
    counted = Tally()
    for number in sequence:
        counted.take(number, publishers)
    return counted.count, counted.dropped


def test_gaps_in_the_numbers_are_lost_messages() -> None:
    assert tally(1, 2, 3) == (3, 0)
    assert tally(1, 2, 5, 6, 9) == (5, 4)


def test_what_was_published_before_the_recording_is_not_lost() -> None:
    assert tally(100, 101) == (2, 0)


def test_a_publisher_that_begins_anew_has_lost_nothing() -> None:
    assert tally(1, 2, 3, 1, 2) == (5, 0)
    assert tally(1, 1) == (2, 0)


def test_numbers_of_several_publishers_tell_nothing() -> None:
    assert tally(1, 50, 2, 51, publishers=2) == (4, 0)
