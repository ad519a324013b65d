"""Writes values.json: what other programs say about the quantities that tests/foreign_values.rs checks.

    python3 -m venv venv && venv/bin/pip install -r requirements.txt && venv/bin/python make_values.py

The versions used are written into the file. Angles in degrees, everything else in SI units.
"""

import json
import pathlib

import boule
import numpy as np
import pandas as pd
import pymap3d
import pyproj
import scipy
from pyins import earth, strapdown, transform
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

rng = np.random.default_rng(20240101)


def places(count, height):
    """Corner cases first, then places all over the Earth."""
    fixed = [(0, 0, 0), (90, 0, 0), (-90, 0, 100), (0, 180, 0), (0, -90, -500), (45, 45, 0), (-33.9, 151.2, 58),
             (89.99999, -120, 1000), (1e-7, 1e-7, 0)]
    random = zip(np.degrees(np.arcsin(rng.uniform(-1, 1, count))), rng.uniform(-180, 180, count), height(count))
    return [tuple(map(float, p)) for p in fixed + list(random)]


def ecef():
    to_ecef = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    at = places(60, lambda n: 10 ** rng.uniform(0, 7, n))
    return [{"lat": a, "lon": o, "height": h, "ecef": list(to_ecef.transform(o, a, h))} for a, o, h in at]


def ned():
    rows = []
    for lat, lon, h in places(20, lambda n: rng.uniform(-100, 5000, n))[5:]:
        at = (lat + rng.uniform(-0.3, 0.3) * (abs(lat) < 89), lon + rng.uniform(-0.3, 0.3), h + rng.uniform(-100, 100))
        rows.append({"origin": [lat, lon, h], "at": list(at), "ned": [float(x) for x in pymap3d.geodetic2ned(*at, lat, lon, h)]})
    return rows


def radii():
    rows = []
    for lat in [0, 10, 30, 45, 50.1, 60, 75, 85, 89.9, -20, -70]:
        rows.append({
            "lat": lat,
            "meridian": float(pymap3d.rcurve.meridian(lat)),
            "transverse": float(pymap3d.rcurve.transverse(lat)),
            "pyins_at_1000_m": [float(r) for r in earth.principal_radii(lat, 1000.0)[:2]],
        })
    return rows


def gravity():
    """boule: closed form of the normal field at any height; pyins: Somigliana on the ellipsoid."""
    rows = []
    for lat in [0.0, 15.0, 30.0, 45.0, 50.1, 60.0, 75.0, 90.0, -25.0, -80.0]:
        for h in [0.0, 100.0, 1000.0, 5000.0, 10000.0, 20000.0]:
            milligal = boule.WGS84.normal_gravity((0.0, lat, h))
            row = {"lat": lat, "height": h, "closed_form": float(milligal) * 1e-5}
            if h == 0.0:
                row["pyins"] = float(earth.gravity(lat, 0.0))
            rows.append(row)
    return rows


def rates():
    rows = []
    for _ in range(20):
        lat, h = float(rng.uniform(-85, 85)), float(rng.uniform(-100, 12000))
        v = rng.normal(0, 100, 3)
        rows.append({
            "lat": lat, "height": h, "velocity_n": v.tolist(),
            "transport_rate_n": (earth.curvature_matrix(lat, h) @ v).tolist(),
            "earth_rate_n": earth.rate_n(lat).tolist(),
        })
    return rows


def attitude():
    rows = []
    angles = [(0, 0, 0), (0, 0, 90), (0, 89.9, 0), (180, 0, 0), (10, -89, 200), (-90, 45, -135)]
    angles += [(rng.uniform(-180, 180), rng.uniform(-90, 90), rng.uniform(-180, 180)) for _ in range(30)]
    for roll, pitch, heading in angles:
        r = Rotation.from_euler("ZYX", [heading, pitch, roll], degrees=True)
        assert np.allclose(r.as_matrix(), transform.mat_from_rph([roll, pitch, heading]), atol=1e-15)
        rows.append({"rph": [float(roll), float(pitch), float(heading)], "matrix_nb": r.as_matrix().ravel().tolist()})
    return rows


def rotation_vectors():
    rows = []
    for size in [1e-12, 1e-6, 1e-3, 0.05, 0.0999, 0.1001, 0.5, 1.5, 3.0, 3.14159, 5.0, 9.0]:
        for _ in range(3):
            axis = rng.normal(size=3)
            r = axis / np.linalg.norm(axis) * size
            # The exponential of [[r×, I], [0, 0]] holds Exp(r) and ∫₀¹ Exp(s r) ds side by side.
            m = np.zeros((6, 6))
            m[:3, :3] = [[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]]
            m[:3, 3:] = np.eye(3)
            big = expm(m)
            rotation = Rotation.from_rotvec(r)
            rows.append({
                "rotation_vector": r.tolist(),
                "matrix": rotation.as_matrix().ravel().tolist(),
                "shortest": rotation.as_rotvec().tolist(),
                "left_jacobian": big[:3, 3:].ravel().tolist(),
            })
    return rows


def mechanization():
    """Rates and forces given as sines (the same lines stand in the Rust test), integrated by pyins for 30 s.

    Height stays near zero, where the two programs' gravity is the same; 1 ms, where their orders of approximation meet.
    """
    t = np.arange(30001) * 1e-3
    gyro = np.stack([0.2 * np.sin(1.1 * t), 0.15 * np.sin(0.7 * t + 1.0), 0.3 * np.sin(0.31 * t + 0.2)], axis=1)
    accel = np.stack([1.5 * np.sin(0.9 * t), 1.0 * np.sin(0.5 * t + 0.4), -9.8 + 0.5 * np.sin(1.3 * t)], axis=1)
    imu = pd.DataFrame(np.hstack([gyro, accel]), index=t,
                       columns=["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"])
    start = {"lat": -37.5, "lon": 145.0, "alt": 0.0, "VN": 40.0, "VE": -60.0, "VD": -10.0,
             "roll": 3.0, "pitch": -5.0, "heading": 300.0}
    columns = list(start)
    integrator = strapdown.Integrator(pd.Series(start, name=0.0))
    integrator.integrate(strapdown.compute_increments_from_imu(imu, "rate"))
    end = integrator.get_pva()
    rows = integrator.trajectory
    assert rows.alt.abs().max() < 120.0, rows.alt.describe()
    return {"start": [start[c] for c in columns], "end": [float(end[c]) for c in columns],
            "height_largest": float(rows.alt.abs().max())}


values = {
    "made_with": {
        "python-ins": "1.0.1", "pyproj": pyproj.__version__, "PROJ": pyproj.proj_version_str,
        "pymap3d": pymap3d.__version__, "boule": boule.__version__.lstrip("v"), "scipy": scipy.__version__,
        "numpy": np.__version__,
    },
    "ecef": ecef(), "ned": ned(), "radii": radii(), "gravity": gravity(), "rates": rates(), "attitude": attitude(),
    "rotation_vectors": rotation_vectors(), "mechanization": mechanization(),
}


def lines(value):
    """One row a line: readable differences."""
    parts = []
    for key, rows in value.items():
        if isinstance(rows, list):
            body = ",\n  ".join(json.dumps(row) for row in rows)
            parts.append(f' "{key}": [\n  {body}\n ]')
        else:
            parts.append(f' "{key}": {json.dumps(rows)}')
    return "{\n" + ",\n".join(parts) + "\n}\n"


pathlib.Path(__file__).with_name("values.json").write_text(lines(values))
