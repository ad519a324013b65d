"""`insnav.earth`, `insnav.attitude` and `insnav.mechanization` against published numbers, identities and formulas of numpy."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulation import Drive, drive

import insnav
from insnav import attitude, earth, mechanization
from insnav.mechanization import NavState

Array = NDArray[np.float64]


def positions(n: int = 200, seed: int = 1) -> Array:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-1.5, 1.5, n), rng.uniform(-np.pi, np.pi, n), rng.uniform(-1e3, 2e4, n)])


def vectors(scale: float, n: int = 200, seed: int = 2) -> Array:
    return np.random.default_rng(seed).normal(0, scale, (n, 3))


# The Earth


def test_no_fix_is_refused_by_its_row() -> None:
    # What receivers give for it, and places near it, of which a latitude beyond 90 degrees came.
    good = earth.to_ecef(positions(3))
    for bad in ([0.0, 0.0, 0.0], [1000.0, 0.0, 1000.0], [-2e4, 3e4, 1e4]):
        with pytest.raises(insnav.ArgumentError, match="r_e: .* in row 2, expected positions 50 km and more") as caught:
            earth.from_ecef(np.vstack([good[:2], [bad], good[2:]]))
        assert caught.value.code == "bad_value" and "without a fix" in str(caught.value.remedy)
        with pytest.raises(insnav.ArgumentError, match="expected positions 50 km"):
            earth.from_ecef(bad)
    with pytest.raises(insnav.ArgumentError, match="50 km and more from the Earth's centre"):
        earth.LocalFrame([0.0, 0.0, 0.0]).to_geodetic([0.0, 0.0, earth.SEMI_MAJOR_AXIS])
    # Where there is a latitude, it is one: down to 50 km from the centre, in every direction.
    rng = np.random.default_rng(5)
    deep = rng.normal(size=(20_000, 3))
    deep *= rng.uniform(50.001e3, 6e6, 20_000)[:, None] / np.linalg.norm(deep, axis=1)[:, None]
    assert np.abs(earth.from_ecef(deep)[:, 0]).max() <= np.pi / 2


def test_offset_goes_on_beyond_the_date_line() -> None:
    for side in (1.0, -1.0):
        at = np.array([0.5, side * (np.pi - 1e-6), 0.0])
        dp = np.array([3.0, side * 100.0, -2.0])
        there = earth.offset(at, dp)
        # East of the line is west of the map, a whole turn away.
        expected = at[1] + dp[1] / (earth.transverse_radius(0.5) * np.cos(0.5)) - side * 2 * np.pi
        assert abs(there[1] - expected) < 1e-15 and abs(there[1]) < np.pi
        assert np.abs(earth.offset_to(at, there) - dp).max() < 1e-8


def test_gravity_has_its_published_values() -> None:
    # [WGS84] table 3.4: equator, pole, and the mean of both hemispheres by its series; to the last published digit.
    assert earth.gravity(0.0) == pytest.approx(9.7803253359, abs=1e-10)
    assert earth.gravity(np.pi / 2) == pytest.approx(9.8321849378, abs=1e-10)
    assert earth.gravity(-np.pi / 2) == earth.gravity(np.pi / 2)
    # Written apart: Somigliana and free air.
    latitude, height = np.radians(np.linspace(-90, 90, 37)), 4000.0
    s2 = np.sin(latitude) ** 2
    f, a, m = earth.FLATTENING, earth.SEMI_MAJOR_AXIS, 0.00344978650684
    surface = 9.7803253359 * (1 + 0.00193185265241 * s2) / np.sqrt(1 - earth.ECCENTRICITY_SQUARED * s2)
    there = surface * (1 - 2 * (1 + f + m - 2 * f * s2) * height / a + 3 * (height / a) ** 2)
    np.testing.assert_allclose(earth.gravity(latitude, height), there, rtol=4e-16)
    by_latitude, by_height = earth.gravity_gradient(latitude, height)
    step = 1e-5
    slope = (earth.gravity(latitude[1:-1] + step, height) - earth.gravity(latitude[1:-1] - step, height)) / (2 * step)
    np.testing.assert_allclose(by_latitude[1:-1], slope, atol=1e-9)  # rounding of 9.8 m/s² over the step
    fall = (earth.gravity(latitude, height + 100) - earth.gravity(latitude, height - 100)) / 200
    np.testing.assert_allclose(by_height, fall, atol=1e-15)


def test_radii_have_their_closed_forms() -> None:
    a, b = earth.SEMI_MAJOR_AXIS, earth.SEMI_MINOR_AXIS
    assert earth.meridian_radius(0.0) == pytest.approx(b * b / a, rel=1e-15)
    assert earth.transverse_radius(0.0) == a
    assert earth.meridian_radius(np.pi / 2) == pytest.approx(a * a / b, rel=1e-15)
    assert earth.transverse_radius(np.pi / 2) == pytest.approx(a * a / b, rel=1e-15)


def test_positions_go_there_and_back() -> None:
    p = positions()
    r = earth.to_ecef(p)
    # The textbook's formula, written apart.
    n = earth.transverse_radius(p[:, 0]) + p[:, 2]
    z = (n - earth.ECCENTRICITY_SQUARED * earth.transverse_radius(p[:, 0])) * np.sin(p[:, 0])
    x, y = n * np.cos(p[:, 0]) * np.cos(p[:, 1]), n * np.cos(p[:, 0]) * np.sin(p[:, 1])
    np.testing.assert_allclose(r, np.column_stack([x, y, z]), atol=4e-9)  # last digits of 6.4e6 m
    np.testing.assert_allclose((earth.from_ecef(r) - p) * [6.4e6, 6.4e6, 1], 0, atol=1e-8)

    d = vectors(20.0)
    np.testing.assert_allclose(earth.offset_to(p, earth.offset(p, d)), d, atol=2e-8)
    frame = earth.LocalFrame(p[0])
    ned = vectors(1e4)
    np.testing.assert_allclose(frame.to_ned(frame.to_geodetic(ned)), ned, atol=1e-7)
    c = earth.ned_to_ecef(p)
    np.testing.assert_allclose(np.einsum("kji,kjl->kil", c, c), np.tile(np.eye(3), (len(p), 1, 1)), atol=1e-15)
    there = np.einsum("ji,kj->ki", c[0], earth.to_ecef(p[1:3]) - r[0])
    np.testing.assert_allclose(frame.to_ned(p[1:3]), there, rtol=1e-15, atol=1e-8)
    np.testing.assert_allclose(frame.rotation_from(p[1]), c[0].T @ c[1], atol=1e-15)
    again = pickle.loads(pickle.dumps(frame))
    assert np.array_equal(again.to_ned(p), frame.to_ned(p)) and np.array_equal(again.origin, p[0])


def test_the_frame_turns_as_the_position_moves() -> None:
    p, v = positions(), vectors(100.0)
    keep = np.abs(p[:, 0]) < 1.4
    p, v = p[keep], v[keep]
    rate = earth.transport_rate_n(p, v)
    dt = 1e-2
    moved = earth.offset(p, v * dt)
    # C_en(t + dt) = C_en(t) Exp(ω_en dt), to first order.
    turn = np.einsum("kji,kjl->kil", earth.ned_to_ecef(p), earth.ned_to_ecef(moved))
    log = attitude.log(attitude.from_dcm(turn))
    np.testing.assert_allclose(log / dt, rate, atol=2e-9)  # 1e-16 over dt, and (ω dt)² of the step
    i = earth.earth_rate_n(p[:, 0])
    np.testing.assert_allclose(np.linalg.norm(i, axis=1), earth.EARTH_RATE, rtol=1e-15)
    assert earth.EARTH_RATE == 7.292115e-5 and (i[:, 1] == 0).all()


# Attitude


def test_exp_and_log_are_inverse() -> None:
    r = np.vstack([vectors(1.0), vectors(1e-9, 20), np.zeros((1, 3))])
    r = r[np.linalg.norm(r, axis=1) < 3.1]
    q = attitude.exp(r)
    np.testing.assert_allclose(attitude.log(q), r, atol=1e-14)
    # Rodrigues, written apart.
    angle = np.linalg.norm(r, axis=1)[:, None, None]
    s = np.array([[[0, -z, y], [z, 0, -x], [-y, x, 0]] for x, y, z in r])
    with np.errstate(invalid="ignore"):
        c = np.eye(3) + np.sinc(angle / np.pi) * s + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * s @ s
    np.testing.assert_allclose(attitude.to_dcm(q), c, atol=4e-15)
    np.testing.assert_allclose(attitude.skew(r), s, atol=0)
    # Of the group: there and back again is nothing, of many turns the same.
    back = attitude.multiply(attitude.inverse(q), q)
    np.testing.assert_allclose(back, np.tile([1.0, 0, 0, 0], (len(r), 1)), atol=4e-16)
    np.testing.assert_allclose(attitude.inverse(q), attitude.exp(-r), atol=4e-16)


def test_left_jacobian_is_the_mean_rotation() -> None:
    r = vectors(1.0, 20)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    s = (nodes + 1) / 2
    mean = sum(w / 2 * attitude.to_dcm(attitude.exp(r * x)) for x, w in zip(s, weights, strict=True))
    np.testing.assert_allclose(attitude.left_jacobian(r), mean, atol=1e-14)


def test_euler_angles_turn_the_right_way() -> None:
    rng = np.random.default_rng(3)
    e = np.column_stack([rng.uniform(-3.1, 3.1, 100), rng.uniform(-1.5, 1.5, 100), rng.uniform(-3.1, 3.1, 100)])
    q = attitude.from_euler(e)
    np.testing.assert_allclose(attitude.to_euler(q), e, atol=1e-12)
    roll, pitch, heading = e[0]

    def about(axis: int, angle: float) -> Array:
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        c = np.eye(3)
        c[[i, j], [i, j]] = np.cos(angle)
        c[i, j], c[j, i] = -np.sin(angle), np.sin(angle)
        return c

    np.testing.assert_allclose(attitude.to_dcm(q[0]), about(2, heading) @ about(1, pitch) @ about(0, roll), atol=1e-15)
    np.testing.assert_allclose(np.abs(np.sum(attitude.from_dcm(attitude.to_dcm(q)) * q, axis=1)), 1, atol=1e-15)
    v = vectors(1.0, 100)
    np.testing.assert_allclose(attitude.rotate(q, v), np.einsum("kij,kj->ki", attitude.to_dcm(q), v), atol=2e-15)
    # Heading 90° looks east.
    np.testing.assert_allclose(attitude.rotate(attitude.from_euler([0, 0, np.pi / 2]), [1, 0, 0]), [0, 1, 0], atol=1e-15)
    assert attitude.wrap_angle(-np.pi) == np.pi and attitude.wrap_angle(7.0) == pytest.approx(7 - 2 * np.pi)
    np.testing.assert_allclose(attitude.to_dcm(3 * q), attitude.to_dcm(q), atol=1e-15)


# Rows and shapes


def test_one_row_gives_one_row_and_more_axes_stay() -> None:
    r = vectors(1.0, 12).reshape(3, 4, 3)
    q = attitude.exp(r)
    assert q.shape == (3, 4, 4)
    assert np.array_equal(q[1, 2], attitude.exp(r[1, 2]))
    assert isinstance(earth.gravity(0.5), float)
    assert earth.gravity(np.full((2, 3), 0.5), 100.0).shape == (2, 3)
    assert attitude.rotate(q[0, 0], r).shape == (3, 4, 3)
    assert attitude.exp(np.empty((0, 3))).shape == (0, 4)
    # Whatever numpy takes, and however it lies.
    tilted = np.asfortranarray(r[:, 0].astype(np.float32))
    assert np.array_equal(attitude.exp(tilted), attitude.exp(tilted.astype(np.float64).tolist()))
    assert np.array_equal(attitude.exp(r[::2, ::-1]), q[::2, ::-1])


@pytest.mark.parametrize(
    ("call", "argument", "received", "expected"),
    [
        (lambda: attitude.exp([1.0, 2.0]), "rotation", "shape (2,)", "(n, 3) or (3,)"),
        (lambda: attitude.rotate(np.ones((2, 4)), np.ones((3, 3))), "v", "(3,) rows", "(2,) rows as in `q`"),
        (lambda: attitude.log(np.zeros(4)), "q", "[0.0, 0.0, 0.0, 0.0]", "other than zero"),
        (lambda: attitude.to_dcm([np.nan, 0, 0, 1]), "q", "NaN", "other than zero"),
        (lambda: attitude.from_dcm(np.diag([1.0, 1.0, -1.0])), "dcm", "[1.0", "orthogonal"),
        (lambda: earth.gravity(50.0), "latitude", "50", "radians"),
        (lambda: earth.to_ecef([[0.1, 0.2, 0.3], [50.0, 14.0, 300.0]]), "position", "in row 1", "in radians"),
        (lambda: mechanization.increments([0.0, 1.0], np.ones((2, 3)), np.ones((1, 3))), "specific_force_b", "[1] rows", "(2, 3)"),
        (lambda: NavState.from_degrees(91.0, 0.0, 0.0), "latitude_deg", "91", "a latitude up to 90"),
        (lambda: NavState([1, 0, 0], [0, 0, 0], np.ones((2, 4))), "q_nb", "2 rows", "one row, (4,)"),
        (lambda: NavState.from_degrees(50.0, 0.0, 0.0).advance(-1.0, [0, 0, 0], [0, 0, 0]), "dt", "-1", "not negative"),
        (lambda: NavState.from_degrees(50.0, 0.0, 0.0, time_s=np.nan), "time_s", "nan", "finite time"),
    ],
)
def test_errors_name_the_argument(call: Any, argument: str, received: str, expected: str) -> None:
    with pytest.raises(insnav.InsnavError) as caught:
        call()
    assert argument in caught.value.message and received in caught.value.message and expected in caught.value.message


# Strapdown


@pytest.fixture(scope="module")
def truth() -> Drive:
    return drive(60.0)


def start_of(truth: Drive) -> NavState:
    return NavState.from_degrees(
        truth.latitude_deg[0], truth.longitude_deg[0], truth.height_m, truth.velocity_n_m_per_s[0], heading_deg=truth.heading_deg[0]
    )


def test_the_way_of_the_drive_is_found_again(truth: Drive) -> None:
    steps = mechanization.increments(truth.time_s, truth.angular_rate_b_rad_per_s, truth.specific_force_b_m_per_s2)
    way = mechanization.mechanize(start_of(truth), steps.dt, steps.rotation_b, steps.velocity_b)
    assert len(way) == len(truth.time_s) - 1
    np.testing.assert_allclose(way.time_s, truth.time_s[1:], atol=1e-9)
    # The drive's own path is a trapezoid of its velocity, off by v̈ dt² T/12 < 12 m/s (2π/40)² 1e-4 60/12 = 1.5e-4 m.
    np.testing.assert_allclose(np.degrees(way.latitude), truth.latitude_deg[1:], atol=2e-9)
    np.testing.assert_allclose(np.degrees(way.longitude), truth.longitude_deg[1:], atol=3e-9)
    np.testing.assert_allclose(way.velocity_n, truth.velocity_n_m_per_s[1:], atol=1e-4)
    heading = np.degrees(attitude.to_euler(way.q_nb)[:, 2]) % 360
    # Rates linear in between are off by dt²/12 times the change of the turn's acceleration: 1e-4/12 * 2 * 1.2 (2π/40)² rad = 2.83e-5°.
    np.testing.assert_allclose(heading, truth.heading_deg[1:], rtol=0, atol=2.9e-5)

    # Row by row the same to the last bit; and a wrong sign of the Earth's rate would be seen.
    state = start_of(truth)
    for dt, r, v in zip(steps.dt[:200], steps.rotation_b, steps.velocity_b, strict=False):
        state = state.advance(float(dt), r, v)
    for name in ["position", "velocity_n", "q_nb", "time_ns"]:
        assert np.array_equal(getattr(state, name), getattr(way, name)[199]), name
    e = -2 * earth.earth_rate_n(np.radians(50.0)) * 0.01
    wrong = mechanization.mechanize(start_of(truth), steps.dt, steps.rotation_b + e, steps.velocity_b)
    assert np.abs(wrong.velocity_n - truth.velocity_n_m_per_s[1:]).max() > 0.1


def test_coning_and_sculling_are_in_the_increments() -> None:
    # Rates linear in time over two samples: the second-order terms are exact (Savage 1998, eq. 47).
    w, f, dt = vectors(1.0, 2, 5), vectors(5.0, 2, 6), 0.02
    one = mechanization.increments([0.0, dt], w, f)
    plain = (w[0] + w[1]) * dt / 2
    np.testing.assert_allclose(one.rotation_b[0], plain + np.cross(w[0], w[1]) * dt**2 / 12, rtol=1e-14)
    sculling = (np.cross(w[0], f[1]) + np.cross(f[0], w[1])) * dt**2 / 12
    np.testing.assert_allclose(one.velocity_b[0], (f[0] + f[1]) * dt / 2 + sculling, rtol=1e-14)
    # A unit that integrates over both halves of a longer ramp tells the same.
    ramp = [w[0] + (w[1] - w[0]) * x for x in np.linspace(0, 2, 3)]
    force = [f[0] + (f[1] - f[0]) * x for x in np.linspace(0, 2, 3)]
    sums = [[(a + b) * dt / 2 for a, b in zip(x, x[1:], strict=False)] for x in (ramp, force)]
    t = np.arange(3) * dt
    angles, velocities = (np.vstack([np.zeros(3), s]) for s in sums)
    of_sums = mechanization.increments_of_sums(t, angles, velocities)
    of_rates = mechanization.increments(t, ramp, force)
    np.testing.assert_allclose(of_sums.rotation_b[1], of_rates.rotation_b[1], rtol=1e-13)
    np.testing.assert_allclose(of_sums.velocity_b[1], of_rates.velocity_b[1], rtol=1e-13)


def test_states_are_values() -> None:
    stamp = np.datetime64("2024-05-01T12:00:00.123456789")
    state = NavState([0.8, 0.2, 300.0], [1.0, 2.0, -0.0], [1.0, 0.1, 0.2, 0.3], time_s=stamp)
    assert state.time_ns == int(stamp.astype("int64"))
    for again in [pickle.loads(pickle.dumps(state)), copy.copy(state), copy.deepcopy(state)]:
        assert again == state and np.signbit(again.velocity_n[2])
        assert again.q_nb.tobytes() == state.q_nb.tobytes()
    assert state != state.advance(0.01, np.zeros(3), np.zeros(3))
    with pytest.raises(AttributeError):
        state.position = np.zeros(3)  # type: ignore[misc]
