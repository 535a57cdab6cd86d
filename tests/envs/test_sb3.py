"""The Stable-Baselines3 adapter against SB3's own ``DummyVecEnv``, and its contract."""

import importlib.util
import pickle
import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecMonitor

import springgym
from springgym.envs import sb3
from springgym.envs.sb3 import SB3VecEnv, make_sb3

N = 3


class Scored(gym.Wrapper):
    """Reports what the environments of springgym report."""

    def step(self, action):
        observation, reward, terminated, truncated, info = self.env.step(action)
        angle = np.float64(observation[2])
        info |= {"is_success": bool(truncated), "angle": angle, "terms": {"upright": 1 - angle**2}}
        return observation, reward, terminated, truncated, info


def cartpole(render_mode=None):
    # Random actions topple the pole after about 20 steps: both ends occur.
    return Scored(gym.make("CartPole-v1", max_episode_steps=20, render_mode=render_mode))


def cartpoles(num_envs=N, autoreset_mode=AutoresetMode.SAME_STEP, render_mode=None, **_):
    """``copy=False``: the vector environment reuses its observation buffer."""
    makers = [lambda: cartpole(render_mode) for _ in range(num_envs)]
    return SyncVectorEnv(makers, copy=False, autoreset_mode=autoreset_mode)


gym.register("ScoredCartPole-v0", entry_point=cartpole, vector_entry_point=cartpoles)


def test_same_as_dummy_vec_env():
    ours = SB3VecEnv(cartpoles())
    theirs = DummyVecEnv([cartpole] * N)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.seed([5, 6, 7]) == theirs.seed(5)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    rng = np.random.default_rng(0)
    ends = []
    for _ in range(300):
        actions = rng.integers(0, 2, N)
        obs, rewards, dones, infos = ours.step(actions)
        obs2, rewards2, dones2, infos2 = theirs.step(actions)
        for a, b in ((obs, obs2), (rewards, rewards2), (dones, dones2)):
            np.testing.assert_array_equal(a, b, strict=True)
        for i in range(N):
            if not dones[i]:
                assert infos[i] == {}
                continue
            assert infos[i].keys() == infos2[i].keys()
            ends.append(infos[i]["TimeLimit.truncated"])
            for key in infos[i]:
                np.testing.assert_array_equal(infos[i][key], infos2[i][key])
            assert infos[i]["is_success"] is infos2[i]["is_success"]
    assert True in ends
    assert False in ends


def test_no_seed_shares_a_start_with_another():
    """Neighbouring ones neither: not as they are made, nor when an algorithm seeds them anew."""
    seeds = np.array([SB3VecEnv(cartpoles()).seed(seed) for seed in range(20)])
    assert len(np.unique(seeds)) == seeds.size
    starts = []
    for seed in (0, 1):
        env = make_sb3("ScoredCartPole-v0", 8, seed=seed)
        starts.append(env.reset())
        model = PPO("MlpPolicy", env, n_steps=8, batch_size=64, seed=seed, device="cpu")
        np.testing.assert_array_equal(model.get_env().reset(), starts[-1])
    assert len(np.unique(np.concatenate(starts), axis=0)) == 16


def test_drawn_seeds_follow_numpys_generator():
    env = SB3VecEnv(cartpoles())
    drawn = []
    for state in (4, 4, 5):
        np.random.seed(state)  # noqa: NPY002
        drawn.append(env.seed())
    assert drawn[0] == drawn[1] != drawn[2]
    with pytest.raises(ValueError, match="2 seeds were given for 3 environments"):
        env.seed([1, 2])


def test_nothing_returned_is_shared():
    env = VecMonitor(SB3VecEnv(cartpoles()))
    kept = [env.reset()]
    copies = [kept[0].copy()]
    last = {}
    while len(last) < N:
        obs, rewards, dones, infos = env.step(np.zeros(N, dtype=np.int64))
        kept += [obs, rewards, dones]
        copies += [obs.copy(), rewards.copy(), dones.copy()]
        assert len({id(info) for info in infos}) == N
        assert all(("episode" in info) == done for info, done in zip(infos, dones, strict=True))
        for i in np.flatnonzero(dones):
            last.setdefault(i, infos[i])
            kept.append(infos[i]["terminal_observation"])
            copies.append(kept[-1].copy())
    for array, copy in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(array, copy)
    assert not any(np.shares_memory(a, b) for i, a in enumerate(kept) for b in kept[:i])


