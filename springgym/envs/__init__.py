"""The environments: `springgym.envs.tasks` has a file for each, `springgym.envs.registration` their table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Unpack

from springgym.envs.registration import PARALLEL
from springgym.lazy import submodule

if TYPE_CHECKING:
    from springgym.envs.players import ParallelDuel, ParallelOptions

__all__ = ["parallel"]


if not TYPE_CHECKING:  # for type checkers, every name would exist

    def __getattr__(name: str) -> Any:
        return submodule(__name__, name)


def parallel(env_id: str, **options: Unpack[ParallelOptions]) -> ParallelDuel:
    """Make an environment of several agents, a `ParallelEnv` of PettingZoo (extra ``pettingzoo``).

    Parameters
    ----------
    env_id
        One of `springgym.envs.registration.PARALLEL`.
    options
        See `springgym.envs.players.ParallelDuel`.

    Raises
    ------
    ImportError
        Without PettingZoo.
    ValueError
        If the environment does not have several agents.
    """
    if env_id not in PARALLEL:
        raise ValueError(
            f"env_id is {env_id!r}; it must be an environment of several agents: {', '.join(PARALLEL)}"
        )
    from springgym.envs.players import ParallelDuel

    return ParallelDuel(**options)
