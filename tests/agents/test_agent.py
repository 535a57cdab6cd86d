"""The agent's file: it acts as the model it was saved from, holds numbers only, and may be anyone's."""

import io
import os
import pickle

import agent
import config
import evaluate
import learner
import numpy as np
import pytest
import runs
import toy_env
import watch
from conftest import HERE
from test_train import zipped

import springgym.envs.agent

TOY = "toy_env:Toy-v0"


def untrained(algo, folder, normalize=False):
    """A run that was just begun, its model, and observations as its environment gives them."""
    settings = [f"normalize={str(normalize).lower()}"]
    asked = config.load_config(algo, TOY, settings, HERE / f"toy_{algo}.yaml")
    run = runs.create_run(runs.Run(folder, algo, TOY, 0, asked))
    env = learner.make_training_env(run)
    model = learner.new_model(run, env)
    if normalized := model.get_vec_normalize_env():
        normalized.reset()
        for _ in range(50):
            normalized.step(np.ones((env.num_envs, 1), np.float32))
    runs.write_config(run)
    agent.save_agent(run.agent, model)
    return run, model


@pytest.fixture
def saved(tmp_path):
    """The folder of such a run."""
    run, _ = untrained("ppo", tmp_path / "run")
    return run


def spaces():
    env = toy_env.ToyVectorEnv(1)
    return env.single_observation_space, env.single_action_space


@pytest.mark.parametrize("normalize", [False, True])
@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_it_acts_as_the_model_does(algo, normalize, tmp_path):
    run, model = untrained(algo, tmp_path, normalize)
    if algo == "ppo":
        model.policy.action_net.weight.data *= 300  # so that some actions are clipped
        agent.save_agent(run.agent, model)
    observations = np.random.default_rng(0).normal(size=(100, 2)).astype(np.float32)
    seen = observations
    if normalize:
        seen = model.get_vec_normalize_env().normalize_obs(observations)
        assert np.abs(seen - observations).max() > 0.1
    expected = model.predict(seen, deterministic=True)[0]
    found = runs.load_policy(run, *spaces())(observations)
    assert np.ptp(expected) > 0.1
    assert (np.abs(expected) == 1).any() == (algo == "ppo")
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-6)  # float32, summed in another order
    assert found.dtype == np.float32


class Planted:
    """Whoever unpickles it makes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def changed(saved, **arrays):
    """The agent's file with other arrays."""
    file = io.BytesIO()
    with np.load(saved.agent) as good:
        np.savez(file, **{**good, **arrays})
    return file.getvalue()


def header(shape):
    """That of an array, without the array."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return file.getvalue()


def flipped(saved):
    """The agent's file with one bit of a weight wrong."""
    with np.load(saved.agent) as good:
        weights = good["action_net.weight"].tobytes()
    wrong = bytes([weights[0] ^ 1, *weights[1:]])
    return saved.agent.read_bytes().replace(weights, wrong)


BIAS = "action_net.bias"


def grown(saved, size):
    """The weights that act last, each of such a size."""
    with np.load(saved.agent) as good:
        return {"action_net.weight": np.full_like(good["action_net.weight"], size)}


WRONG = {
    "empty": lambda saved: b"",
    "cut short": lambda saved: saved.agent.read_bytes()[:1000],
    "flipped": lambda saved: flipped(saved),
    "text": lambda saved: b"an agent",
    "an array": lambda saved: np.zeros(3).tobytes(),
    "another zip": lambda saved: zipped(readme__txt="an agent"),
    "a pickled member": lambda saved: zipped(action_net__bias=pickle.dumps(1)),
    "too few": lambda saved: zipped(),
    "too many": lambda saved: changed(saved, extra=np.zeros(1)),
    "another shape": lambda saved: changed(saved, **{BIAS: np.zeros(2, np.float32)}),
    "not finite": lambda saved: changed(saved, **{BIAS: np.full(1, np.nan, np.float32)}),
    "not numbers": lambda saved: changed(saved, **{BIAS: np.array(["a"])}),
    "endless": lambda saved: zipped(**{BIAS + ".npy": header((10**15,))}),
    "beyond all integers": lambda saved: zipped(**{BIAS + ".npy": header((2**70,))}),
    "of less than nothing": lambda saved: zipped(**{BIAS + ".npy": header((-1,))}),
    "no array": lambda saved: zipped(**{BIAS + ".npy": np.lib.format.magic(1, 0)}),
    "too large for float32": lambda saved: changed(saved, **{BIAS: np.full(1, 1e300)}),
    "too large to be summed": lambda saved: changed(saved, **grown(saved, 3e38)),
}
"""What may stand in an agent's file."""


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_file_is_told_in_a_line(what, saved, capsys):
    saved.agent.write_bytes(WRONG[what](saved))
    assert evaluate.main([str(saved.folder), "--env", TOY, "--episodes", "1"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"evaluate.py: error: {saved.agent}: ")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("algo", "size", "refused"),
    [("ppo", 1e30, False), ("ppo", 3e38, True), ("sac", 1e5, False), ("sac", 1e20, True)],
)
def test_whoever_acts_gives_numbers(algo, size, refused, tmp_path):
    """Whatever is seen. What comes out of a layer of SAC, of ReLU, enters the next as it is."""
    run, model = untrained(algo, tmp_path)
    for name, weights in model.policy.state_dict().items():
        if "weight" in name:
            weights[:] = size * weights.sign()
    agent.save_agent(run.agent, model)
    observations, actions = spaces()
    if refused:
        with pytest.raises(config.ConfigError, match="too large"):
            runs.load_policy(run, observations, actions)
        return
    act = runs.load_policy(run, observations, actions)
    assert np.isfinite(act(np.array([observations.low, observations.high, 0 * observations.high]))).all()


