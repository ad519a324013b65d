"""Alignment: attitude, heading and sensor drifts before there is a solution.

:func:`by_stops` finds all of it from the stops of a log or of arrays, as the command ``insnav align`` does, and chooses the method. For
studies there is a :class:`Record` of inertial data, and each method as a function of it: :func:`levelling`, :func:`two_vector`,
:func:`coarse`, :func:`gyrocompass`, :func:`fine`, :func:`multi_position`, :func:`joint`, :func:`kalman`, :func:`paper`, :func:`zupt2`
(:func:`zupt1` is the joint regression). :func:`start` says what a run would begin with (course, antennas, moving base, …);
:func:`moving_base`, :func:`magnetic` and :func:`level` are sources of that, one at a time.

Axes are forward-right-down and north-east-down, heading is clockwise from true north. Angles are in degrees, rates and biases in SI
units. A method that cannot give what it is asked for raises :class:`insnav.AlignmentError`, with the numbers that show why.

Examples
--------
A body at rest at 60° north whose forward axis looks 40° east of north, seen by gyros that feel the Earth turn:

>>> import numpy as np
>>> from insnav import align
>>> rate_n = 7.292115e-5 * np.array([np.cos(np.pi / 3), 0.0, -np.sin(np.pi / 3)])
>>> c, s = np.cos(np.radians(40)), np.sin(np.radians(40))
>>> rate_b = np.array([c * rate_n[0], -s * rate_n[0], rate_n[2]])
>>> t = np.arange(0, 120, 0.01)
>>> record = align.Record(t, np.tile(rate_b, (len(t), 1)), np.tile([0.0, 0.0, -9.819], (len(t), 1)))
>>> found = align.coarse(record, [(0, 119)], latitude_deg=60.0, config={"imu": {"grade": "navigation"}})
>>> round(found.heading_deg, 2)
40.0
"""

from __future__ import annotations

from typing import Literal

from numpy.typing import ArrayLike

from insnav._align import Alignment, AlignmentStop, HeadingAlignment, StartAlignment
from insnav._arrays import Config as _Config
from insnav._insnav import Record, align_stops as align
from insnav._insnav import align_by_stops as by_stops
from insnav._insnav import level
from insnav._insnav import magnetic_start as magnetic
from insnav._insnav import moving_base_start as moving_base
from insnav._insnav import run_start as start

__all__ = [
    "Alignment",
    "AlignmentStop",
    "HeadingAlignment",
    "Record",
    "StartAlignment",
    "align",
    "by_stops",
    "coarse",
    "fine",
    "gyrocompass",
    "joint",
    "kalman",
    "level",
    "levelling",
    "magnetic",
    "moving_base",
    "multi_position",
    "paper",
    "start",
    "two_vector",
    "zupt1",
    "zupt2",
]


def levelling(
    record: Record,
    stops: ArrayLike,
    *,
    latitude_deg: float,
    config: _Config,
    height_m: float = 0.0,
    heading_deg: float | None = None,
    heading_sigma_deg: float | None = None,
    max_azimuth_sigma_deg: float = 5.0,
    gyro_scale_sigma_ppm: float = 10.0,
) -> Alignment:
    """Roll and pitch from gravity in the last stop; the mean rate is taken for the gyro bias. Heading only as told.

    Parameters
    ----------
    record : Record
        Inertial data.
    stops : (k, 2)
        Begin and end of each stop, s, on the scale of the record's stamps.
    latitude_deg : float
        Geodetic latitude, north positive.
    config : mapping or path
        What the unit is worth, as of :func:`align`.
    height_m : float, default 0
        Height above the ellipsoid: gravity follows from it.
    heading_deg, heading_sigma_deg : float, optional
        Heading of the forward axis at the first stop's begin from true north, and its standard deviation.
    max_azimuth_sigma_deg : float, default 5
        The azimuth is called unobservable when its standard deviation would be larger.
    gyro_scale_sigma_ppm : float, default 10
        Standard deviation of the gyros' scale factors; acts in turns between stops.

    Returns
    -------
    Alignment
        Of the end of the last stop.

    Raises
    ------
    AlignmentError
        As of :func:`align`.
    """
    return align(
        record,
        stops,
        method="levelling",
        latitude_deg=latitude_deg,
        config=config,
        height_m=height_m,
        heading_deg=heading_deg,
        heading_sigma_deg=heading_sigma_deg,
        max_azimuth_sigma_deg=max_azimuth_sigma_deg,
        gyro_scale_sigma_ppm=gyro_scale_sigma_ppm,
    )


