"""Self-play: who plays whom, and what Elo's ratings say of known odds."""

from __future__ import annotations

import csv

import numpy as np
import pytest
import self_play

ODDS = 10.0 ** (np.array([0.0, 200.0, 500.0]) / 400.0)


def played(duels: int) -> list[self_play.Duels]:
    """Return what players of known ratings reach, on average."""
    pairs = [(0, 1), (0, 2), (1, 2)]
    return [self_play.Duels(i, j, np.full(duels, ODDS[i] / (ODDS[i] + ODDS[j]))) for i, j in pairs]


def test_ratings_are_those_that_the_odds_come_from() -> None:
    found = self_play.ratings(played(100_000), 3)
    np.testing.assert_allclose(found - found[0], [0.0, 200.0, 500.0], atol=0.5)
    few = self_play.ratings(played(10), 3)
    assert few[2] - few[0] < 490.0  # the draw that is added weighs more


def test_who_wins_all_duels_is_rated_higher_by_a_finite_amount() -> None:
    found = self_play.ratings([self_play.Duels(0, 1, np.ones(50))], 2)
    assert found[0] - found[1] == pytest.approx(400 * np.log10(50.5 / 0.5))


def test_half_of_the_copies_play_the_newest() -> None:
    league = self_play.League()
    league.players = [lambda seen, n=n: np.full((len(seen), 2), n) for n in range(5)]
    actions = league(np.zeros((64, 18)))
    np.testing.assert_array_equal(actions[:32], 4)
    assert set(actions[32:, 0]) == set(range(5))
    assert np.bincount(actions[32:, 0].astype(int)).min() >= 6


@pytest.mark.slow
def test_of_two_equal_players_neither_is_better() -> None:
    """Each has either side in the same duels."""
    (one,) = self_play.tournament([self_play.OPPONENTS["script"]] * 2, 2)
    assert one.points.mean() == 0.5
    (one,) = self_play.tournament([self_play.OPPONENTS[name] for name in ("strong", "still")], 2)
    assert one.points.mean() > 0.5


@pytest.mark.slow
def test_a_run_is_rated_and_goes_on(tmp_path, capsys) -> None:
    run = tmp_path / "duel"
    for steps in (16384, 32768):  # one round of play each, by configs/ppo.yaml
        assert self_play.main([str(run), "--timesteps", str(steps), "--every", "16384", "--duels", "1"]) == 0
        config = run / "config.yaml"
        config.write_text(config.read_text().replace("total_timesteps: 16384", "total_timesteps: 32768"))
    assert [path.stem for path in sorted((run / "league").iterdir())] == ["000016384", "000032768"]
    with (run / "elo.csv").open() as file:
        rows = {row["player"]: float(row["rating"]) for row in csv.DictReader(file)}
    assert set(rows) == {*self_play.OPPONENTS, "16,384 steps", "32,768 steps"}
    assert rows["script"] == 1000.0
    assert rows["strong"] > rows["still"]
    assert "against strong" in capsys.readouterr().out
