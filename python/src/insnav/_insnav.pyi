import datetime as dt
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, ClassVar, Final, Literal, TypeAlias, final, overload

import numpy as np
import pandas
import polars
from numpy.typing import ArrayLike, NDArray

from insnav._align import Alignment, HeadingAlignment, StartAlignment
from insnav._arrays import Arrays, Config as _Config, Start
from insnav._attitude import AttitudeEpoch, Attitudes
from insnav._compare import Comparison
from insnav._filter import Grade, ImuNoise, Nominal, Update
from insnav._mechanization import Increments, Trajectory
from insnav._navigator import Event
from insnav._noise import AllanDeviation, AllanFit, Estimate, RestStability
from insnav._recording import Recording
from insnav._sim import Simulation, Truth
from insnav._solution import Epoch, Solution
from insnav._stationary import Statistic, StopIntervals

__all__ = [
    "AttitudeFilter",
    "BLOCKS",
    "ChannelDesign",
    "Design",
    "EARTH_RATE",
    "ECCENTRICITY_SQUARED",
    "Eskf",
    "FLATTENING",
    "ForgettingProcessNoise",
    "Gate",
    "LagAccumulator",
    "LocalFrame",
    "MohamedSchwarz",
    "NavState",
    "Navigator",
    "Orientation",
    "Record",
    "SCENARIO_EXAMPLE",
    "SEMI_MAJOR_AXIS",
    "SEMI_MINOR_AXIS",
    "Scenario",
    "StopDetector",
    "__version__",
    "ahrs",
    "align_by_stops",
    "align_stops",
    "als_design",
    "als_estimate",
    "als_estimate_ltv",
    "als_solve",
    "angle_sigmas_deg",
    "belokurov2018",
    "command",
    "compare",
    "detect_stops",
    "detector_statistic",
    "earth_rate_n",
    "exp",
    "fit_allan",
    "from_dcm",
    "from_ecef",
    "from_euler",
    "gauss_markov",
    "given_settings",
    "gravity",
    "gravity_gradient",
    "identify_noise",
    "increments",
    "increments_of_sums",
    "inverse",
    "kozadaev2017",
    "lag_covariance",
    "left_jacobian",
    "level",
    "lobusov2014",
    "log",
    "magnetic_start",
    "mdm_estimate",
    "mechanize",
    "meridian_radius",
    "moving_base_start",
    "multiply",
    "ned_to_ecef",
    "noise_from_data_sheet",
    "noise_of_grade",
    "offset",
    "offset_to",
    "overlapping_allan",
    "quantile_of_squares",
    "read_mcap",
    "read_solution",
    "rest_stability",
    "rotate",
    "run",
    "run_start",
    "skew",
    "to_dcm",
    "to_ecef",
    "to_euler",
    "transport_rate_n",
    "transverse_radius",
    "white_noise",
    "wrap_angle",
    "write_mcap",
]

__version__: Final[str]

def command(arguments: list[str]) -> int: ...

_Column: TypeAlias = NDArray[np.float64]
_Form: TypeAlias = Literal["diagonal", "symmetric"]
_Basis: TypeAlias = _Form | Mapping[Literal["Q", "R"], _Form | Sequence[Sequence[int]] | NDArray[np.floating[Any]] | None]
_Weight: TypeAlias = Literal["bartlett", "identity"]
_Constraint: TypeAlias = Literal["nonnegative", "psd", "none"]

# The navigator, step by step.

_Kind: TypeAlias = Literal["imu", "imu_increment", "gnss_position", "gnss_velocity", "heading", "standstill", "speed", "magnetic_field"]