def two_vector(
    record: Record,
    stops: ArrayLike,
    *,
    latitude_deg: float,
    config: _Config,
    height_m: float = 0.0,
    max_azimuth_sigma_deg: float = 5.0,
) -> Alignment:
    """Gravity and the mean rate as two vectors, in the last stop.

    Parameters
    ----------
    record : Record
        Inertial data.
    stops : (k, 2)
        Begin and end of each stop, s, on the scale of the record's stamps.
    latitude_deg : float
        Geodetic latitude, north positive.
    config : mapping or path
        What the unit is worth, as of :func:`align`.
    height_m : float, default 0
        Height above the ellipsoid: gravity follows from it.
    max_azimuth_sigma_deg : float, default 5
        The azimuth is called unobservable when its standard deviation would be larger.

    Returns
    -------
    Alignment
        Of the end of the last stop.

    Raises
    ------
    AlignmentError
        As of :func:`align`.
    """
    return align(
        record,
        stops,
        method="two_vector",
        latitude_deg=latitude_deg,
        config=config,
        height_m=height_m,
        max_azimuth_sigma_deg=max_azimuth_sigma_deg,
    )


def coarse(
    record: Record,
    stops: ArrayLike,
    *,
    latitude_deg: float,
    config: _Config,
    height_m: float = 0.0,
    max_azimuth_sigma_deg: float = 5.0,
) -> Alignment:
    """Optimisation-based alignment in the inertial frame ([Wu11]) by the q-method ([Shuster81]), in the last stop.

    Parameters
    ----------
    record : Record
        Inertial data.
    stops : (k, 2)
        Begin and end of each stop, s, on the scale of the record's stamps.
    latitude_deg : float
        Geodetic latitude, north positive.
    config : mapping or path
        What the unit is worth, as of :func:`align`.
    height_m : float, default 0
        Height above the ellipsoid: gravity follows from it.
    max_azimuth_sigma_deg : float, default 5
        The azimuth is called unobservable when its standard deviation would be larger.

    Returns
    -------
    Alignment
        Of the end of the last stop.

    Raises
    ------
    AlignmentError
        As of :func:`align`.
    """
    return align(
        record,
        stops,
        method="coarse",
        latitude_deg=latitude_deg,
        config=config,
        height_m=height_m,
        max_azimuth_sigma_deg=max_azimuth_sigma_deg,
    )


def gyrocompass(
    record: Record,
    stops: ArrayLike,
    *,
    latitude_deg: float,
    config: _Config,
    height_m: float = 0.0,
    max_azimuth_sigma_deg: float = 5.0,
) -> Alignment:
    """A levelling loop of third order, in the last stop.

    Parameters
    ----------
    record : Record
        Inertial data.
    stops : (k, 2)
        Begin and end of each stop, s, on the scale of the record's stamps.
    latitude_deg : float
        Geodetic latitude, north positive.
    config : mapping or path
        What the unit is worth, as of :func:`align`.
    height_m : float, default 0
        Height above the ellipsoid: gravity follows from it.
    max_azimuth_sigma_deg : float, default 5
        The azimuth is called unobservable when its standard deviation would be larger.

    Returns
    -------
    Alignment
        Of the end of the last stop.

    Raises
    ------
    AlignmentError
        As of :func:`align`.
    """
    return align(
        record,
        stops,
        method="gyrocompass",
        latitude_deg=latitude_deg,
        config=config,
        height_m=height_m,
        max_azimuth_sigma_deg=max_azimuth_sigma_deg,
    )


def fine(
    record: Record,
    stops: ArrayLike,
    *,
    latitude_deg: float,
    config: _Config,
    height_m: float = 0.0,
    heading_deg: float | None = None,
    heading_sigma_deg: float | None = None,
    max_azimuth_sigma_deg: float = 5.0,
    gyro_scale_sigma_ppm: float = 10.0,
) -> Alignment:
    """The Kalman filter in the last stop alone.

    Parameters
    ----------
    record : Record
        Inertial data.
    stops : (k, 2)
        Begin and end of each stop, s, on the scale of the record's stamps.
    latitude_deg : float
        Geodetic latitude, north positive.
    config : mapping or path
        What the unit is worth, as of :func:`align`.
    height_m : float, default 0
        Height above the ellipsoid: gravity follows from it.
    heading_deg, heading_sigma_deg : float, optional
        Heading of the forward axis at the first stop's begin from true north, and its standard deviation.
    max_azimuth_sigma_deg : float, default 5
        The azimuth is called unobservable when its standard deviation would be larger.
    gyro_scale_sigma_ppm : float, default 10
        Standard deviation of the gyros' scale factors; acts in turns between stops.

    Returns
    -------
    Alignment
        Of the end of the last stop.

    Raises
    ------
    AlignmentError
        As of :func:`align`.
    """
    return align(
        record,
        stops,
        method="fine",
        latitude_deg=latitude_deg,
        config=config,
        height_m=height_m,
        heading_deg=heading_deg,
        heading_sigma_deg=heading_sigma_deg,
        max_azimuth_sigma_deg=max_azimuth_sigma_deg,
        gyro_scale_sigma_ppm=gyro_scale_sigma_ppm,
    )


