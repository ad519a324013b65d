"""Bytes that are no longer those that were saved, or are those of another class, are refused: they would be numbers still."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from test_noise import LAGS, F, G, H, L, Q

import insnav
from insnav import align, noise, stationary
from insnav.filter import Eskf, Gate
from insnav.mechanization import NavState


def at_rest(n: int) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(0)
    return np.arange(n) * 0.01, rng.normal(0, 1e-3, (n, 3)), [0.0, 0.0, -9.81] + rng.normal(0, 0.01, (n, 3))


def state() -> NavState:
    return NavState.from_degrees(50.0, 14.0, 300.0, [9.0, 4.0, -0.3], heading_deg=25.0)


def lag_sums() -> noise.LagAccumulator:
    sums = noise.LagAccumulator(2, 4)
    sums.run(np.ones((9, 2)))
    return sums


def window() -> noise.MohamedSchwarz:
    method = noise.MohamedSchwarz(2, 4)
    method.run(np.ones((9, 2)))
    return method


def navigator() -> insnav.Navigator:
    navigator = insnav.Navigator({"imu": {"grade": "industrial"}})
    t, gyro, accel = at_rest(20)
    for k in range(len(t)):
        navigator.step_imu(t[k], gyro[k], accel[k])
    return navigator


def attitude_filter() -> insnav.AttitudeFilter:
    filter = insnav.AttitudeFilter({"imu": {"grade": "consumer"}})
    filter.run(*at_rest(300))
    return filter


#: One of each class that saves the bytes of its state.
MAKES: dict[str, Any] = {
    "Record": lambda: align.Record(*at_rest(30)),
    "LagAccumulator": lag_sums,
    "MohamedSchwarz": window,
    "ForgettingProcessNoise": lambda: noise.ForgettingProcessNoise(Q),
    "ChannelDesign": lambda: noise.ChannelDesign([[1.0, -0.032], [0.0, 0.99]], [1.0, 0.0], [0.3, -0.05], lags=9),
    "Design": lambda: noise.als_design(F, G, H, L, "symmetric", LAGS),
    "NavState": state,
    "Navigator": navigator,
    "StopDetector": stationary.StopDetector,
    "AttitudeFilter": attitude_filter,
    "Orientation": lambda: insnav.ahrs(*at_rest(300), noise="datasheet", config={"imu": {"grade": "consumer"}}),
    "Gate": lambda: Gate(patience=2),
    "Eskf": lambda: Eskf(state(), "industrial", position_sigma=1.0, velocity_sigma=0.1, attitude_sigma=0.01),
}


def saved(name: str) -> tuple[Any, bytes, list[Any]]:
    made = MAKES[name]()
    assert type(made).__name__ == name
    restore, (data, *others) = made.__reduce__()
    # Control: as they were, they are taken, and are the same bytes again.
    assert restore(data, *others).__reduce__()[1][0] == data
    return restore, data, others


@pytest.mark.parametrize("name", MAKES)
def test_a_byte_that_changed_is_refused(name: str) -> None:
    restore, data, others = saved(name)
    # All of the head and the first numbers, then some of all the others.
    places = [*range(min(len(data), 200)), *range(200, len(data), max(len(data) // 200, 1)), len(data) - 1]
    for place in places:
        for flip in (0x01, 0x80, 0xFF):
            changed = bytearray(data)
            changed[place] ^= flip
            with pytest.raises(ValueError, match=f"no state of {name} of insnav"):
                restore(bytes(changed), *others)
    for cut in (b"", data[:-1], data[: len(data) // 2], data + b"\0", data[1:]):
        with pytest.raises(ValueError, match=f"no state of {name} of insnav"):
            restore(cut, *others)


def test_another_classes_bytes_are_refused() -> None:
    all_of_them = {name: saved(name) for name in MAKES}
    for name, (restore, _, others) in all_of_them.items():
        for other, (_, data, _) in all_of_them.items():
            if other != name:
                with pytest.raises(ValueError, match=f'no state of {name} of insnav .*of the class "{other}"'):
                    restore(data, *others)


def test_a_pickle_that_changed_on_disk_is_refused() -> None:
    eskf = MAKES["Eskf"]()
    data = pickle.dumps(eskf)
    longitude = np.float64(eskf.state.position[1]).tobytes()
    at = data.index(longitude)
    changed = data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :]
    with pytest.raises(ValueError, match="bytes were changed"):
        pickle.loads(changed)
