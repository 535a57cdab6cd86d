"""What all tests share."""

from __future__ import annotations

import os
from functools import cache
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

    return ("tests/collisions/", "self_play", *(env_id.partition("-v")[0] for env_id in COLLIDING))


class ByWhatIsCompiled(LoadScopeScheduling):
    """Runs the tests of a file in one process, and so all of bodies that collide.

    Their steps take the longest to compile, and have parts in common that a process compiles once.
    """

    def _split_scope(self, nodeid: str) -> str:
        if any(word in nodeid for word in colliding()):
            return "colliding"
        return nodeid.partition("::")[0]


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> ByWhatIsCompiled:
    return ByWhatIsCompiled(config, log)
