"""Transfer between rigid bodies and springs: who learns where, who plays where, and the table of it."""

import json
import os

import pytest
import transfer
from conftest import AGENTS
from test_train import PYTHONPATH

SMALL = ["total_timesteps=64", "n_envs=8", "n_steps=8", "batch_size=64", "n_epochs=1", "net_arch=[8]"]


@pytest.mark.slow
def test_every_kind_plays_everywhere(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([PYTHONPATH, str(AGENTS)]))
    monkeypatch.setattr(transfer, "STIFFNESS", (*transfer.STIFFNESS, 0.001))
    command = ["SpringTop-v0", "--seeds", "1", "--episodes", "3", "--runs", str(tmp_path), "--local"]
    assert transfer.main([*command, "--jobs", "1", "--set", *SMALL]) == 0
    folder = tmp_path / "SpringTop-v0"
    rows = json.loads((folder / "transfer.json").read_text())
    kinds = ["springs", "springs, randomised", "rigid", "rigid, randomised"]
    places = ["rigid", "1 k", "0.3 k", "0.1 k", "0.03 k", "0.01 k"]
    assert [(row["learned"], row["played"]) for row in rows] == [(k, p) for k in kinds for p in places]
    assert len({row["mean_return"] for row in rows}) > 10
    said = capsys.readouterr().out
    assert "0.001 k is left out: SpringTop-v0: SpringTop would start with a strain" in said
    assert (folder / "transfer.svg").read_text().count("<svg") == 1
    made = (folder / "springs" / "SpringTop-v0-ppo-0" / "model.zip").stat().st_mtime_ns
    assert transfer.main([*command, "--jobs", "1", "--set", *SMALL]) == 0
    assert (folder / "springs" / "SpringTop-v0-ppo-0" / "model.zip").stat().st_mtime_ns == made


def test_table():
    rows = [
        {"learned": "rigid", "played": place, "mean_return": value, "success_rate": 0.5}
        for place, value in (("rigid", 0.5), ("1 k", 0.25), ("rigid", 0.7))
    ]
    assert transfer.table(rows).splitlines()[-1] == (
        "| rigid | 50 %, 0.600 (0.500–0.700) | 50 %, 0.250 (0.250–0.250) |"
    )