def test_last_info_is_plain():
    env = SB3VecEnv(cartpoles(1))
    env.reset()
    done = [False]
    while not done[0]:
        _, _, done, (info,) = env.step(np.zeros(1, dtype=np.int64))
    angle = float(info["terminal_observation"][2])
    assert abs(angle) > 0.2  # it fell
    assert type(info["angle"]) is float
    assert info["angle"] == angle
    assert info["terms"] == {"upright": 1 - angle**2}
    assert not any(key.startswith(("_", "final_")) for key in info)


def test_other_environments_are_refused():
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED):
        with pytest.raises(ValueError, match=rf"needs autoreset_mode=AutoresetMode.SAME_STEP.*{mode}"):
            SB3VecEnv(cartpoles(autoreset_mode=mode))
    with pytest.raises(TypeError, match=r"wraps a gymnasium\.vector\.VectorEnv, got Scored"):
        SB3VecEnv(cartpole())


def test_options_reach_every_copy():
    env = SB3VecEnv(cartpoles())
    env.set_options({"low": 0.03, "high": 0.04})
    observations = env.reset()
    assert observations.min() >= 0.03
    assert observations.max() <= 0.04
    assert env.reset().min() < 0  # used once
    env.set_options([{"low": 0.03, "high": 0.04}, {}, {}])
    with pytest.raises(ValueError, match="same options"):
        env.reset()


def test_attributes_and_methods_are_those_of_the_batch():
    env = SB3VecEnv(cartpoles())
    env.set_attr("colour", "red")
    assert env.get_attr("colour", indices=[0, 2]) == ["red", "red"]
    assert env.vector_env.colour == "red"
    assert env.has_attr("colour")
    assert not env.has_attr("taste")
    with pytest.raises(ValueError, match=r"cannot set 'colour' for environments 1 only: all 3 share"):
        env.set_attr("colour", "blue", indices=1)
    assert env.env_method("get_attr", "spec", indices=1)[0][0].id == "CartPole-v1"
    assert env.env_is_wrapped(Scored) == [False] * N


def test_render_tiles_the_copies_and_close_closes():
    env = SB3VecEnv(cartpoles(render_mode="rgb_array"))
    env.reset()
    assert env.render().shape == (2 * 400, 2 * 600, 3)
    assert SB3VecEnv(cartpoles()).render_mode is None
    env.close()
    assert env.vector_env.closed


gym.register("LonelyCartPole-v0", entry_point=cartpole)


@pytest.mark.filterwarnings("ignore:CartPole-v1 was registered without a vector_entry_point")
def test_a_batch_that_cannot_reset_as_it_should_is_stepped_in_a_loop():
    """The batch of Gymnasium's CartPole takes no autoreset_mode; `make_sb3` used to fail with a TypeError."""
    assert make_sb3("CartPole-v1", num_envs=2).reset().shape == (2, 4)


def test_make_sb3_without_native_copies():
    """An environment that a user registered with no vector entry point is stepped in a loop."""
    with pytest.warns(UserWarning, match="LonelyCartPole-v0 was registered without a vector_entry_point"):
        env = make_sb3("LonelyCartPole-v0", num_envs=2)
    env.seed([3, 4])
    reference = DummyVecEnv([cartpole] * 2)
    reference.seed(3)
    np.testing.assert_array_equal(env.reset(), reference.reset())
    assert type(env.venv.vector_env) is SyncVectorEnv


def test_make_sb3_of_an_environment_that_is_not_registered():
    with pytest.raises(gym.error.NameNotFound, match="LoneliestCartPole"):
        make_sb3("LoneliestCartPole-v0", num_envs=2)
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        make_sb3("no_such_module:CartPole-v1", num_envs=2)


LIMIT = 20


def ends(env, steps):
    """Steps at which copies end, the infos with which they do, and all observations and rewards."""
    seen = [(env.reset(), None)]
    ended = []
    for step in range(1, steps + 1):
        observations, rewards, dones, infos = env.step(np.zeros((env.num_envs, *env.action_space.shape)))
        seen.append((observations, rewards))
        ended += [(step, i, infos[i]) for i in np.flatnonzero(dones)]
    return ended, seen


