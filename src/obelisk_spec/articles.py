"""Names as a message's sentence holds them."""

__all__ = ["with_article"]


def with_article(name: str) -> str:
    """The name in quotes behind its article: "a `hinge`", "an `ObkImu`".

    Names that begin with a u (`user`, `uint8`, `UInt16`) are said with a y.
    """
    return f"{'an' if name[:1].lower() in ('a', 'e', 'i', 'o') else 'a'} `{name}`"
