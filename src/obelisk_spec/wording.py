"""Names and numbers as a message's sentence holds them."""

__all__ = ["with_article", "with_number"]


def with_article(name: str) -> str:
    """The name in quotes behind its article: "a `hinge`", "an `ObkImu`".

    Names that begin with a u (`user`, `uint8`, `UInt16`) are said with a y.
    """
    return f"{'an' if name[:1].lower() in ('a', 'e', 'i', 'o') else 'a'} `{name}`"


def with_number(count: int, noun: str) -> str:
    """The number with its noun, in the plural where it is not one: "1 node", "2 nodes"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
