"""`insnav.Eskf` against a dense Kalman filter of numpy, whose derivatives are differences taken through the public interface."""

from __future__ import annotations

import copy
import pickle
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import insnav
from insnav import attitude, earth
from insnav.filter import BLOCKS, Eskf, Gate, ImuNoise, Update
from insnav.mechanization import NavState

Array = NDArray[np.float64]
Measure = Callable[[Eskf, "Gate | None"], Update]

DT = 0.01
LEVER = [0.5, -0.2, -1.1]
#: Steps of the differences: of each block a hundredth of what it is known to, so that what is left out is 1e-4 of that.
SIGMAS = {
    "position": [2.0, 3.0, 5.0],
    "velocity": [0.3, 0.2, 0.1],
    "attitude": [0.01, 0.02, 0.1],
    "gyro_bias": [1e-4, 2e-4, 1e-4],
    "accel_bias": [0.02, 0.03, 0.02],
}


def make(**changes: Any) -> Eskf:
    start = NavState.from_degrees(50.0, 14.0, 300.0, [9.0, 4.0, -0.3], roll_deg=3.0, pitch_deg=-5.0, heading_deg=25.0)
    sigmas = {f"{name}_sigma": value for name, value in SIGMAS.items()}
    return Eskf(start, "industrial", **{**sigmas, **changes})


def moved(n: int = 100, seed: int = 1) -> tuple[Array, Array]:
    """Increments of something between a bend and a bump."""
    rng = np.random.default_rng(seed)
    rate = np.array([0.05, -0.1, 0.4]) + rng.normal(0, 0.05, (n, 3))
    force = np.array([0.8, 2.5, -9.7]) + rng.normal(0, 0.3, (n, 3))
    return rate * DT, force * DT


def steps(eskf: Eskf) -> Array:
    return 0.01 * np.sqrt(np.diag(eskf.covariance))


def propagated(eskf: Eskf, r: Array, v: Array) -> Eskf:
    after = copy.deepcopy(eskf)
    after.propagate(DT, r, v)
    return after


def transition(eskf: Eskf, r: Array, v: Array) -> Array:
    """d(error after) / d(error before), by differences."""
    n, base = len(eskf), propagated(eskf, r, v)
    f = np.empty((n, n))
    for j, h in enumerate(steps(eskf)):
        ends = []
        for sign in (1, -1):
            other = copy.deepcopy(eskf)
            other.retract(sign * h * np.eye(n)[j])
            ends.append(base.local(propagated(other, r, v)))
        f[:, j] = (ends[0] - ends[1]) / (2 * h)
    return f


def sensitivity(eskf: Eskf, measure: Measure) -> Array:
    """H = −d(residual) / d(error): the residual is measured minus predicted."""
    n = len(eskf)
    columns = []
    for j, h in enumerate(steps(eskf)):
        ends = []
        for sign in (1, -1):
            other = copy.deepcopy(eskf)
            other.retract(sign * h * np.eye(n)[j])
            ends.append(measure(other, Gate.closed()).residual)
        columns.append(-(ends[0] - ends[1]) / (2 * h))
    return np.column_stack(columns)


def noise_of(eskf: Eskf) -> Array:
    q, noise = np.zeros(len(eskf)), eskf.noise
    b = eskf.blocks
    q[b["velocity"]] = noise.accel_white**2 * DT
    q[b["attitude"]] = noise.gyro_white**2 * DT
    q[b["gyro_bias"]] = noise.gyro_bias_sigma**2 * -np.expm1(-2 * DT / noise.gyro_bias_tau)
    q[b["accel_bias"]] = noise.accel_bias_sigma**2 * -np.expm1(-2 * DT / noise.accel_bias_tau)
    return np.diag(q)


def apart(p: Array, q: Array) -> float:
    """Largest difference of two covariances, each element by the sigmas of its row and column."""
    s = np.sqrt(np.diag(q))
    return float(np.max(np.abs(p - q) / np.outer(s, s)))


