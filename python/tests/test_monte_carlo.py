"""`insnav.batch.monte_carlo`: the same numbers whoever computes them, and what they are together."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insnav
from insnav import batch

CONFIG: dict[str, Any] = {"imu": {"grade": "consumer"}, "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]}}
RUNS, FIRST = 4, 11


@pytest.fixture(scope="module")
def scenario() -> insnav.sim.Scenario:
    return insnav.sim.Scenario.from_toml(
        """
        duration_s = 120
        ready_route = "car"
        start = { latitude_deg = 50.1, longitude_deg = 14.4, height_m = 250, heading_deg = 70 }
        imu = { grade = "consumer", rate_hz = 100 }
        """
    )


@pytest.fixture(scope="module")
def here(scenario: insnav.sim.Scenario) -> batch.MonteCarlo:
    result = batch.monte_carlo(scenario, RUNS, seed=FIRST, config=CONFIG, workers=0)
    assert not result.failures, result
    return result


def test_each_run_is_that_of_its_seed(scenario: insnav.sim.Scenario, here: batch.MonteCarlo) -> None:
    assert here.seeds.tolist() == [11, 12, 13, 14] and here.skipped.size == 0
    simulated = scenario.simulate(12)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", insnav.InsnavWarning)
        alone = insnav.compare(insnav.run(simulated.arrays, CONFIG), simulated.truth)
    assert here.summaries[1] == alone.summary
    # By numpy, from the errors at every instant.
    horizontal = np.hypot(alone.position_error_n_m[:, 0], alone.position_error_n_m[:, 1])
    assert here.table["horizontal_rms_m"][1] == pytest.approx(np.sqrt(np.mean(horizontal**2)), rel=1e-12)
    assert here.table["nees_velocity"][1] == pytest.approx(np.mean(alone.nees_velocity), rel=1e-12)
    assert len(set(here.table["horizontal_rms_m"].tolist())) == RUNS, "seeds are different runs"


def test_it_is_the_same_whoever_computes(scenario: insnav.sim.Scenario, here: batch.MonteCarlo) -> None:
    for workers in [1, 3]:
        there = batch.monte_carlo(scenario, RUNS, seed=FIRST, config=CONFIG, workers=workers)
        assert there.summaries == here.summaries and there.seeds.tolist() == here.seeds.tolist()


def test_a_cluster_computes_the_same(scenario: insnav.sim.Scenario, here: batch.MonteCarlo) -> None:
    distributed = pytest.importorskip("distributed", reason="distributed is not installed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        there = batch.monte_carlo(scenario, RUNS, seed=FIRST, config=CONFIG, client=client)
    assert there.summaries == here.summaries


def test_what_they_are_together(here: batch.MonteCarlo) -> None:
    runs = [summary["all"] for summary in here.summaries]
    each = np.array([run["heading_rms_deg"] for run in runs])
    assert here.rms["heading_rms_deg"] == pytest.approx(np.sqrt(np.sum(each**2) / RUNS))
    nees = np.array([run["nees"]["attitude"] for run in runs])
    mean, error = here.nees["attitude"]
    assert mean == pytest.approx(nees.sum() / RUNS)
    assert error == pytest.approx(np.sqrt(np.sum((nees - mean) ** 2) / (RUNS - 1) / RUNS))
    assert "seed" in here.table and all(len(column) == RUNS for column in here.table.values())
    assert "4 of 4 finished" in str(here) and "nees attitude" in str(here)


def test_a_single_run_has_no_scatter(here: batch.MonteCarlo) -> None:
    one = batch.MonteCarlo(here.seeds[:1], here.summaries[:1], here.skipped, ())
    mean, error = one.nees["position"]
    assert mean == here.summaries[0]["all"]["nees"]["position"] and np.isnan(error)


def test_goes_on_where_it_was(scenario: insnav.sim.Scenario, here: batch.MonteCarlo, tmp_path: Path) -> None:
    def again(runs: int = RUNS, of: insnav.sim.Scenario = scenario, **options: Any) -> tuple[batch.MonteCarlo, list[int]]:
        result = batch.monte_carlo(of, runs, seed=FIRST, **{"config": CONFIG, "output_dir": tmp_path, "workers": 0, **options})
        return result, sorted(set(result.seeds.tolist()) - set(result.skipped.tolist()))

    assert again(2)[1] == [11, 12]
    whole, anew = again()
    assert anew == [13, 14] and whole.summaries == here.summaries
    assert again()[1] == []
    assert again(config={"imu": {"grade": "industrial"}})[1] == [11, 12, 13, 14]
    assert again()[1] == [11, 12, 13, 14]
    assert again(compare={"from_s": 30.0}, runs=1)[1] == [11]
    assert again(known_start=True, runs=1)[1] == [11]
    shorter = insnav.sim.Scenario.from_dict({**scenario.to_dict(), "duration_s": 110.0})
    assert again(of=shorter, runs=1)[1] == [11]
    (tmp_path / "seed-000012.json").write_text("{")
    assert again()[1] == [11, 12]
    assert json.loads((tmp_path / "seed-000012.json").read_text())["inputs"]["seed"] == 12


def test_a_known_start_is_the_truth(scenario: insnav.sim.Scenario) -> None:
    options: dict[str, Any] = {"seed": FIRST, "config": CONFIG, "workers": 0, "compare": {"to_s": 0.5}}
    known = batch.monte_carlo(scenario, 1, known_start=True, **options)
    found = batch.monte_carlo(scenario, 1, **options)
    # The truth at the first sample; from there nothing but the biases of the gyros turns it, which start at zero in the filter.
    turned = np.linalg.norm(scenario.simulate(FIRST).truth.gyro_bias_deg_per_hour[0]) / 3600 * 0.5
    assert known.table["heading_rms_deg"][0] < turned < found.table["heading_rms_deg"][0]


def test_refuses_what_it_cannot_do(scenario: insnav.sim.Scenario) -> None:
    with pytest.raises(TypeError, match="known_start"):
        batch.monte_carlo(scenario, 1, start={})
    with pytest.raises(insnav.ArgumentError, match="runs: -1"):
        batch.monte_carlo(scenario, -1)
    for seed, runs in [(-1, 1), (2**64, 1), (2**64 - 1, 2)]:
        with pytest.raises(insnav.ArgumentError, match=f"seed: {seed} and {runs} runs"):
            batch.monte_carlo(scenario, runs, seed=seed, workers=0)
    with pytest.raises(insnav.ConfigError):
        batch.monte_carlo(scenario, 1, config={"imu": {"class": "good"}})
    (failure,) = batch.monte_carlo(scenario, 1, compare={"to_s": -5.0}, workers=0).failures
    assert failure.item == 0 and failure.message


def test_seeds_go_as_far_as_those_of_simulate(scenario: insnav.sim.Scenario) -> None:
    result = batch.monte_carlo(scenario, 2, seed=2**64 - 2, config=CONFIG, workers=0)
    assert not result.failures and result.seeds.tolist() == [2**64 - 2, 2**64 - 1] == result.table["seed"].tolist()


def test_a_file_of_somebody_else_is_left_alone(scenario: insnav.sim.Scenario, tmp_path: Path) -> None:
    mine = tmp_path / "seed-000012.json"
    mine.write_text('{"weights": [1, 2]}')
    result = batch.monte_carlo(scenario, 2, seed=FIRST, config=CONFIG, output_dir=tmp_path, workers=0)
    (failure,) = result.failures
    assert failure.item == 12 and failure.code == "output_exists" and str(mine) in failure.message
    assert mine.read_text() == '{"weights": [1, 2]}' and result.seeds.tolist() == [11]


def test_a_table_is_a_frame(here: batch.MonteCarlo) -> None:
    pytest.importorskip("pandas")
    frame = here.to_pandas()
    assert frame.index.tolist() == here.seeds.tolist()
    assert np.array_equal(frame["height_rms_m"], here.table["height_rms_m"])
