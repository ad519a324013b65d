"""The error-state Kalman filter of :func:`insnav.run`, open to the last matrix element: state, covariance, named blocks, own measurements.

In SI units and radians, as in the core. ``n`` is north-east-down, ``b`` is forward-right-down; ``true = estimate ⊞ dx`` with attitude
errors as small rotations in n (``C = Exp(φ_D) Exp(φ_N, φ_E) Ĉ``, to first order ``Exp(φ) Ĉ``),
``residual = measured − predicted ≈ H dx + v``.

``BLOCKS`` has every block of states that there can be: name, and number of states and unit. The first five are always open.
"""

from insnav._filter import ImuNoise, Nominal, Update
from insnav._insnav import BLOCKS, Eskf, Gate

__all__ = ["BLOCKS", "Eskf", "Gate", "ImuNoise", "Nominal", "Update"]