def test_the_covariance_propagates_as_a_dense_one_does() -> None:
    eskf = make()
    p, wrong = eskf.covariance, eskf.covariance
    for r, v in zip(*moved(), strict=True):
        f, q = transition(eskf, r, v), noise_of(eskf)
        p = f @ p @ f.T + q
        # The other sign of the attitude's errors: of f × φ, C db_g.
        turned = f.copy()
        a = eskf.blocks["attitude"]
        turned[:6, a] *= -1
        wrong = turned @ wrong @ turned.T + q
        eskf.propagate(DT, r, v)
    # Blocks of Φ are of first order in dt: over a step ω dt/2 = 2e-3 of what one state does to another is missing, and of the whole second
    # what that makes of the part that has come in during it.
    assert apart(eskf.covariance, p) < 4e-3
    assert apart(eskf.covariance, wrong) > 100 * 4e-3
    assert np.array_equal(eskf.covariance, eskf.covariance.T)


MEASUREMENTS: dict[str, tuple[Measure, Array]] = {
    "gnss_position": (
        lambda f, gate: f.update_gnss_position(
            earth.offset([np.radians(50.0), np.radians(14.0), 300.0], [3.0, -2.0, 4.0]), sigma=[1.0, 2.0, 3.0], lever_arm_b=LEVER, gate=gate
        ),
        np.diag([1.0, 4.0, 9.0]),
    ),
    "gnss_velocity": (
        lambda f, gate: f.update_gnss_velocity([9.1, 4.2, -0.2], sigma=0.05, lever_arm_b=LEVER, gate=gate),
        0.0025 * np.eye(3),
    ),
    "horizontal_velocity": (
        lambda f, gate: f.update_gnss_velocity([9.1, 4.2, np.nan], sigma=0.05, lever_arm_b=LEVER, gate=gate),
        0.0025 * np.eye(2),
    ),
    "heading": (lambda f, gate: f.update_heading(np.radians(27.0), sigma=0.02, gate=gate), np.array([[4e-4]])),
    "zero_velocity": (lambda f, gate: f.update_zero_velocity(sigma=5.0, gate=gate), 25 * np.eye(3)),
    "zero_heading_rate": (
        lambda f, gate: f.update_zero_heading_rate(DT, sigma=1e-3, gain="naive", gate=gate),
        np.array([[1e-6]]),
    ),
    "nonholonomic": (
        lambda f, gate: f.update_nonholonomic(sigma=0.2, axle_b=[-1.5, 0.0, 0.5], gate=gate),
        0.04 * np.eye(2),
    ),
    "lateral": (lambda f, gate: f.update_nonholonomic(sigma=0.2, lateral_only=True, gate=gate), np.array([[0.04]])),
    "standing_force": (
        lambda f, gate: f.update_standing_force([-0.8, -0.5, -9.75], sigma=0.01, gate=gate),
        1e-4 * np.eye(3),
    ),
    "standing_rate": (
        lambda f, gate: f.update_standing_rate([1e-4, 2e-4, 0.0], sigma=[1e-4, 2e-4, 1e-4], gate=gate),
        np.diag([1e-8, 4e-8, 1e-8]),
    ),
    "barometer": (
        lambda f, gate: f.update_linear("barometer", [f.state.position[2] - 302.0], {"position": [0.0, 0.0, 1.0]}, 0.25, gate=gate),
        np.array([[0.25]]),
    ),
}


def turned(eskf: Eskf, p: np.ndarray, dx: np.ndarray) -> np.ndarray:
    """What is left after a correction, in axes that have turned with the estimate: the level errors turn about down."""
    at = eskf.blocks["attitude"].start
    c, s = np.cos(dx[at + 2]), np.sin(dx[at + 2])
    turn = np.eye(len(p))
    turn[at : at + 2, at : at + 2] = [[c, -s], [s, c]]
    after: np.ndarray = turn @ p @ turn.T
    return after


