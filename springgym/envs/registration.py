"""The table of environments."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from difflib import get_close_matches
from importlib import import_module
from typing import Any, Literal, NamedTuple

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from springgym.checks import instance

__all__ = [
    "PARALLEL",
    "REASONS",
    "Row",
    "Tier",
    "UnknownEnvironment",
    "Variant",
    "find",
    "nearest_id",
    "register",
    "spec_of",
]

Tier = Literal["easy", "medium", "hard", "very hard", "sparse"]
"""The difficulty of a task. Linear control solves "easy". PPO solves "medium" with the
hyperparameters of the package, and most of "hard". PPO does not solve "very hard", though it can be solved.
Tasks that are "sparse" are those of the same environments, rewarded only while their aim is met."""


class Row(NamedTuple):
    """An environment: its id, its module and class in `springgym.envs.tasks`, and its episodes."""

    id: str
    module: str
    name: str
    max_episode_steps: int
    reward_threshold: float
    """smallest return of an episode at which the task counts as solved

    Classical control earns more. Zero and random actions earn less than a quarter."""
    tier: Tier
    scored_per: Literal["step", "episode"] = "step"
    """unit for which returns are reported: an episode if most is earned in one step, as in a duel"""


class Variant(NamedTuple):
    """A variant of an environment: other arguments under another id."""

    id: str
    of: str
    """id of the environment"""
    arguments: Mapping[str, Any]
    tier: Tier
    why: str
    """the reason for its tier"""


ENVIRONMENTS = (
    Row("SpringTop-v0", "top", "SpringTop", 500, 400.0, "easy"),
    Row("SpringGyroscope-v0", "gyroscope", "SpringGyroscope", 400, 300.0, "medium"),
    Row("SpringPendulum-v0", "pendulum", "SpringPendulum", 250, 150.0, "medium"),
    Row("SpringDetumble-v0", "detumble", "SpringDetumble", 400, 260.0, "easy"),
    Row("SpringRope-v0", "rope", "SpringRope", 200, 105.0, "easy"),
    Row("SpringTumble-v0", "tumble", "SpringTumble", 250, 185.0, "medium"),
    Row("SpringFreeTop-v0", "free_top", "SpringFreeTop", 500, 450.0, "medium"),
    Row("SpringBalance-v0", "balance", "SpringBalance", 500, 425.0, "medium"),
    Row("SpringShove-v0", "shove", "SpringShove", 250, 150.0, "medium"),
    Row("SpringStack-v0", "stack", "SpringStack", 300, 0.8, "medium", "episode"),
    Row("SpringJuggle-v0", "juggle", "SpringJuggle", 500, 400.0, "medium"),
    Row("SpringLabyrinth-v0", "labyrinth", "SpringLabyrinth", 600, 240.0, "medium"),
    Row("SpringTower-v0", "tower", "SpringTower", 500, 250.0, "very hard"),
    Row("SpringBilliards-v0", "billiards", "SpringBilliards", 1, 0.7, "medium", "episode"),
    Row("SpringDuel-v0", "duel", "SpringDuel", 500, 0.7, "medium", "episode"),
)

REASONS = {
    "SpringGyroscopeHard": "spin of either sign, which reverses the effect of a push",
    "SpringTopSparse": "reward only while the top is upright, calm and at its target spin, all at once",
    "SpringGyroscopeSparse": "reward only while the axle points to its target and rests",
    "SpringPendulumSparse": "reward only while the cube stands upside down and rests",
    "SpringDetumbleSparse": "reward only while the box is at rest",
    "SpringRopeSparse": "reward only while the load rests at its target",
    "SpringDetumbleParticles": (
        "angular momentum is hidden; the agent must infer it from products of positions and velocities"
    ),
    "SpringPendulumWeak": "a quarter of the torque that would lift the cube, so swing-up takes many periods",
    "SpringTopHard": "slower initial spin, too slow for some tops to stay up on their own; weaker torques",
    "SpringTopImpulseHard": "slower initial spin; pushes on the crown cannot speed the top up",
    "SpringDetumbleFlat": "rotation about the axis of the largest moment, which takes longest to stop",
    "SpringTumbleHard": "longer distance, weaker forces and torques",
    "SpringTumbleSparse": "reward only while the body rests at its target, on the given face",
    "SpringFreeTopRough": "the tip sticks: an agent moves it by leaning the top, not by pushing",
    "SpringJuggleTwo": "two balls in turn, each on its own vertical",
    "SpringFreeTopSparse": "reward only inside the circle, upright and at the given spin",
    "SpringShoveHard": "longer distance and any heading, so the box must be turned on the way",
    "SpringShoveSparse": "reward only while the box rests at its target position and heading",
    "SpringLabyrinthHard": "the board tilts more slowly, and the holes are larger",
    "SpringDuelStrong": (
        "the opponent is as strong as classical control: it attacks at full force and keeps itself upright"
    ),
}
"""The reasons for the tiers of variants."""

_CHANGED: tuple[tuple[str, str, dict[str, Any], Tier], ...] = (
    ("SpringGyroscope", "Hard", {"hard": True}, "very hard"),
    ("SpringTop", "Sparse", {"sparse": True}, "sparse"),
    ("SpringGyroscope", "Sparse", {"sparse": True}, "sparse"),
    ("SpringPendulum", "Sparse", {"sparse": True}, "sparse"),
    ("SpringDetumble", "Sparse", {"sparse": True}, "sparse"),
    ("SpringRope", "Sparse", {"sparse": True}, "sparse"),
    ("SpringDetumble", "Particles", {"momentum": False}, "hard"),
    ("SpringPendulum", "Weak", {"randomize": {"actuator": (0.5, 0.5)}}, "hard"),
    ("SpringTop", "Hard", {"hard": True}, "hard"),
    ("SpringTop", "ImpulseHard", {"action": "impulse", "hard": True}, "hard"),
    ("SpringDetumble", "Flat", {"start": "flat"}, "medium"),
    ("SpringTumble", "Hard", {"hard": True}, "medium"),
    ("SpringTumble", "Sparse", {"sparse": True}, "sparse"),
    ("SpringFreeTop", "Rough", {"friction": 0.1}, "very hard"),
    ("SpringJuggle", "Two", {"balls": 2}, "medium"),
    ("SpringFreeTop", "Sparse", {"sparse": True}, "sparse"),
    ("SpringShove", "Hard", {"hard": True}, "very hard"),
    ("SpringShove", "Sparse", {"sparse": True}, "sparse"),
    ("SpringLabyrinth", "Hard", {"hard": True}, "hard"),
    ("SpringDuel", "Strong", {"opponent": "strong"}, "very hard"),
)

VARIANTS = tuple(
    Variant(f"{name}{suffix}-v0", f"{name}-v0", arguments, tier, REASONS[name + suffix])
    for name, suffix, arguments, tier in _CHANGED
)

ALL_IDS = (*(row.id for row in ENVIRONMENTS), *(variant.id for variant in VARIANTS))


def find(env_id: str) -> tuple[Row, dict[str, Any]] | None:
    """Return the environment of an id, and the arguments of its variant; None for ids of other packages."""
    instance("env_id", env_id, str)
    variant = next((variant for variant in VARIANTS if variant.id == env_id), None)
    of = env_id if variant is None else variant.of
    row = next((row for row in ENVIRONMENTS if row.id == of), None)
    return None if row is None else (row, {} if variant is None else dict(variant.arguments))


class UnknownEnvironment(gym.error.NameNotFound, ValueError):
    """Raised for an unknown id."""


def nearest_id(env_id: str) -> str | None:
    """Return the registered id most similar to an id, versions apart; None if none is similar."""
    instance("env_id", env_id, str)
    ids = {known.partition("-v")[0].lower(): known for known in gym.registry}
    return next((ids[one] for one in get_close_matches(env_id.partition("-v")[0].lower(), ids, 1, 0.7)), None)


def spec_of(env_id: str) -> EnvSpec:
    """Return the spec registered under an id, after importing the module of an id ``module:ID``.

    Raises
    ------
    TypeError
        If the id is not a string.
    UnknownEnvironment
        If there is no such environment.
    """
    module, _, name = instance("env_id", env_id, str).rpartition(":")
    why = f"If a module of yours registers it, write {module or 'MODULE'}:{name}"
    try:
        if module:
            import_module(module)
            why = f"The module {module} does not register it"
    except TypeError:  # a relative name
        why = f"{module!r} is not the name of a module"
    except (ImportError, ValueError) as error:
        why = str(error)
    if name in gym.registry:
        return gym.registry[name]
    if near := nearest_id(name):
        why = f"Did you mean {env_id.removesuffix(name) + near!r}?"
    raise UnknownEnvironment(f"Unknown environment {env_id!r}. {why}")


PARALLEL = ("SpringDuel-v0",)
"""Environments of several agents."""


def register() -> None:
    """Register all environments with Gymnasium; those already registered do not change.

    If PettingZoo has been imported and has a registry, environments of several agents are registered there.
    """
    zoo: Any = sys.modules.get("pettingzoo")
    for env_id in PARALLEL if hasattr(zoo, "parallel_registry") else ():
        if env_id not in zoo.parallel_registry:
            zoo.register("parallel", env_id, entry_point="springgym.envs.players:registered")
    for env_id in ALL_IDS:
        if env_id not in gym.registry and (found := find(env_id)):
            row, arguments = found
            gym.register(
                env_id,
                entry_point=f"springgym.envs.tasks.{row.module}:{row.name}Env",
                vector_entry_point=f"springgym.envs.tasks.{row.module}:{row.name}VectorEnv",
                max_episode_steps=row.max_episode_steps,
                reward_threshold=None if arguments else row.reward_threshold,
                kwargs=arguments,
            )