def multi_position(
    record: Record,
    stops: ArrayLike,
    *,
    latitude_deg: float,
    config: _Config,
    height_m: float = 0.0,
    heading_deg: float | None = None,
    heading_sigma_deg: float | None = None,
    max_azimuth_sigma_deg: float = 5.0,
    gyro_scale_sigma_ppm: float = 10.0,
    taper: Literal["none", "hann_squared"] | None = None,
) -> Alignment:
    """Two or more stops with turns between them: Kalman filter or joint regression, as the base is quiet or rocks.

    Parameters
    ----------
    record : Record
        Inertial data.
    stops : (k, 2)
        Begin and end of each stop, s, on the scale of the record's stamps.
    latitude_deg : float
        Geodetic latitude, north positive.
    config : mapping or path
        What the unit is worth, as of :func:`align`.
    height_m : float, default 0
        Height above the ellipsoid: gravity follows from it.
    heading_deg, heading_sigma_deg : float, optional
        Heading of the forward axis at the first stop's begin from true north, and its standard deviation.
    max_azimuth_sigma_deg : float, default 5
        The azimuth is called unobservable when its standard deviation would be larger.
    gyro_scale_sigma_ppm : float, default 10
        Standard deviation of the gyros' scale factors; acts in turns between stops.
    taper : {"none", "hann_squared"}, optional
        Weights; without it by what the stops show.

    Returns
    -------
    Alignment
        Of the end of the last stop.

    Raises
    ------
    AlignmentError
        As of :func:`align`.
    """
    return align(
        record,
        stops,
        method="multi_position",
        latitude_deg=latitude_deg,
        config=config,
        height_m=height_m,
        heading_deg=heading_deg,
        heading_sigma_deg=heading_sigma_deg,
        max_azimuth_sigma_deg=max_azimuth_sigma_deg,
        gyro_scale_sigma_ppm=gyro_scale_sigma_ppm,
        taper=taper,
    )


def joint(
    record: Record,
    stops: ArrayLike,
    *,
    latitude_deg: float,
    config: _Config,
    height_m: float = 0.0,
    heading_deg: float | None = None,
    heading_sigma_deg: float | None = None,
    max_azimuth_sigma_deg: float = 5.0,
    gyro_scale_sigma_ppm: float = 10.0,
    taper: Literal["none", "hann_squared"] | None = None,
) -> Alignment:
    """Joint tapered regression of all stops (ZUPT-1J): ZUPT-1 of [Lobusov14] with its model made exact, its rows weighed together.

    Parameters
    ----------
    record : Record
        Inertial data.
    stops : (k, 2)
        Begin and end of each stop, s, on the scale of the record's stamps.
    latitude_deg : float
        Geodetic latitude, north positive.
    config : mapping or path
        What the unit is worth, as of :func:`align`.
    height_m : float, default 0
        Height above the ellipsoid: gravity follows from it.
    heading_deg, heading_sigma_deg : float, optional
        Heading of the forward axis at the first stop's begin from true north, and its standard deviation.
    max_azimuth_sigma_deg : float, default 5
        The azimuth is called unobservable when its standard deviation would be larger.
    gyro_scale_sigma_ppm : float, default 10
        Standard deviation of the gyros' scale factors; acts in turns between stops.
    taper : {"none", "hann_squared"}, optional
        Weights; without it by what the stops show.

    Returns
    -------
    Alignment
        Of the end of the last stop.

    Raises
    ------
    AlignmentError
        As of :func:`align`.
    """
    return align(
        record,
        stops,
        method="joint",
        latitude_deg=latitude_deg,
        config=config,
        height_m=height_m,
        heading_deg=heading_deg,
        heading_sigma_deg=heading_sigma_deg,
        max_azimuth_sigma_deg=max_azimuth_sigma_deg,
        gyro_scale_sigma_ppm=gyro_scale_sigma_ppm,
        taper=taper,
    )