@pytest.mark.parametrize("name", MEASUREMENTS)
def test_measurements_correct_as_in_a_dense_filter(name: str) -> None:
    measure, r = MEASUREMENTS[name]
    eskf = make()
    eskf.propagate(DT, *moved())
    p, h = eskf.covariance, sensitivity(eskf, measure)
    if name == "standing_force":
        # That gravity falls with height, 3.1e-6 (m/s²)/m, is left out of this model's H (CONVENTIONS.md).
        where = h[:, eskf.blocks["position"]]
        assert 1e-7 < np.abs(where).max() < 3.2e-6
        where[:] = 0
    if name == "zero_heading_rate":
        # Its H is that of a body at rest, (φ × ω_ie)_D: the noise of a rate is no rate.
        rate = 7.292115e-5 * np.cos(np.radians(50.0))
        where = h[:, eskf.blocks["attitude"]]
        assert np.abs(where - [[0.0, -rate, 0.0]]).max() > 1e-3, "it does move"
        where[:] = [[0.0, -rate, 0.0]]
    looked_at = measure(copy.deepcopy(eskf), Gate.closed())
    assert looked_at.verdict == "rejected"
    residual = looked_at.residual
    s = h @ p @ h.T + r
    k = np.linalg.solve(s, h @ p).T
    expected = p - k @ s @ k.T

    after = copy.deepcopy(eskf)
    told = measure(after, None)
    assert (told.dof, told.verdict) == (len(r), "accepted")
    # Derivatives by differences are good to (step)²/6 of the bends: a tilt of 1e-3 bends by 2e-7.
    assert apart(after.covariance, turned(eskf, expected, eskf.local(after))) < 1e-5
    np.testing.assert_allclose(told.sigma, np.sqrt(np.diag(s)), rtol=1e-5)
    assert told.nis == pytest.approx(residual @ np.linalg.solve(s, residual), rel=1e-4)
    dx = eskf.local(after)
    np.testing.assert_allclose(dx / np.sqrt(np.diag(p)), k @ residual / np.sqrt(np.diag(p)), atol=1e-4)

    # The other sign of H is another filter.
    wrong = -k @ residual / np.sqrt(np.diag(p))
    assert np.abs(dx / np.sqrt(np.diag(p)) - wrong).max() > 0.01


def test_an_own_measurement_is_as_good_as_a_built_in_one() -> None:
    eskf = make()
    eskf.propagate(DT, *moved())
    own, built_in = copy.deepcopy(eskf), copy.deepcopy(eskf)
    told = built_in.update_gnss_velocity([9.1, 4.2, -0.2], sigma=0.05)
    v = np.array([9.1, 4.2, -0.2]) - own.state.velocity_n
    same = own.update_linear("mine", v, {"velocity": np.eye(3)}, 0.0025 * np.eye(3))
    assert (same.measurement, told.measurement) == ("mine", "gnss_velocity")
    assert same.nis == told.nis and np.array_equal(own.covariance, built_in.covariance)
    assert own.state == built_in.state


def test_the_gate_decides() -> None:
    eskf = make()
    before = pickle.dumps(eskf)
    gate = Gate(patience=2)
    far = [np.radians(50.01), np.radians(14.0), 300.0]
    verdicts = [eskf.update_gnss_position(far, sigma=1.0, gate=gate).verdict for _ in range(2)]
    assert verdicts == ["rejected", "rejected"] and pickle.dumps(eskf) == before
    # What a gate remembers goes with it.
    gate = pickle.loads(pickle.dumps(gate))
    assert eskf.update_gnss_position(far, sigma=1.0, gate=gate).verdict == "inflated"
    assert make().update_gnss_position(far, sigma=1.0).verdict == "accepted"
    assert make().update_gnss_position(far, sigma=1.0, gate=Gate.lenient()).verdict == "inflated"
    assert make().update_gnss_position(far, sigma=1.0, gate=Gate.strict()).verdict == "rejected"
    assert Gate.open().limit[2] == np.inf


