"""What Q and R does a record show? Noise identification for any linear filter, each number with its standard error.

A filter with a constant gain leaves innovations whose covariances at all lags are linear in Q and R; autocovariance least squares
(ALS) solves for them. :func:`als_estimate` does all of it; its parts are :func:`lag_covariance`, :func:`als_design` and
:func:`als_solve`. For models that change there is :func:`als_estimate_ltv`, without any filter :func:`mdm_estimate`. Of a sensor at rest
:func:`overlapping_allan` and :func:`fit_allan` tell the noise by averaging time, :func:`rest_stability` of all axes of a unit;
:func:`identify_noise` looks at a whole inertial record. :class:`LagAccumulator` sums innovations as they come, :class:`ChannelDesign` is the
design of two states and one measurement in closed form. :class:`MohamedSchwarz` and :class:`ForgettingProcessNoise` are methods to compare
with.

Covariances are per step of the model, in squared units of the model. Arguments are arrays or what ``numpy.asarray`` takes; results
are float64. Errors are :class:`insnav.InsnavError`, a ``ValueError``, and name the argument.
"""

from insnav._insnav import (
    ChannelDesign,
    Design,
    ForgettingProcessNoise,
    LagAccumulator,
    MohamedSchwarz,
    als_design,
    als_estimate,
    als_estimate_ltv,
    als_solve,
    fit_allan,
    identify_noise,
    lag_covariance,
    mdm_estimate,
    overlapping_allan,
    rest_stability,
)
from insnav._noise import AllanDeviation, AllanFit, Estimate, RestStability

__all__ = [
    "AllanDeviation",
    "AllanFit",
    "ChannelDesign",
    "Design",
    "Estimate",
    "ForgettingProcessNoise",
    "LagAccumulator",
    "MohamedSchwarz",
    "RestStability",
    "als_design",
    "als_estimate",
    "als_estimate_ltv",
    "als_solve",
    "fit_allan",
    "identify_noise",
    "lag_covariance",
    "mdm_estimate",
    "overlapping_allan",
    "rest_stability",
]