def kalman(
    record: Record,
    stops: ArrayLike,
    *,
    latitude_deg: float,
    config: _Config,
    height_m: float = 0.0,
    heading_deg: float | None = None,
    heading_sigma_deg: float | None = None,
    max_azimuth_sigma_deg: float = 5.0,
    gyro_scale_sigma_ppm: float = 10.0,
) -> Alignment:
    """The Kalman filter over all stops; refused on a base that rocks.

    Parameters
    ----------
    record : Record
        Inertial data.
    stops : (k, 2)
        Begin and end of each stop, s, on the scale of the record's stamps.
    latitude_deg : float
        Geodetic latitude, north positive.
    config : mapping or path
        What the unit is worth, as of :func:`align`.
    height_m : float, default 0
        Height above the ellipsoid: gravity follows from it.
    heading_deg, heading_sigma_deg : float, optional
        Heading of the forward axis at the first stop's begin from true north, and its standard deviation.
    max_azimuth_sigma_deg : float, default 5
        The azimuth is called unobservable when its standard deviation would be larger.
    gyro_scale_sigma_ppm : float, default 10
        Standard deviation of the gyros' scale factors; acts in turns between stops.

    Returns
    -------
    Alignment
        Of the end of the last stop.

    Raises
    ------
    AlignmentError
        As of :func:`align`.
    """
    return align(
        record,
        stops,
        method="kalman",
        latitude_deg=latitude_deg,
        config=config,
        height_m=height_m,
        heading_deg=heading_deg,
        heading_sigma_deg=heading_sigma_deg,
        max_azimuth_sigma_deg=max_azimuth_sigma_deg,
        gyro_scale_sigma_ppm=gyro_scale_sigma_ppm,
    )


def paper(
    record: Record,
    stops: ArrayLike,
    *,
    latitude_deg: float,
    config: _Config,
    height_m: float = 0.0,
    heading_deg: float | None = None,
    heading_sigma_deg: float | None = None,
    max_azimuth_sigma_deg: float = 5.0,
    gyro_scale_sigma_ppm: float = 10.0,
    vertical: bool = True,
) -> Alignment:
    """The explicit equations of [Lobusov14], one stop after the other: as published, for comparison.

    Parameters
    ----------
    record : Record
        Inertial data.
    stops : (k, 2)
        Begin and end of each stop, s, on the scale of the record's stamps.
    latitude_deg : float
        Geodetic latitude, north positive.
    config : mapping or path
        What the unit is worth, as of :func:`align`.
    height_m : float, default 0
        Height above the ellipsoid: gravity follows from it.
    heading_deg, heading_sigma_deg : float, optional
        Heading of the forward axis at the first stop's begin from true north, and its standard deviation.
    max_azimuth_sigma_deg : float, default 5
        The azimuth is called unobservable when its standard deviation would be larger.
    gyro_scale_sigma_ppm : float, default 10
        Standard deviation of the gyros' scale factors; acts in turns between stops.
    vertical : bool, default True
        Use the vertical equation (5); without it the quadratic (9).

    Returns
    -------
    Alignment
        Of the end of the last stop.

    Raises
    ------
    AlignmentError
        As of :func:`align`.
    """
    return align(
        record,
        stops,
        method="paper",
        latitude_deg=latitude_deg,
        config=config,
        height_m=height_m,
        heading_deg=heading_deg,
        heading_sigma_deg=heading_sigma_deg,
        max_azimuth_sigma_deg=max_azimuth_sigma_deg,
        gyro_scale_sigma_ppm=gyro_scale_sigma_ppm,
        paper_vertical=vertical,
    )


def zupt2(
    record: Record,
    stops: ArrayLike,
    *,
    latitude_deg: float,
    config: _Config,
    height_m: float = 0.0,
    heading_deg: float,
    heading_sigma_deg: float,
    max_azimuth_sigma_deg: float = 5.0,
    gyro_scale_sigma_ppm: float = 10.0,
) -> Alignment:
    """Drifts from one stop whose heading is known: ZUPT-2 of [Lobusov14].

    Parameters
    ----------
    record : Record
        Inertial data.
    stops : (k, 2)
        Begin and end of each stop, s, on the scale of the record's stamps.
    latitude_deg : float
        Geodetic latitude, north positive.
    config : mapping or path
        What the unit is worth, as of :func:`align`.
    height_m : float, default 0
        Height above the ellipsoid: gravity follows from it.
    heading_deg, heading_sigma_deg : float
        Heading of the forward axis at the first stop's begin from true north, and its standard deviation.
    max_azimuth_sigma_deg : float, default 5
        The azimuth is called unobservable when its standard deviation would be larger.
    gyro_scale_sigma_ppm : float, default 10
        Standard deviation of the gyros' scale factors; acts in turns between stops.

    Returns
    -------
    Alignment
        Of the end of the last stop.

    Raises
    ------
    AlignmentError
        As of :func:`align`.
    """
    return align(
        record,
        stops,
        method="zupt2",
        latitude_deg=latitude_deg,
        config=config,
        height_m=height_m,
        heading_deg=heading_deg,
        heading_sigma_deg=heading_sigma_deg,
        max_azimuth_sigma_deg=max_azimuth_sigma_deg,
        gyro_scale_sigma_ppm=gyro_scale_sigma_ppm,
    )


#: ZUPT-1: :func:`joint`. As published it is :func:`paper`.
zupt1 = joint