@final
class Navigator:
    def __new__(
        cls,
        config: _Config | None = None,
        *,
        noise: Grade | ImuNoise | None = None,
        start: Start | Mapping[str, Any] | None = None,
        t0_ns: int = 0,
        keep: bool = True,
    ) -> Navigator: ...
    @staticmethod
    def from_toml(
        text: str,
        *,
        noise: Grade | ImuNoise | None = None,
        start: Start | Mapping[str, Any] | None = None,
        t0_ns: int = 0,
        keep: bool = True,
    ) -> Navigator: ...
    def step_imu(
        self, time_s: _Instant, angular_rate_b_rad_per_s: ArrayLike, specific_force_b_m_per_s2: ArrayLike, /
    ) -> None: ...
    def step_imu_increment(self, time_s: _Instant, angle_b_rad: ArrayLike, velocity_b_m_per_s: ArrayLike, /) -> None: ...
    def step_gnss_position(
        self, time_s: _Instant, latitude_deg_longitude_deg_height_m: ArrayLike, sigma_n_m: ArrayLike | None = None, /
    ) -> None: ...
    def step_gnss_velocity(
        self, time_s: _Instant, velocity_n_m_per_s: ArrayLike, sigma_n_m_per_s: ArrayLike | None = None, /
    ) -> None: ...
    def step_heading(self, time_s: _Instant, heading_deg: float, sigma_deg: float, /) -> None: ...
    def step_standstill(self, time_s: _Instant, standing: bool, /) -> None: ...
    def step_speed(self, time_s: _Instant, speed_m_per_s: float, /) -> None: ...
    def step_magnetic_field(self, time_s: _Instant, field_b_tesla: ArrayLike, /) -> None: ...
    def step(self, kind: _Kind, /, *columns: Any) -> None: ...
    def batch(self, arrays: Arrays | Mapping[str, Any]) -> None: ...
    def finish(self) -> None: ...
    @property
    def started(self) -> bool: ...
    @property
    def epoch(self) -> Epoch | None: ...
    def latest(self) -> NavState | None: ...
    @property
    def filter(self) -> Eskf | None: ...
    @property
    def gnss_sigma_scale(self) -> tuple[float, float]: ...
    @property
    def gnss_velocity_sigma_scale(self) -> tuple[float, float]: ...
    def take(self) -> Solution: ...
    def take_events(self) -> list[Event]: ...

# The filter: insnav.filter.

BLOCKS: Final[dict[str, tuple[int, str]]]

_Block: TypeAlias = Literal[
    "position", "velocity", "attitude", "gyro_bias", "accel_bias", "held_heading", "gnss_colour", "gyro_scale", "accel_scale",
    "lever_arm", "mounting", "odometer_scale", "clock_offset", "axle", "held_attitude",
]  # fmt: skip
_Bookkeeping: TypeAlias = Literal["exact", "variance_only"]

def noise_of_grade(grade: Grade) -> ImuNoise: ...
def noise_from_data_sheet(
    gyro_arw_deg_per_sqrt_hour: float,
    accel_vrw_m_per_s_per_sqrt_hour: float,
    gyro_bias_deg_per_hour: float,
    accel_bias_mg: float,
    *,
    gyro_bias_tau_s: float = 20000.0,
    accel_bias_tau_s: float = 20000.0,
) -> ImuNoise: ...
@final
class Gate:
    def __new__(cls, limit: tuple[float, float, float] | None = None, *, patience: int = 10) -> Gate: ...
    @staticmethod
    def open() -> Gate: ...
    @staticmethod
    def closed() -> Gate: ...
    @staticmethod
    def lenient() -> Gate: ...
    @staticmethod
    def strict() -> Gate: ...
    @property
    def limit(self) -> tuple[float, float, float]: ...
    @property
    def patience(self) -> int: ...