@pytest.mark.parametrize("copies", [1, 4])
def test_staggered_copies_do_not_end_together(copies):
    made = [
        make_sb3("SpringTop-v0", copies, seed=0, stagger=stagger, max_episode_steps=LIMIT)
        for stagger in (False, True)
    ]
    (together, seen), (spread, same) = (ends(env, 3 * LIMIT) for env in made)
    assert [step for step, *_ in together] == np.repeat([LIMIT, 2 * LIMIT, 3 * LIMIT], copies).tolist()
    first = [LIMIT - i * LIMIT // copies for i in range(copies)]
    for i in range(copies):
        own = [step for step, copy, _ in spread if copy == i]
        assert own[:3] == [first[i], first[i] + LIMIT, first[i] + 2 * LIMIT][: len(own)]
    # what a copy sees and earns is what it would, until it ends
    for step in range(min(first)):
        for a, b in zip(seen[step], same[step], strict=True):
            np.testing.assert_array_equal(a, b)
    # only whole episodes are reported
    for step, i, info in spread:
        assert info["TimeLimit.truncated"]
        assert ("episode" in info) == ("is_success" in info) == (i == 0 or step > LIMIT)
        assert "episode" not in info or info["episode"]["l"] == LIMIT


def test_copies_that_cannot_be_staggered_start_together():
    env = make_sb3("ScoredCartPole-v0", num_envs=2, seed=3, stagger=True)
    np.testing.assert_array_equal(env.reset(), make_sb3("ScoredCartPole-v0", num_envs=2, seed=3).reset())
    assert not env.shortened.any()


def followed(env, steps):
    """Return what steps give, without the time that episodes took."""
    found = []
    for _ in range(steps):
        observations, rewards, dones, infos = env.step(np.zeros((env.num_envs, *env.action_space.shape)))
        for info in infos:
            info.get("episode", {}).pop("t", None)
        found.append((observations.tolist(), rewards.tolist(), dones.tolist(), repr(infos)))
    return found


@pytest.mark.parametrize("stagger", [False, True])
def test_a_state_returns_with_what_the_monitor_counts(stagger):
    """To what has gone on, and to what has never begun, in a wrapper: episodes are reported as they were."""
    made = [make_sb3("SpringTop-v0", 4, seed=0, stagger=stagger, max_episode_steps=LIMIT) for _ in range(2)]
    made[0].reset()
    followed(made[0], 7)
    state = pickle.loads(pickle.dumps(springgym.get_state(made[0])))
    follows = followed(made[0], 2 * LIMIT)
    assert sum("'episode'" in infos for *_, infos in follows) > 1
    for env in (made[0], VecFrameStack(made[1], 1)):
        springgym.set_state(env, state)
        assert followed(env, 2 * LIMIT) == follows
    bare = SB3VecEnv(made[0].venv.vector_env)
    springgym.set_state(bare, springgym.get_state(bare))
    for wrong in ({}, state["env"], state | {"episode_lengths": np.zeros(3, np.int32)}, state | {"env": {}}):
        with pytest.raises((ValueError, TypeError), match="state"):
            springgym.set_state(made[0], wrong)
    with pytest.raises(TypeError, match="it must be an environment, or a native batch, of springgym"):
        springgym.get_state(make_sb3("ScoredCartPole-v0", 2))


def test_sb3_trains_and_evaluates_on_it(tmp_path):
    evaluation = EvalCallback(
        make_sb3("ScoredCartPole-v0", 2, seed=9), n_eval_episodes=4, eval_freq=64, verbose=0,
        log_path=str(tmp_path),
    )  # fmt: skip
    env = make_sb3("ScoredCartPole-v0", 2, seed=0)
    model = PPO("MlpPolicy", env, n_steps=64, batch_size=64, n_epochs=1, seed=0, device="cpu")
    model.learn(256, callback=evaluation)
    assert len(model.ep_info_buffer) == len(model.ep_success_buffer) > 0
    assert np.load(tmp_path / "evaluations.npz")["successes"].shape == (2, 4)


def test_without_sb3_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.vec_env", None)
    spec = importlib.util.spec_from_file_location("fresh_copy", sb3.__file__)
    with pytest.raises(ImportError, match=r"needs Stable-Baselines3: pip install .*agents"):
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
