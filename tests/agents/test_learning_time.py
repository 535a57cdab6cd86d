"""How long learning takes, and what of it is what."""

import json

import learning_time
import pytest
from conftest import HERE


@pytest.mark.slow
def test_learning_ends_where_the_task_is_learned_and_is_told_apart(tmp_path, capsys):
    """What is physics, what the policy and what learning adds up to the seconds."""
    path = tmp_path / "rows.json"
    arguments = ["toy_env:Toy-v0", "--config", str(HERE / "toy_ppo.yaml"), "--json", str(path)]
    assert learning_time.main(arguments) == 0
    (row,) = json.loads(path.read_text())
    assert row["learned"]
    assert 0 < row["steps"] <= 12288
    assert min(row["physics"], row["policy"], row["learning"]) > 0
    assert f"| {row['steps']:,} |" in capsys.readouterr().out