@final
class Eskf:
    def __new__(
        cls,
        start: NavState,
        noise: Grade | ImuNoise,
        *,
        position_sigma: ArrayLike,
        velocity_sigma: ArrayLike,
        attitude_sigma: ArrayLike,
        gyro_bias: ArrayLike = (0.0, 0.0, 0.0),
        accel_bias: ArrayLike = (0.0, 0.0, 0.0),
        gyro_bias_sigma: ArrayLike | None = None,
        accel_bias_sigma: ArrayLike | None = None,
        gyro_scale: ArrayLike = (0.0, 0.0, 0.0),
        accel_scale: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Eskf: ...
    @property
    def nominal(self) -> Nominal: ...
    @property
    def state(self) -> NavState: ...
    @property
    def time_s(self) -> float: ...
    @property
    def noise(self) -> ImuNoise: ...
    @property
    def covariance(self) -> _Column: ...
    @property
    def base_covariance(self) -> _Column: ...
    @property
    def blocks(self) -> dict[str, slice]: ...
    def __len__(self) -> int: ...
    def covariance_of(self, rows: _Block, columns: _Block | None = None) -> _Column: ...
    @overload
    def sigma(self, name: Literal["heading"]) -> float: ...
    @overload
    def sigma(self, name: _Block) -> _Column: ...
    def propagate(self, dt: ArrayLike, rotation_b: ArrayLike, velocity_b: ArrayLike) -> None: ...
    def propagate_standing(
        self, dt: ArrayLike, rotation_b: ArrayLike, velocity_b: ArrayLike, *, force: Literal["gravity", "measured"] = "gravity"
    ) -> None: ...
    def stay(self, dt: float, *, attitude_walk: float = 0.0, position_walk: float = 0.0) -> None: ...
    def bridge(self, dt: float, rate_sigma: float, force_sigma: float) -> None: ...
    def update_gnss_position(
        self,
        position: ArrayLike,
        *,
        sigma: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        lever_arm_b: ArrayLike = (0.0, 0.0, 0.0),
        dependence: float = 1.0,
        position_alone: bool = False,
        time_s: _Instant | None = None,
        gate: Gate | None = None,
    ) -> Update: ...
    def update_gnss_velocity(
        self,
        velocity_n: ArrayLike,
        *,
        sigma: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        lever_arm_b: ArrayLike = (0.0, 0.0, 0.0),
        time_s: _Instant | None = None,
        gate: Gate | None = None,
    ) -> Update: ...
    def update_heading(self, heading: float, *, sigma: float, time_s: _Instant | None = None, gate: Gate | None = None) -> Update: ...
    def update_zero_velocity(self, *, sigma: float, time_s: _Instant | None = None, gate: Gate | None = None) -> Update: ...
    def update_zero_heading_rate(
        self,
        dt: float,
        *,
        sigma: float | None = None,
        gain: Literal["correlated", "naive", "bias_only"] = "correlated",
        time_s: _Instant | None = None,
        gate: Gate | None = None,
    ) -> Update: ...
    def update_held_heading(
        self, *, sigma: float, row: Literal["down", "euler"] = "down", time_s: _Instant | None = None, gate: Gate | None = None
    ) -> Update: ...
    def update_held_attitude(self, *, sigma: float, time_s: _Instant | None = None, gate: Gate | None = None) -> Update: ...
    def update_nonholonomic(
        self,
        *,
        sigma: float,
        axle_b: ArrayLike = (0.0, 0.0, 0.0),
        lateral_only: bool = False,
        time_s: _Instant | None = None,
        gate: Gate | None = None,
    ) -> Update: ...
    def update_standing_force(
        self, specific_force_b: ArrayLike, *, sigma: float, time_s: _Instant | None = None, gate: Gate | None = None
    ) -> Update: ...
    def update_standing_rate(
        self,
        angular_rate_b: ArrayLike,
        *,
        sigma: ArrayLike,
        earth_rate_tells: bool = True,
        time_s: _Instant | None = None,
        gate: Gate | None = None,
    ) -> Update: ...
    def update_linear(
        self,
        name: str,
        residual: ArrayLike,
        h: Mapping[str, ArrayLike],
        r: ArrayLike,
        *,
        time_s: _Instant | None = None,
        gate: Gate | None = None,
    ) -> Update: ...
    def open(self, block: _Block, *, sigma: ArrayLike, tau_s: float | None = None) -> None: ...
    def close(self, block: _Block) -> None: ...
    def widen(self, block: _Block, extra: ArrayLike) -> None: ...
    def set_prior(self, block: _Block, prior: ArrayLike) -> None: ...
    def set_joint_prior(self, joint: ArrayLike) -> None: ...
    def set_covariance(self, covariance: ArrayLike) -> None: ...
    def set_calibration(
        self,
        *,
        lever_arm_b: ArrayLike | None = None,
        mounting: Sequence[float] | None = None,
        gnss_colour_n: ArrayLike | None = None,
        axle_forward: float | None = None,
        odometer_scale: float | None = None,
        clock_offset: float | None = None,
    ) -> None: ...
    def hold_heading(self, bookkeeping: _Bookkeeping = "exact") -> None: ...
    def release_heading(self, bookkeeping: _Bookkeeping = "exact") -> None: ...
    def hold_attitude(self) -> None: ...
    def release_attitude(self) -> None: ...
    def forget_velocity(self, sigma: float) -> None: ...
    def retract(self, dx: ArrayLike) -> None: ...
    def local(self, truth: Eskf) -> _Column: ...

# Geometry: insnav.attitude, insnav.earth, insnav.mechanization.

EARTH_RATE: Final[float]
ECCENTRICITY_SQUARED: Final[float]
FLATTENING: Final[float]
SEMI_MAJOR_AXIS: Final[float]
SEMI_MINOR_AXIS: Final[float]

_Instant: TypeAlias = float | np.datetime64 | dt.datetime

def exp(rotation: ArrayLike) -> _Column: ...
def log(q: ArrayLike) -> _Column: ...
def left_jacobian(rotation: ArrayLike) -> _Column: ...
def skew(v: ArrayLike) -> _Column: ...
def from_euler(euler: ArrayLike) -> _Column: ...
def to_euler(q: ArrayLike) -> _Column: ...
def from_dcm(dcm: ArrayLike) -> _Column: ...
def to_dcm(q: ArrayLike) -> _Column: ...
def multiply(a: ArrayLike, b: ArrayLike) -> _Column: ...
def inverse(q: ArrayLike) -> _Column: ...
def rotate(q: ArrayLike, v: ArrayLike) -> _Column: ...
@overload
def wrap_angle(angle: float) -> float: ...
@overload
def wrap_angle(angle: ArrayLike) -> _Column: ...
@overload
def meridian_radius(latitude: float) -> float: ...
@overload
def meridian_radius(latitude: ArrayLike) -> _Column: ...
@overload
def transverse_radius(latitude: float) -> float: ...
@overload
def transverse_radius(latitude: ArrayLike) -> _Column: ...
@overload
def gravity(latitude: float, height: float = 0.0) -> float: ...
@overload
def gravity(latitude: ArrayLike, height: ArrayLike = 0.0) -> _Column: ...
@overload
def gravity_gradient(latitude: float, height: float = 0.0) -> tuple[float, float]: ...
@overload
def gravity_gradient(latitude: ArrayLike, height: ArrayLike = 0.0) -> tuple[_Column, _Column]: ...
def earth_rate_n(latitude: ArrayLike) -> _Column: ...
def transport_rate_n(position: ArrayLike, velocity_n: ArrayLike) -> _Column: ...
def to_ecef(position: ArrayLike) -> _Column: ...
def from_ecef(r_e: ArrayLike) -> _Column: ...
def ned_to_ecef(position: ArrayLike) -> _Column: ...
def offset(position: ArrayLike, dp_n: ArrayLike) -> _Column: ...
def offset_to(position: ArrayLike, other: ArrayLike) -> _Column: ...
@final
class LocalFrame:
    def __new__(cls, origin: ArrayLike) -> LocalFrame: ...
    @property
    def origin(self) -> _Column: ...
    def to_ned(self, position: ArrayLike) -> _Column: ...
    def to_geodetic(self, ned: ArrayLike) -> _Column: ...
    def rotation_from(self, position: ArrayLike) -> _Column: ...

@final
class NavState:
    __hash__: ClassVar[None]  # type: ignore[assignment]
    def __new__(cls, position: ArrayLike, velocity_n: ArrayLike, q_nb: ArrayLike, *, time_s: _Instant = 0.0) -> NavState: ...
    @staticmethod
    def from_degrees(
        latitude_deg: float,
        longitude_deg: float,
        height_m: float,
        velocity_n_m_per_s: ArrayLike = (0.0, 0.0, 0.0),
        *,
        roll_deg: float = 0.0,
        pitch_deg: float = 0.0,
        heading_deg: float = 0.0,
        time_s: _Instant = 0.0,
    ) -> NavState: ...
    @property
    def time_s(self) -> float: ...
    @property
    def time_ns(self) -> int: ...
    @property
    def position(self) -> _Column: ...
    @property
    def velocity_n(self) -> _Column: ...
    @property
    def q_nb(self) -> _Column: ...
    @property
    def euler(self) -> _Column: ...
    def advance(self, dt: float, rotation_b: ArrayLike, velocity_b: ArrayLike) -> NavState: ...
    def __eq__(self, value: object, /) -> bool: ...

def increments(time_s: ArrayLike, angular_rate_b: ArrayLike, specific_force_b: ArrayLike) -> Increments: ...
def increments_of_sums(time_s: ArrayLike, angle_b: ArrayLike, velocity_b: ArrayLike) -> Increments: ...
def mechanize(start: NavState, dt: ArrayLike, rotation_b: ArrayLike, velocity_b: ArrayLike) -> Trajectory: ...

def run(
    log: str | PathLike[str] | Arrays | Mapping[str, Any],
    config: _Config | None = None,
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
def given_settings(config: _Config | None) -> dict[str, Any]: ...

def angle_sigmas_deg(pitch_deg: ArrayLike, heading_deg: ArrayLike, attitude_covariance_n_rad2: ArrayLike) -> _Column: ...
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
    def __reduce__(self) -> tuple[Any, ...]: ...
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
class AttitudeFilter:
    def __new__(
        cls,
        config: _Config | None = None,
        *,
        settings: Mapping[str, Any] | None = None,
        gyro_range_deg_per_s: float | None = None,
        carrier_speed_m_per_s: float | None = None,
    ) -> AttitudeFilter: ...
    def step(self, t: _Instant, gyro: ArrayLike, accel: ArrayLike, mag: ArrayLike | None = None) -> AttitudeEpoch | None: ...
    def field(self, t: _Instant, mag: ArrayLike) -> None: ...
    def run(
        self, t: ArrayLike, gyro: ArrayLike, accel: ArrayLike, mag: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None
    ) -> Attitudes: ...
    def smooth(
        self, t: ArrayLike, gyro: ArrayLike, accel: ArrayLike, mag: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None
    ) -> Attitudes: ...
    @property
    def state(self) -> dict[str, _Column]: ...
    @property
    def covariance(self) -> _Column: ...
    @property
    def blocks(self) -> dict[str, slice]: ...
    @property
    def settings(self) -> dict[str, Any]: ...
    @property
    def field_changes(self) -> int: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class Record:
    def __new__(cls, t: ArrayLike, gyro: ArrayLike, accel: ArrayLike, *, increments: bool = False) -> Record: ...
    @property
    def span_s(self) -> tuple[float, float] | None: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

def align_by_stops(
    log: str | PathLike[str] | Arrays | Mapping[str, Any],
    config: _Config | None = None,
    *,
    method: str = "auto",
    stops: ArrayLike | None = None,
    latitude_deg: float | None = None,
    heading_deg: float | None = None,
    heading_sigma_deg: float | None = None,
    max_azimuth_sigma_deg: float = 5.0,
    topics: Mapping[str, str] | None = None,
    imu_axes: Literal["flu", "frd"] | None = None,
    time_source: Literal["header", "log", "publish"] | None = None,
) -> Alignment: ...
def align_stops(
    record: Record,
    stops: ArrayLike,
    *,
    latitude_deg: float,
    config: _Config,
    method: str = "auto",
    height_m: float = 0.0,
    heading_deg: float | None = None,
    heading_sigma_deg: float | None = None,
    max_azimuth_sigma_deg: float = 5.0,
    gyro_scale_sigma_ppm: float = 10.0,
    taper: Literal["none", "hann_squared"] | None = None,
    paper_vertical: bool = True,
) -> Alignment: ...
def level(specific_force_b: ArrayLike) -> tuple[Any, Any]: ...
def run_start(arrays: Arrays | Mapping[str, Any], config: _Config | None = None) -> StartAlignment: ...
def magnetic_start(
    t: ArrayLike,
    gyro: ArrayLike,
    accel: ArrayLike,
    mag: ArrayLike | tuple[ArrayLike, ArrayLike],
    *,
    declination_deg: float = 0.0,
    sigma_deg: float = 15.0,
    gyro_bias_rad_per_s: ArrayLike | None = None,
    config: _Config | None = None,
) -> HeadingAlignment | None: ...
def moving_base_start(
    arrays: Arrays | Mapping[str, Any],
    *,
    latitude_deg: float,
    config: _Config,
    height_m: float = 0.0,
    gyro_bias_rad_per_s: ArrayLike | None = None,
    sigma_gyro_bias_rad_per_s: float | None = None,
) -> HeadingAlignment | None: ...

@final
class Design:
    @property
    def matrix(self) -> _Column: ...
    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def lags(self) -> int: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class LagAccumulator:
    def __new__(cls, channels: int, lags: int, *, retention: float = 1.0) -> LagAccumulator: ...
    def step(self, nu: ArrayLike) -> None: ...
    def run(self, nu: ArrayLike) -> None: ...
    def end_run(self) -> None: ...
    def merge(self, other: LagAccumulator) -> None: ...
    @property
    def covariance(self) -> _Column: ...
    @property
    def counts(self) -> _Column: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class MohamedSchwarz:
    def __new__(cls, channels: int, window: int) -> MohamedSchwarz: ...
    def step(self, nu: ArrayLike) -> None: ...
    def run(self, nu: ArrayLike) -> _Column: ...
    @property
    def covariance(self) -> _Column | None: ...
    def process_noise(self, L: ArrayLike) -> _Column | None: ...
    def measurement_noise(self, H: ArrayLike, P: ArrayLike) -> _Column | None: ...
    def measurement_noise_of_residuals(self, H: ArrayLike, P: ArrayLike) -> _Column | None: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class ForgettingProcessNoise:
    def __new__(cls, Q: ArrayLike, *, retention: float = 0.3) -> ForgettingProcessNoise: ...
    def step(self, L: ArrayLike, nu: ArrayLike) -> None: ...
    def run(self, L: ArrayLike, nu: ArrayLike) -> _Column: ...
    @property
    def Q(self) -> _Column: ...
    @property
    def retention(self) -> float: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class ChannelDesign:
    def __new__(cls, F: ArrayLike, H: ArrayLike, L: ArrayLike, *, lags: int = 64) -> ChannelDesign: ...
    @property
    def matrix(self) -> _Column: ...
    def covariances(self, theta: ArrayLike) -> _Column: ...
    def solve(
        self, C: ArrayLike, known: tuple[float | None, float | None, float | None] | None = None
    ) -> _Column: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

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
def rest_stability(t: ArrayLike, gyro: ArrayLike, accel: ArrayLike) -> RestStability: ...
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

def compare(
    solution: Solution | str | PathLike[str] | Mapping[str, Any] | pandas.DataFrame | polars.DataFrame,
    reference: Truth | Solution | str | PathLike[str] | Mapping[str, Any] | pandas.DataFrame | polars.DataFrame,
    *,
    from_s: float | None = None,
    to_s: float | None = None,
    reference_clock: Literal["gnss", "imu"] = "gnss",
    remove_mounting: bool = False,
    align_earth: bool = False,
    course: bool = False,
    withheld: str | None = None,
    reference_at_antenna: bool | None = None,
) -> Comparison: ...

def read_mcap(
    path: str | PathLike[str],
    *,
    topics: Mapping[str, str] | None = None,
    imu_axes: Literal["flu", "frd"] | None = None,
    time_source: Literal["header", "log", "publish"] | None = None,
    config: _Config | None = None,
) -> Recording: ...
def read_solution(path: str | PathLike[str]) -> Solution: ...
def write_mcap(
    path: str | PathLike[str], data: Arrays | Mapping[str, Any] | Simulation, *, overwrite: bool = False
) -> None: ...

SCENARIO_EXAMPLE: Final[str]

@final
class Scenario:
    @staticmethod
    def standing(duration_s: float, heading_deg: float = 0.0) -> Scenario: ...
    @staticmethod
    def car_drive(duration_s: float) -> Scenario: ...
    @staticmethod
    def demo() -> Scenario: ...
    @staticmethod
    def from_toml(source: str | PathLike[str]) -> Scenario: ...
    @staticmethod
    def from_dict(mapping: Mapping[str, Any]) -> Scenario: ...
    def to_toml(self) -> str: ...
    def to_dict(self) -> dict[str, Any]: ...
    def replace(self, **parts: Any) -> Scenario: ...
    @property
    def duration_s(self) -> float: ...
    @property
    def seed(self) -> int | None: ...
    def simulate(self, seed: int | None = None, *, truth_rate_hz: float = 10.0) -> Simulation: ...
    def truth_at(self, time_s: ArrayLike, seed: int | None = None) -> Truth: ...
    def start(
        self,
        *,
        sigma_position_n_m: ArrayLike = 0.1,
        sigma_velocity_n_m_per_s: ArrayLike = 0.02,
        sigma_attitude_n_deg: ArrayLike = 0.1,
        seed: int | None = None,
    ) -> dict[str, _Column]: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

def kozadaev2017(
    runs: int | None = None,
    *,
    seed: int = 1,
    imu: str | PathLike[str] | None = None,
    multi_stop: bool = False,
    jobs: int | None = None,
) -> dict[str, Any]: ...
def lobusov2014(
    runs: int | None = None, *, seed: int = 1, drive: bool = False, jobs: int | None = None
) -> dict[str, Any]: ...
def belokurov2018(
    runs: int | None = None, *, seed: int = 1, imu: str | PathLike[str] | None = None, jobs: int | None = None
) -> dict[str, Any]: ...
def white_noise(count: int, seed: int, *, stream: str = "initial") -> _Column: ...
def gauss_markov(
    count: int,
    step_s: float,
    *,
    sigma: ArrayLike,
    tau_s: float,
    seed: int,
    initial_sigma: ArrayLike | None = None,
    stream: str = "initial",
) -> _Column: ...
@final
class StopDetector:
    def __new__(cls, config: _Config | None = None, *, gnss: bool = False) -> StopDetector: ...
    def step(self, t: _Instant, gyro: ArrayLike, accel: ArrayLike) -> None: ...
    def gnss_velocity(self, t: _Instant, velocity_n_m_per_s: ArrayLike, sigma_n_m_per_s: ArrayLike | None = None) -> None: ...
    def speed(self, t: _Instant, speed_m_per_s: float) -> None: ...
    def standstill(self, t: _Instant, standing: bool) -> None: ...
    def believe(
        self,
        *,
        rate_b_rad_per_s: ArrayLike | None = None,
        rate_covariance_b_rad2_per_s2: ArrayLike | None = None,
        velocity_n_m_per_s: ArrayLike | None = None,
        velocity_covariance_n_m2_per_s2: ArrayLike | None = None,
    ) -> None: ...
    @property
    def standing_since_s(self) -> float | None: ...
    @property
    def witness(self) -> Literal["nobody", "detector", "declared", "interval"]: ...
    @property
    def ratios(self) -> _Column: ...
    @property
    def rocks(self) -> bool: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

def detect_stops(
    arrays: Arrays | Mapping[str, Any],
    config: _Config | None = None,
    *,
    rate_b_rad_per_s: ArrayLike | None = None,
    sigma_rate_rad_per_s: float | None = None,
) -> StopIntervals: ...
def detector_statistic(
    detector: Literal["mv", "mag", "are", "glrt"],
    step_s: float,
    gyro: ArrayLike | None,
    accel: ArrayLike | None,
    *,
    window_s: float,
    config: _Config | None = None,
    stance: bool = False,
    expected_rate_b_rad_per_s: ArrayLike | None = None,
    sigma_rate_rad_per_s: float | None = None,
    normal_quantile: float = 3.090,
) -> Statistic: ...
def quantile_of_squares(mean: float, variance: float, normal_quantile: float) -> float: ...