def test_blocks_open_and_close_by_name() -> None:
    eskf = make()
    assert list(eskf.blocks) == list(BLOCKS)[:5] and len(eskf) == 15
    eskf.open("lever_arm", sigma=[0.5, 0.4, 0.3])
    eskf.open("gyro_scale", sigma=1e-3, tau_s=1e4)
    assert list(eskf.blocks)[5:] == ["lever_arm", "gyro_scale"] and len(eskf) == 21
    assert eskf.blocks["lever_arm"] == slice(15, 18, 1) and BLOCKS["lever_arm"] == (3, "m")
    np.testing.assert_allclose(eskf.sigma("lever_arm"), [0.5, 0.4, 0.3])
    eskf.propagate(DT, *moved())
    p = eskf.covariance
    b = eskf.blocks
    assert np.array_equal(eskf.covariance_of("attitude", "lever_arm"), p[b["attitude"], b["lever_arm"]])
    assert eskf.sigma("heading") == np.sqrt(p[8, 8])

    # Derivatives by the new states, as those by the old ones.
    measure, r = MEASUREMENTS["gnss_velocity"]
    h = sensitivity(eskf, measure)
    assert np.abs(h[:, b["lever_arm"]]).max() > 0.1
    s = h @ p @ h.T + r
    k = np.linalg.solve(s, h @ p).T
    before = copy.deepcopy(eskf)
    measure(eskf, None)
    assert apart(eskf.covariance, turned(eskf, p - k @ s @ k.T, before.local(eskf))) < 1e-5
    found = eskf.nominal.lever_arm_b
    assert np.abs(found).max() > 0

    eskf.close("lever_arm")
    assert list(eskf.blocks)[5:] == ["gyro_scale"] and np.array_equal(eskf.nominal.lever_arm_b, found)
    eskf.set_calibration(lever_arm_b=[0.1, 0.2, 0.3], clock_offset=0.01)
    assert list(eskf.nominal.lever_arm_b) == [0.1, 0.2, 0.3] and eskf.nominal.clock_offset == 0.01


def test_priors_and_widening() -> None:
    eskf = make()
    eskf.propagate(DT, *moved())
    p = eskf.covariance
    eskf.widen("velocity", 0.5 * np.eye(3))
    np.testing.assert_array_equal(eskf.covariance_of("velocity"), p[3:6, 3:6] + 0.5 * np.eye(3))
    eskf.set_prior("velocity", np.diag([1.0, 2.0, 3.0]))
    assert np.array_equal(eskf.covariance_of("velocity"), np.diag([1.0, 2.0, 3.0])) and not eskf.covariance_of("velocity", "attitude").any()
    rng = np.random.default_rng(4)
    root = rng.normal(size=(9, 9))
    eskf.set_joint_prior(root @ root.T)
    np.testing.assert_allclose(eskf.covariance[6:, 6:], root @ root.T, rtol=1e-14)
    eskf.set_covariance(p)
    assert np.array_equal(eskf.covariance, p)
    eskf.bridge(2.0, 0.1, 1.0)
    added = np.diag(eskf.covariance - p)
    np.testing.assert_allclose(added[:9], [4.0] * 3 + [4.0] * 3 + [0.04] * 3, rtol=1e-9)
    eskf.forget_velocity(0.1)
    assert np.array_equal(eskf.sigma("velocity"), np.full(3, 0.1))


def test_priors_that_are_no_covariances_are_refused() -> None:
    """By name, and the filter stays as it was; what is one but for rounding is taken."""
    eskf = Eskf(NavState.from_degrees(50.0, 14.0, 300.0), "consumer", position_sigma=10.0, velocity_sigma=1.0, attitude_sigma=0.1)
    before = eskf.covariance
    joint = np.diag([1e-2] * 3 + [-1e-13] * 3 + [1e-4] * 3)
    calls: list[tuple[Callable[[], None], str]] = [
        (lambda: eskf.set_prior("position", -np.eye(3)), "prior"),
        (lambda: eskf.set_prior("position", np.full((3, 3), 2.0) - np.eye(3)), "prior"),
        (lambda: eskf.set_prior("velocity", np.triu(np.ones((3, 3)))), "prior"),
        (lambda: eskf.widen("position", -5 * np.eye(3)), "extra"),
        # Small beside the other states, and a variance below zero all the same.
        (lambda: eskf.set_joint_prior(joint), "joint"),
    ]
    for call, argument in calls:
        with pytest.raises(insnav.ArgumentError) as caught:
            call()
        assert (caught.value.code, caught.value.argument) == ("not_a_covariance", argument)
        assert np.array_equal(eskf.covariance, before)
    # One direction alone: no variance in the others, which rounding may have below zero.
    direction = np.array([1.0, 1e-3, 7.0])
    once = np.outer(direction, direction) * 1e-8
    once[0, 1] *= 1 + 1e-15
    eskf.widen("position", once)
    eskf.set_prior("velocity", np.zeros((3, 3)))
    eskf.set_joint_prior(np.abs(joint))
    assert np.allclose(eskf.sigma("position")[2], np.hypot(10.0, 7e-4))


