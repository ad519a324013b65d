from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Final, Literal, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from insnav._arrays import Arrays, Start
from insnav._noise import AllanDeviation, AllanFit, Estimate

__all__ = [
    "Design",
    "Orientation",
    "Solution",
    "__version__",
    "ahrs",
    "als_design",
    "als_estimate",
    "als_estimate_ltv",
    "als_solve",
    "fit_allan",
    "identify_noise",
    "lag_covariance",
    "mdm_estimate",
    "overlapping_allan",
    "run",
]

__version__: Final[str]

_Column: TypeAlias = NDArray[np.float64]
_Config: TypeAlias = Mapping[str, Any] | str | PathLike[str]
_Form: TypeAlias = Literal["diagonal", "symmetric"]
_Basis: TypeAlias = _Form | Mapping[Literal["Q", "R"], _Form | Sequence[Sequence[int]] | NDArray[np.floating[Any]] | None]
_Weight: TypeAlias = Literal["bartlett", "identity"]
_Constraint: TypeAlias = Literal["nonnegative", "psd", "none"]

def run(
    log: str | PathLike[str] | Arrays | Mapping[str, Any],
    config: Mapping[str, Any] | str | PathLike[str] | None = None,
    *,
    output: str | PathLike[str] | None = None,
    overwrite: bool = False,
    time_offset_s: float | Literal["auto"] | None = None,
    withhold: str | None = None,
    imu_only: bool = False,
    start: Start | Mapping[str, Any] | None = None,
    topics: Mapping[str, str] | None = None,
    imu_axes: Literal["flu", "frd"] | None = None,
    time_source: Literal["header", "log", "publish"] | None = None,
) -> Solution: ...
@final
class Solution:
    def __len__(self) -> int: ...
    @property
    def summary(self) -> dict[str, Any]: ...
    @property
    def t0_ns(self) -> int: ...
    @property
    def time_s(self) -> _Column: ...
    @property
    def time_ns(self) -> NDArray[np.int64]: ...
    @property
    def latitude_deg(self) -> _Column: ...
    @property
    def longitude_deg(self) -> _Column: ...
    @property
    def height_m(self) -> _Column: ...
    @property
    def velocity_n_m_per_s(self) -> _Column: ...
    @property
    def quaternion_nb_wxyz(self) -> _Column: ...
    @property
    def roll_deg(self) -> _Column: ...
    @property
    def pitch_deg(self) -> _Column: ...
    @property
    def heading_deg(self) -> _Column: ...
    @property
    def rate_b_deg_per_s(self) -> _Column: ...
    @property
    def gyro_bias_deg_per_hour(self) -> _Column: ...
    @property
    def accel_bias_mg(self) -> _Column: ...
    @property
    def sigma_position_n_m(self) -> _Column: ...
    @property
    def sigma_velocity_n_m_per_s(self) -> _Column: ...
    @property
    def sigma_attitude_n_deg(self) -> _Column: ...
    @property
    def sigma_gyro_bias_deg_per_hour(self) -> _Column: ...
    @property
    def sigma_accel_bias_mg(self) -> _Column: ...
    @property
    def position_covariance_n_m2(self) -> _Column: ...
    @property
    def velocity_covariance_n_m2_per_s2(self) -> _Column: ...
    @property
    def attitude_covariance_n_rad2(self) -> _Column: ...
    @property
    def standing(self) -> NDArray[np.bool_]: ...
    @property
    def standing_s(self) -> _Column: ...
    @property
    def stop_ratios(self) -> _Column: ...

def ahrs(
    t: ArrayLike,
    gyro: ArrayLike,
    accel: ArrayLike,
    mag: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    *,
    smooth: bool = False,
    noise: Literal["auto", "datasheet"] = "auto",
    config: _Config | None = None,
    gyro_range_deg_per_s: float | Literal["auto"] | None = "auto",
    carrier_speed_m_per_s: float | None = None,
) -> Orientation: ...
@final
class Orientation:
    def __len__(self) -> int: ...
    @property
    def summary(self) -> dict[str, Any]: ...
    @property
    def time_s(self) -> _Column: ...
    @property
    def time_ns(self) -> NDArray[np.int64]: ...
    @property
    def quaternion_nb_wxyz(self) -> _Column: ...
    @property
    def roll_deg(self) -> _Column: ...
    @property
    def pitch_deg(self) -> _Column: ...
    @property
    def heading_deg(self) -> _Column: ...
    @property
    def attitude_covariance_n_rad2(self) -> _Column: ...
    @property
    def sigma_attitude_n_deg(self) -> _Column: ...

@final
class Design:
    @property
    def matrix(self) -> _Column: ...
    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def lags(self) -> int: ...

def lag_covariance(nu: ArrayLike, lags: int, runs: ArrayLike | None = None) -> tuple[_Column, _Column]: ...
def als_design(
    F: ArrayLike, G: ArrayLike, H: ArrayLike, L: ArrayLike, basis: _Basis | None = None, lags: int = 64
) -> Design: ...
def als_solve(
    design: Design,
    C: ArrayLike,
    counts: ArrayLike,
    *,
    weight: _Weight = "bartlett",
    constraint: _Constraint = "nonnegative",
    known: dict[str, float] | None = None,
    reweights: int = 2,
    least_independent: float = 10.0,
    trace_penalty: float = 0.0,
) -> Estimate: ...
def als_estimate(
    y: ArrayLike,
    F: ArrayLike,
    G: ArrayLike,
    H: ArrayLike,
    start: ArrayLike,
    *,
    basis: _Basis | None = None,
    lags: int = 64,
    rounds: int = 3,
    skip: int = 0,
    runs: ArrayLike | None = None,
    gain: ArrayLike | None = None,
    hold_unidentified: bool = True,
    weight: _Weight = "bartlett",
    constraint: _Constraint = "nonnegative",
    known: dict[str, float] | None = None,
    reweights: int = 2,
    least_independent: float = 10.0,
    trace_penalty: float = 0.0,
) -> Estimate: ...
def als_estimate_ltv(
    F: ArrayLike,
    G: ArrayLike,
    H: ArrayLike,
    L: ArrayLike,
    nu: ArrayLike,
    P0: ArrayLike,
    *,
    basis: _Basis | None = None,
    lags: int = 64,
    weight: _Weight = "bartlett",
    constraint: _Constraint = "nonnegative",
    known: dict[str, float] | None = None,
    reweights: int = 2,
    least_independent: float = 10.0,
    trace_penalty: float = 0.0,
) -> Estimate: ...
def mdm_estimate(
    y: ArrayLike,
    F: ArrayLike,
    G: ArrayLike,
    H: ArrayLike,
    *,
    basis: _Basis | None = None,
    span: int = 50,
    reweights: int = 3,
    known: dict[str, float] | None = None,
    runs: ArrayLike | None = None,
) -> Estimate: ...
def overlapping_allan(x: ArrayLike, step_s: float, samples: Sequence[int] | None = None) -> AllanDeviation: ...
def fit_allan(deviation: AllanDeviation) -> AllanFit: ...
def identify_noise(
    t: ArrayLike,
    gyro: ArrayLike,
    accel: ArrayLike,
    mag: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    *,
    config: _Config | None = None,
    window_s: float | None = None,
    part_s: tuple[float, float] | None = None,
) -> dict[str, Any]: ...
