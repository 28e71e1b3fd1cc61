"""Fits of car-following models to pairs whose follower's parameters are known."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from jaxcalib.errors import CaseError
from jaxcalib.pair_fitting.fit import fit_pairs, mixed_errors
from jaxcalib.pair_fitting.recorded_pairs import STEP_S, RecordedPair, read_pairs
from surrogate.car_following.registry import car_following_model
from surrogate.car_following.replay import ReplayStart, replay
from tests.jaxcalib.pair_fitting.pairs import TRUTH, simulated_pair, stop_and_go, table


@pytest.mark.parametrize("model", TRUTH)
def test_the_follower_s_parameters_are_found_again(model: str) -> None:
    pairs = [simulated_pair(model, f"p{k}", 600 + 150 * k, 0.7 * k) for k in range(3)]
    entry = car_following_model(model)
    fits = fit_pairs(entry, pairs)
    assert [fit.name for fit in fits] == ["p0", "p1", "p2"]
    for fit in fits:
        assert fit.mixed_error < 0.01
        assert fit.smallest_gap_m > 0.0
    names = [one.name for one in entry.parameters]
    for name in ("jam_gap_m", "time_gap_s"):
        found = np.median([fit.values[names.index(name)] for fit in fits])
        assert found == pytest.approx(TRUTH[model][name], rel=0.05)


def test_with_noise_the_errors_cover_the_truth_and_what_is_not_shown_is_said_not_to_be() -> None:
    """Nobody comes near his desired speed of 28 m/s, which only bounds the speed, so it is not identified."""
    entry = car_following_model("krauss")
    truth = TRUTH["idm"]
    start = 4.0
    pairs = []
    for k in range(6):
        leader = stop_and_go(900, 0.9 * k)
        first = ReplayStart(*(jnp.asarray([value]) for value in (leader[0], 0.0, start + leader[0], 0.0, 28.0)))
        model = entry.build({name: value for name, value in truth.items() if name != "acceleration_exponent"})
        _, states = replay(model, first, jnp.asarray(leader)[:, None], jnp.full(1, 0.5), STEP_S)
        gap = np.append(start + leader[0], np.asarray(states.gap_m[:-1, 0]))
        gap = gap + 0.15 * np.random.default_rng(k).standard_normal(len(gap))
        pairs.append(RecordedPair(f"p{k}", leader, np.append(leader[0], np.asarray(states.speed_mps[:-1, 0])), gap))
    fits = fit_pairs(entry, pairs)
    names = [one.name for one in entry.parameters]
    place = names.index("time_gap_s")
    z = np.asarray([(fit.values[place] - truth["time_gap_s"]) / fit.error[place] for fit in fits])
    assert np.abs(z).max() < 6.0
    assert np.abs(z).max() > 0.05  # errors that are far too large would cover anything
    assert all(fit.is_identified[place] for fit in fits)
    assert not any(fit.is_identified[-1] for fit in fits)


def test_errors_on_other_steps_are_those_of_the_same_follower() -> None:
    pair = simulated_pair("idm", "p", 900, 0.4, noise_m=0.1)
    entry = car_following_model("idm")
    (fit,) = fit_pairs(entry, [pair.part(0, 450)])
    (held_out,) = mixed_errors(entry, [pair.part(450, 900)], fit.values[None])
    (fitted,) = mixed_errors(entry, [pair.part(0, 450)], fit.values[None])
    assert fitted == pytest.approx(fit.mixed_error, rel=1e-3)
    assert held_out < 0.05


def test_pairs_are_read_on_an_even_clock(tmp_path: Path) -> None:
    whole = table()
    pd.concat([whole[::2], whole.assign(pair_id="b")]).to_csv(tmp_path / "pairs.csv", index=False)
    pairs, dropped = read_pairs(tmp_path / "pairs.csv")
    assert ([pair.name for pair in pairs], dropped) == (["a", "b"], [])
    assert (len(pairs[0]), len(pairs[1])) == (299, 300)
    np.testing.assert_allclose(pairs[0].gap_m[::2], whole.gap_m[::2], atol=1e-6)


@pytest.mark.parametrize(
    ("column", "value", "expected"),
    [
        ("gap_m", -0.3, "expected a gap above 0, got -0.3"),
        ("v_lead_mps", np.nan, "a pair needs its leader at all times"),
        ("time_s", 0.0, "expected time to run forwards"),
    ],
)
def test_a_pair_that_cannot_be_followed_is_refused_or_left_out(
    tmp_path: Path, column: str, value: float, expected: str
) -> None:
    bad = table()
    bad.loc[7, column] = value
    good = table(pair_id="b")
    pd.concat([bad, good]).to_csv(tmp_path / "pairs.csv", index=False)
    with pytest.raises(CaseError, match=expected) as error:
        read_pairs(tmp_path / "pairs.csv")
    assert 'pair "a", row 9' in str(error.value)
    pairs, dropped = read_pairs(tmp_path / "pairs.csv", drops_bad=True)
    assert [pair.name for pair in pairs] == ["b"]
    assert len(dropped) == 1
    assert expected in dropped[0]