def test_what_is_held_comes_back_whole() -> None:
    eskf = make()
    eskf.propagate(DT, *moved())
    p = eskf.covariance
    with pytest.raises(insnav.InsnavError, match="hold_heading"):
        eskf.update_held_heading(sigma=0.01)
    eskf.hold_heading()
    assert list(eskf.blocks)[5:] == ["held_heading"] and len(eskf) == 16
    np.testing.assert_allclose(eskf.base_covariance, p, rtol=1e-12, atol=0)
    assert eskf.sigma("heading") == pytest.approx(np.sqrt(p[8, 8]))
    eskf.propagate_standing(DT, np.zeros(3), [0.0, 0.0, -9.81 * DT])
    # A heading that is held shows what has come since, not what it was worth before.
    told = eskf.update_held_heading(sigma=1e-3)
    assert told.sigma[0] < 0.01 < eskf.sigma("heading")
    eskf.release_heading()
    assert len(eskf) == 15 and eskf.sigma("heading") == pytest.approx(np.sqrt(p[8, 8]), rel=1e-3)
    eskf.hold_attitude()
    eskf.update_held_attitude(sigma=1e-3)
    eskf.release_attitude()
    eskf.stay(10.0, attitude_walk=1e-5)
    assert not eskf.state.velocity_n.any() and eskf.time_s == pytest.approx(1.01 + 10.0)


def test_rows_one_by_one_are_the_whole_to_the_last_bit() -> None:
    r, v = moved(300)
    whole, parts = make(), make()
    whole.open("accel_scale", sigma=1e-3)
    parts.open("accel_scale", sigma=1e-3)
    for f in (whole, parts):
        f.update_zero_velocity(sigma=3.0)
    whole.propagate(np.full(300, DT), r, v)
    for k, (a, b) in enumerate(zip(r, v, strict=True)):
        parts.propagate(DT, a.tolist(), tuple(b))
        if k % 100 == 50:
            # Saved and resumed in the middle; NaN, infinities and -0.0 are in it as they are.
            again = pickle.loads(pickle.dumps(parts))
            assert pickle.dumps(again) == pickle.dumps(parts) == pickle.dumps(copy.deepcopy(parts))
            parts = again
    assert pickle.dumps(parts) == pickle.dumps(whole)
    assert np.array_equal(parts.covariance, whole.covariance) and parts.state == whole.state


def test_other_threads_run_meanwhile() -> None:
    r, v = moved(1)
    eskf, n = make(), 400_000
    steps_r, steps_v = np.repeat(r, n, axis=0), np.repeat(v, n, axis=0)
    turns = 0

    def propagate() -> None:
        eskf.propagate(1e-4, steps_r * 0.01, steps_v * 0.01)

    worker = threading.Thread(target=propagate)
    worker.start()
    while worker.is_alive():
        turns += 1
        worker.join(0.001)
    assert turns > 20


make_of: Any = Eskf


