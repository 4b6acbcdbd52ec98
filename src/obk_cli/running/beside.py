"""A thread beside a run, for as long as something is entered."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["beside"]


@contextmanager
def beside(look: Callable[[threading.Event], None], name: str) -> Iterator[None]:
    """While entered, look on in a thread; `look` returns soon after its event is set."""
    is_over = threading.Event()
    thread = threading.Thread(target=look, args=(is_over,), name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
