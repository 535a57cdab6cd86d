"""A lock for objects that only one thread at a time may use. A second thread gets an error and does not
wait."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from threading import RLock
from typing import Any, TypeVar, cast

Method = TypeVar("Method", bound=Callable[..., Any])


class Guard:
    """A lock that a thread holds while it is in a `guarded` method. A copy of the object gets a free lock."""

    def __init__(self) -> None:
        lock = RLock()
        self.take: Callable[..., bool] = lock.acquire
        self.release: Callable[[], None] = lock.release

    def __reduce__(self) -> tuple[type[Guard], tuple[()]]:
        return Guard, ()


def guarded(method: Method) -> Method:
    """Decorate a method of an object with a `Guard`, so that one thread at a time may call it.

    Raises
    ------
    RuntimeError
        If another thread is in a guarded method of the same object; nothing is changed.
    """

    @wraps(method)
    def alone(self: Any, /, *arguments: object, **options: object) -> object:
        guard = self._guard
        if not guard.take(False):
            raise RuntimeError(
                f"two threads use one {type(self).__name__} at once: {method.__name__} was called while "
                "another thread is in a call; give each thread its own, or use a lock"
            )
        try:
            return method(self, *arguments, **options)
        finally:
            guard.release()

    return cast(Method, alone)