@pytest.mark.parametrize("wrong", [{"variance": -1.0}, {"limits": [0.0, 10.0]}, {"limits": [1e-8, 1e300]}])
def test_statistics_that_normalise_nothing_are_refused(wrong, tmp_path):
    run, _ = untrained("ppo", tmp_path, normalize=True)
    runs.load_policy(run, *spaces())
    given = {f"observations.{name}": np.broadcast_to(value, (2,)) for name, value in wrong.items()}
    run.agent.write_bytes(changed(run, **given))
    with pytest.raises(config.ConfigError, match="cannot normalise"):
        runs.load_policy(run, *spaces())


def test_a_file_that_unpacks_to_too_much_is_not_unpacked(saved, monkeypatch):
    """Its directory says how large it is."""
    saved.agent.write_bytes(zipped(**{BIAS + ".npy": bytes(10_000)}))
    monkeypatch.setattr(springgym.envs.agent, "LARGEST", 1000)
    monkeypatch.setattr(np, "load", None)
    with pytest.raises(config.ConfigError, match="an agent has at most 1000"):
        runs.load_policy(saved, *spaces())


def test_a_folder_or_nothing_in_place_of_the_file(saved, capsys):
    arguments = [str(saved.folder), "--env", TOY, "--out", str(saved.folder / "film.gif")]
    saved.agent.unlink()
    assert watch.main(arguments) == 2
    assert f"{saved.folder} has no agent.npz; if the run is your own" in capsys.readouterr().err
    saved.agent.mkdir()
    assert watch.main(arguments) == 2
    assert "not hold the arrays of an agent: it is a folder" in capsys.readouterr().err


def test_nothing_that_is_planted_is_run(saved, tmp_path, capsys):
    """In the agent's file, the checkpoint and beside them."""
    trap = tmp_path / "trap"
    arguments = [str(saved.folder), "--env", TOY]
    for name in ("model.zip", "training_state.pkl", "vecnormalize.pkl"):
        (saved.folder / name).write_bytes(pickle.dumps(Planted(trap)))
    saved.model.write_bytes(zipped(data=pickle.dumps(Planted(trap)), vecnormalize__pkl="x"))
    assert evaluate.main([*arguments, "--episodes", "2"]) == 0
    assert watch.main([*arguments, "--out", str(tmp_path / "film.gif")]) == 0
    file = io.BytesIO()
    np.savez(file, **{BIAS: np.array([Planted(trap)], object)})
    for content in (file.getvalue(), pickle.dumps(Planted(trap))):
        saved.agent.write_bytes(content)
        assert evaluate.main([*arguments, "--episodes", "2"]) == 2
        assert watch.main([*arguments, "--out", str(tmp_path / "film.gif")]) == 2
    assert not trap.exists()
    pickle.loads(pickle.dumps(Planted(trap)))
    assert trap.exists()  # as it would, if it were unpickled


def test_a_module_is_imported_only_if_the_user_names_it(saved, capsys):
    for main in (evaluate.main, watch.main):
        assert main([str(saved.folder)]) == 2
        assert f"to allow this, add --env {TOY}" in capsys.readouterr().err


def test_an_agent_of_other_observations_is_refused(saved, capsys):
    """Here by a configuration that was edited; so if an environment has changed since."""
    text = saved.folder.joinpath("config.yaml").read_text()
    saved.folder.joinpath("config.yaml").write_text(text.replace("net_arch: [16]", "net_arch: [17]"))
    assert evaluate.main([str(saved.folder), "--env", TOY]) == 2
    assert "config.yaml require finite numbers [17, 2]" in capsys.readouterr().err


def test_an_agent_of_another_environment_is_refused(saved, capsys):
    for main in (evaluate.main, watch.main):
        assert main([str(saved.folder), "--env", "SpringTop-v0"]) == 2
        assert f"was trained on {TOY}, not on SpringTop-v0" in capsys.readouterr().err
