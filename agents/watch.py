"""Watch an agent in a window or the browser, or write a GIF, an MP4 or a page.

    springgym watch runs/SpringTop-v0-ppo-0
    springgym watch classical --env SpringTop-v0 --browser
    springgym watch SpringTop-v0
    springgym watch classical --env SpringTop-v0 --out top.gif --set action=impulse

An agent is a run folder, an environment id (for the published agent of that environment), the name of a
baseline (noop, random, classical), or ``module:function``, a function from observations to actions.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
from config import MENDABLE, ConfigError, add_overrides, command_line, making, new_file, whole
from controllers import controller_env_kwargs, make_controller
from evaluate import LAST_SEED, find_task, named, trained_kwargs, trained_on
from runs import HELD_OUT_SEED, load_policy

import springgym  # noqa: F401  (registers the environments)
from springgym import view
from springgym.checks import printable
from springgym.cli import guarded, whole_file
from springgym.envs.agent import Policy, alone
from springgym.envs.trained import Agent
from springgym.view.episodes import episodes, played

#: Frames per second of a GIF at most; browsers show many more at the wrong speed.
GIF_FPS = 25
PAGE = ".html"
NAMES = {"noop": "no action", "random": "random actions", "classical": "classical control"}


def watched(agent: str, env_id: str, env_kwargs: Mapping[str, Any]) -> Agent:
    """Return a trained agent or a baseline, with the keyword arguments of the environment it acts in."""
    run = trained_on(agent, env_id)
    kwargs = trained_kwargs(run, env_kwargs) if run else controller_env_kwargs(agent, env_id, env_kwargs)

    def policy(env: gym.Env) -> Policy:
        if run:
            return load_policy(run, env.observation_space, env.action_space)
        return make_controller(agent, env_id, env_kwargs, env.action_space)

    return Agent(run.folder.name if run else NAMES.get(agent, agent), env_id, kwargs, policy)


def make_watched(
    agent: str, env_id: str, env_kwargs: Mapping[str, Any], render_mode: str
) -> tuple[gym.Env, Policy]:
    """Make one environment and the agent that acts in it."""
    chosen = watched(agent, env_id, env_kwargs)
    with making(env_id):
        env = gym.make(env_id, render_mode=render_mode, **chosen.env_kwargs)
    try:
        return env, chosen.policy(env)
    except BaseException:
        env.close()
        raise


def play_episode(env: gym.Env, policy: Policy, seed: int) -> Iterator[Any]:
    """Play one episode: the pictures of its start and of every step; none where a window shows it."""
    observation, _ = env.reset(seed=seed)
    over = False
    while True:
        yield [] if env.render_mode == "human" else env.render()  # a window draws all, and waits for it
        if over:
            return
        observation, _, terminated, truncated, _ = env.step(policy(alone(observation))[0])
        over = terminated or truncated


def show(env: gym.Env, policy: Policy, seed: int) -> None:
    """Play episodes in a window, one after the other, until its close button is pressed."""
    import pygame

    try:
        for episode in itertools.count(seed):
            for _ in play_episode(env, policy, episode):
                if pygame.display.get_driver() == "offscreen":  # which SDL takes where it finds no display
                    raise ConfigError(
                        "no display available; write a film with --out top.mp4, or use --browser"
                    )
                if pygame.event.peek(pygame.QUIT):
                    return
    except pygame.error as error:  # such as no display
        raise ConfigError(
            f"no display available ({error}); write a film with --out top.mp4, or use --browser"
        ) from error


def record(
    agent: str, env_id: str, env_kwargs: Mapping[str, Any], path: Path, seed: int = HELD_OUT_SEED
) -> None:
    """Save one episode as a video; the ending of ``path`` (.gif, .mp4) chooses the format."""
    from springgym.rendering import save_video

    env, policy = make_watched(agent, env_id, env_kwargs, "rgb_array_list")
    try:
        frames: list[Any] = list(itertools.chain.from_iterable(play_episode(env, policy, seed)))
    finally:
        env.close()
    fps = env.metadata["render_fps"]
    every = -(-fps // GIF_FPS) if path.suffix.lower() == ".gif" else 1
    with whole_file(path) as temporary:
        save_video(frames[::every], temporary, fps / every)


def main(arguments: Sequence[str] | None = None, program: str = "watch.py") -> int:
    """Run the command line."""
    parser = command_line(__doc__, program)
    parser.add_argument(
        "agent", help="run folder, environment id, noop, random, classical or module:function"
    )
    parser.add_argument("--env", help="environment id (default: that of the agent)")
    parser.add_argument("--seed", type=whole(0, LAST_SEED), default=HELD_OUT_SEED)
    parser.add_argument(
        "--out",
        type=new_file(".gif", ".mp4", PAGE),
        help="write a video (.gif, .mp4) or a page (.html) instead of opening a window",
    )
    parser.add_argument("--browser", action="store_true", help="show the agent in the browser")
    add_overrides(parser)
    options = parser.parse_args(arguments)
    if options.out and options.browser:
        parser.error("pass either --out or --browser, not both")
    paged = options.browser or (options.out and options.out.suffix.lower() == PAGE)
    mendable = (*MENDABLE, ValueError, ImportError) if paged else MENDABLE  # what the view refuses
    return guarded(program, lambda: _watch(options), mendable, "view")


def _watch(options: argparse.Namespace) -> int:
    agent = named(options.agent)
    env_id, env_kwargs = find_task([agent], options.env, options.overrides)
    if options.browser:
        view.show(episodes(watched(agent, env_id, env_kwargs), options.seed))
        return 0
    if options.out:
        if options.out.suffix.lower() == PAGE:
            view.save_page(played(watched(agent, env_id, env_kwargs), options.seed), options.out)
        else:
            record(agent, env_id, env_kwargs, options.out, options.seed)
        print(f"wrote {printable(str(options.out))}")
        return 0
    env, policy = make_watched(agent, env_id, env_kwargs, "human")
    try:
        show(env, policy, options.seed)
    except KeyboardInterrupt:
        pass
    finally:
        env.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