@pytest.mark.parametrize(
    ("call", "argument", "part"),
    [
        (lambda f: f.propagate(0.01, [0, 0, np.nan], [0, 0, 0]), "rotation_b", "finite"),
        (lambda f: f.propagate(0.01, np.zeros((2, 3)), np.zeros((3, 3))), "velocity_b", "(3,) rows, expected (2,) rows"),
        (lambda f: f.propagate(-0.01, np.zeros(3), np.zeros(3)), "dt", "not negative"),
        (lambda f: f.update_zero_velocity(sigma=0.0), "sigma", "above 0"),
        (lambda f: f.update_gnss_position([0.8, 0.2, 0.0]), "sigma, covariance", "one of the two"),
        (lambda f: f.update_gnss_position([50.0, 14.0, 300.0], sigma=1.0), "position", "radians"),
        (lambda f: f.update_linear("x", np.zeros(4), {}, np.eye(4)), "residual", "(1,), (2,) or (3,)"),
        (lambda f: f.update_linear("x", [0.0], {"lever_arm": np.zeros(3)}, 1.0), "h", "one of the open blocks"),
        (lambda f: f.update_linear("x", [0.0, 1.0], {"velocity": np.zeros((3, 2))}, np.eye(2)), "h[\"velocity\"]", "expected (2, 3)"),
        (lambda f: f.open("velocity", sigma=1.0), "block", "one of the optional blocks"),
        (lambda f: f.open("mounting", sigma=np.ones(3)), "sigma", "a number or (2,)"),
        (lambda f: f.covariance_of("speed"), "rows", "position, velocity"),
        (lambda f: f.retract(np.zeros(14)), "dx", "expected (15,)"),
        (lambda f: make_of(f.state, "cheap", position_sigma=1, velocity_sigma=1, attitude_sigma=1), "noise", "one of consumer"),
        (lambda f: make(attitude_sigma=[1.0, 2.0]), "attitude_sigma", "a number or (3,)"),
    ],
)
def test_errors_name_the_argument(call: Any, argument: str, part: str) -> None:
    eskf = make()
    before = pickle.dumps(eskf)
    with pytest.raises(insnav.ArgumentError) as caught:
        call(eskf)
    assert caught.value.argument == argument and part in caught.value.message
    assert pickle.dumps(eskf) == before


def test_an_impossible_covariance_is_told_with_time_and_measurement() -> None:
    eskf = make()
    eskf.propagate(0.5, np.zeros(3), [0.0, 0.0, -9.81 * 0.5])
    with pytest.raises(insnav.ArgumentError, match="covariance: a variance of -1"):
        eskf.update_gnss_velocity([9.0, 4.0, 0.0], covariance=-10 * np.eye(3))
    # Of what is known exactly an exact measurement says nothing.
    eskf.set_covariance(np.zeros_like(eskf.covariance))
    with pytest.raises(insnav.NavigationError) as caught:
        eskf.update_gnss_velocity([9.0, 4.0, 0.0], covariance=np.zeros((3, 3)))
    assert caught.value.measurement == "gnss_velocity" and caught.value.time_s == 0.5


def test_noise_is_a_value() -> None:
    unit = ImuNoise.of_grade("tactical")
    # 0.05 °/√h, 0.03 m/s/√h, 3 °/h, 1 mg.
    assert unit.gyro_white == pytest.approx(np.radians(0.05) / 60) and unit.accel_white == pytest.approx(0.03 / 60)
    assert unit.gyro_bias_sigma == pytest.approx(np.radians(3.0) / 3600) and unit.accel_bias_sigma == pytest.approx(9.80665e-3)
    assert make().noise == ImuNoise.of_grade("industrial")
    constant = ImuNoise(0.0, 0.0, 1e-4, 0.01, np.inf, np.inf)
    eskf = Eskf(make().state, constant, position_sigma=1.0, velocity_sigma=0.1, attitude_sigma=0.01, gyro_bias=[1e-3, 0.0, 0.0])
    eskf.propagate(1.0, [1e-3, 0.0, 0.0], np.zeros(3))
    assert np.array_equal(eskf.sigma("gyro_bias"), np.full(3, 1e-4))
    # The bias is taken out of what is measured.
    assert attitude.log(attitude.multiply(make().state.q_nb, attitude.inverse(eskf.state.q_nb))) @ [1, 1, 1] == pytest.approx(0, abs=3e-4)
