"""Gymnasium environments built on a fast mass-spring simulator with error estimates.

`gymnasium.make` makes the registered environments. These names can be imported from here:

- `Scene`, `Body` and `Placed` describe bodies and what acts on them, and `Simulator` moves them;
- `make_scene_env` makes an environment of a scene;
- `get_state` and `set_state` save and restore an environment;
- `load_agent` loads a published agent.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from springgym.envs.registration import register
from springgym.lazy import submodule
from springgym.version import __version__ as __version__

if TYPE_CHECKING:
    from springgym.envs.base import get_state, set_state
    from springgym.envs.scene import make_scene_env
    from springgym.envs.trained import load_agent
    from springgym.model.bodies import Body
    from springgym.model.scene import Placed, Scene
    from springgym.simulator import Simulator

_PUBLIC = {
    "Body": "springgym.model.bodies",
    "Placed": "springgym.model.scene",
    "Scene": "springgym.model.scene",
    "Simulator": "springgym.simulator",
    "get_state": "springgym.envs.base",
    "load_agent": "springgym.envs.trained",
    "make_scene_env": "springgym.envs.scene",
    "set_state": "springgym.envs.base",
}
"""Public names and their modules, which are imported on first use, so that `import springgym` is fast."""

__all__ = [
    "Body",
    "Placed",
    "Scene",
    "Simulator",
    "get_state",
    "load_agent",
    "make_scene_env",
    "register",
    "set_state",
]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if not TYPE_CHECKING:  # for type checkers, every name would exist

    def __getattr__(name: str) -> Any:
        if name in _PUBLIC:
            return getattr(import_module(_PUBLIC[name]), name)
        return submodule(__name__, name)


register()
