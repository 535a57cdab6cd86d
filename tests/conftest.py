"""What all tests share."""

from __future__ import annotations

import gc
import os
import re
from collections.abc import Generator, Iterator
from contextlib import contextmanager, nullcontext
from functools import cache, partialmethod
from typing import Any

import pytest
from hypothesis import settings
from xdist.scheduler import LoadScopeScheduling

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("MPLBACKEND", "Agg")
# Test processes share the cores: threads of linear algebra that wait for one take many times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The default run draws the same examples every time, so a pass means the same on every machine;
# `--hypothesis-profile=explore` draws new ones, ten times as many where a test does not say.
settings.register_profile("springgym", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, deadline=None, max_examples=1000)
settings.load_profile("springgym")


@cache
def colliding() -> tuple[str, ...]:
    """Return the parts of names by which tests of bodies that collide are known."""
    from tests.envs.cases import COLLIDING

    tasks = (env_id.partition("-v")[0] for env_id in COLLIDING)
    return ("tests/collisions/", "test_round", "test_resistance", "test_juggle", "colliding", *tasks)


DUELS = ("SpringDuel", "self_play", "test_duel")
"""Parts of names by which tests of a duel are known, whose bowl takes a kernel of its own."""


@pytest.fixture
def own_ids() -> Iterator[None]:
    """Take ids of environments and checks of scenes that a test registers out again, when it is over."""
    import gymnasium

    from springgym.scenes.checks.basis import CHECKS, NEEDS

    registries: tuple[dict[str, Any], ...] = (gymnasium.registry, CHECKS, NEEDS)
    before = [dict(registry) for registry in registries]
    yield
    for registry, kept in zip(registries, before, strict=True):
        registry.clear()
        registry.update(kept)


@contextmanager
def _few_kernels() -> Iterator[None]:
    from springgym.core.language import blocks
    from tests.collisions.stepped import all_kinds_of_terms

    layout = blocks.block_layout

    def wide(copies: int, shape: tuple[int, ...], dtype: Any) -> tuple[tuple[int, ...], Any]:
        return layout(max(copies, 2), shape, dtype)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blocks, "block_layout", wide)
        with all_kinds_of_terms():
            yield


@pytest.fixture
def few_kernels() -> Iterator[None]:
    """Compute one copy in a block as wide as a batch's, and scenes with all kinds of terms.

    So one kernel serves where several would be compiled. That both widths give the same bits, and that a
    term which does nothing changes none, is tested elsewhere.
    """
    with _few_kernels():
        yield


@pytest.fixture
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let renderers draw 64 × 64 pixels, for tests that need a picture of any size."""
    from springgym.rendering.renderer import Renderer

    monkeypatch.setattr(Renderer, "__init__", partialmethod(Renderer.__init__, size=(64, 64)))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Take few kernels, in fixtures of any scope too, but for tests marked ``own_kernels``."""
    with nullcontext() if item.get_closest_marker("own_kernels") else _few_kernels():
        return (yield)


LONGEST = ("rigid", "colliding", "duels", "tests/envs/test_contract.py")
"""What runs first, so that no process is left with it at the end."""


METHODS = ("conservation", "equations", "order", "stability")
TOGETHER = (
    ("tests/forces/test_contact.py", "tests/forces/test_node.py"),
    tuple(f"tests/integrators/test_{name}.py" for name in METHODS),
)
"""Files whose tests share kernels that take long to compile, and that two processes would compile at once."""


def scope(nodeid: str) -> str:
    """Tell which tests run in one process: those of a file, of files that share kernels, all of duels, and
    all others of bodies that collide, of springs or rigid.

    These take the longest to compile, and share a kernel that a process compiles once.
    """
    if any(word in nodeid for word in DUELS):
        return "duels"
    if any(word in nodeid for word in colliding()):
        return "rigid" if re.search(r"[\[-]rigid|test_rigid", nodeid) else "colliding"
    file = nodeid.partition("::")[0]
    return next((first for first, *others in TOGETHER if file in others), file)


def pytest_collection_finish() -> None:
    """Search for garbage seldom, and not among what is imported by now: that took a tenth of the time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)


@pytest.hookimpl(tryfirst=True)  # before those that are not asked for are left out
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: [scope(item.nodeid) != first for first in LONGEST])


class ByWhatIsCompiled(LoadScopeScheduling):
    """Runs the tests of a `scope` in one process, and scopes in the order in which they were collected."""

    def _split_scope(self, nodeid: str) -> str:
        return scope(nodeid)


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> ByWhatIsCompiled:
    config.option.loadscopereorder = False  # by the number of tests, which says nothing of how long they take
    return ByWhatIsCompiled(config, log)
