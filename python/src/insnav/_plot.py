"""Figures of solutions and of Allan deviations, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insnav._errors import ArgumentError
from insnav._insnav import LocalFrame, angle_sigmas_deg
from insnav._optional import needs

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from insnav._noise import AllanDeviation, AllanFit
    from insnav._solution import Solution

Floats = NDArray[np.float64]

#: Between these lie 95 % of a chi-square variable, 2.5 % on either side, by degrees of freedom ([Abramowitz64] table 26.8).
CHI_SQUARE_95 = {1: (0.000982, 5.02389), 2: (0.050636, 7.37776), 3: (0.215795, 9.34840)}

TIME = "time (s)"
COLOURS = ("C0", "C1", "C2")


class Plots:
    """Figures of one solution, by matplotlib: ``solution.plot.trajectory()``.

    Every method draws into ``ax``, or into a new figure, and returns what it drew into; ``ax.figure.savefig("drive.svg")`` keeps it, with
    or without a display. Bands are three standard deviations. Stops are shaded grey in everything that has time along it.
    """

    def __init__(self, solution: Solution) -> None:
        self._solution = solution

    def trajectory(
        self,
        ax: Axes | None = None,
        *,
        reference: Any = None,
        ellipse_every_s: float | None = None,
        ellipse_scale: float = 1.0,
    ) -> Axes:
        """East and north from the first epoch, with ellipses of the position's uncertainty, and where it stood.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw.
        reference : Solution or insnav.sim.Truth, optional
            Drawn below it: anything with ``latitude_deg``, ``longitude_deg`` and ``height_m``.
        ellipse_every_s : float, optional
            Time between two ellipses, s; twenty in all unless given. 0: none.
        ellipse_scale : float, default 1
            Draw them so many times as large, where centimetres would not be seen beside kilometres; the legend says so.

        Returns
        -------
        matplotlib.axes.Axes
            With lines ``"solution"`` and ``"reference"``, a marker for each stop, and an ellipse of three standard deviations (98.9 %)
            a stretch of time.
        """
        patches = needs("matplotlib.patches")
        s = self._solution
        (ax,) = _axes(ax, 1)
        to_ned = _map(s)
        if reference is not None:
            other = to_ned(reference)
            ax.plot(other[:, 1], other[:, 0], color="0.6", linewidth=3, label="reference")
        track = to_ned(s)
        ax.plot(track[:, 1], track[:, 0], color=COLOURS[0], linewidth=1, label="solution")
        stops = s.stops
        if len(stops):
            rows = [_row_at(s, begin) for begin in stops.begin_s]
            ax.plot(track[rows, 1], track[rows, 0], "s", color="k", markersize=5, label="stops")
        times = _instants(s, ellipse_every_s)
        for number, time in enumerate(times):
            row = _row_at(s, time)
            # East and north, in this order, as they are drawn.
            covariance = s.position_covariance_n_m2[row][np.ix_([1, 0], [1, 0])]
            variances, axes = np.linalg.eigh(covariance)
            wide, high = 2 * 3 * ellipse_scale * np.sqrt(np.maximum(variances, 0))
            scale = f" × {ellipse_scale:g}" if ellipse_scale != 1 else ""
            ax.add_patch(
                patches.Ellipse(
                    (track[row, 1], track[row, 0]),
                    wide,
                    high,
                    angle=float(np.degrees(np.arctan2(axes[1, 0], axes[0, 0]))),
                    fill=False,
                    edgecolor=COLOURS[1],
                    gid="ellipse",
                    label=f"3 sigma{scale}" if number == 0 else None,
                )
            )
        ax.set_aspect("equal", adjustable="datalim")
        ax.set_xlabel("east (m)")
        ax.set_ylabel("north (m)")
        ax.legend()
        return ax

    def attitude(self, ax: Sequence[Axes] | None = None) -> NDArray[Any]:
        """Roll, pitch and heading with their three-sigma bands.

        The heading is drawn without jumps from 360° to 0°. Bands are the standard deviations of the three angles, which follow from the
        covariance of the attitude.

        Parameters
        ----------
        ax : three matplotlib.axes.Axes, optional
            Where to draw, one below the other unless given.

        Returns
        -------
        (3,) of matplotlib.axes.Axes
        """
        s = self._solution
        drawn = _axes(ax, 3)
        sigma = angle_sigmas_deg(s.pitch_deg, s.heading_deg, s.attitude_covariance_n_rad2) if len(s) else np.empty((0, 3))
        heading = np.unwrap(s.heading_deg, period=360.0)
        for i, (name, values) in enumerate([("roll", s.roll_deg), ("pitch", s.pitch_deg), ("heading", heading)]):
            _band(drawn[i], s.time_s, values, 3 * sigma[:, i], COLOURS[i], name)
            drawn[i].set_ylabel(f"{name} (°)")
        return self._finished(drawn)

    def biases(self, ax: Sequence[Axes] | None = None) -> NDArray[Any]:
        """Biases of gyros and accelerometers with their three-sigma bands.

        Parameters
        ----------
        ax : two matplotlib.axes.Axes, optional
            Where to draw gyros and accelerometers.

        Returns
        -------
        (2,) of matplotlib.axes.Axes
        """
        s = self._solution
        drawn = _axes(ax, 2)
        rows = [
            ("gyro bias (°/h)", s.gyro_bias_deg_per_hour, s.sigma_gyro_bias_deg_per_hour),
            ("accelerometer bias (mg)", s.accel_bias_mg, s.sigma_accel_bias_mg),
        ]
        for axes, (label, values, sigma) in zip(drawn, rows, strict=True):
            for i, name in enumerate(("forward", "right", "down")):
                _band(axes, s.time_s, values[:, i], 3 * sigma[:, i], COLOURS[i], name)
            axes.set_ylabel(label)
            axes.legend(loc="upper right")
        return self._finished(drawn)

    def nis(self, ax: Sequence[Axes] | None = None, *, measurements: Sequence[str] | None = None) -> NDArray[Any]:
        """Normalised innovations squared, one panel a measurement, with the bounds within which 95 % should be.

        Bounds are those of a chi-square variable with the degrees of freedom of the measurement, 2.5 % on either side [BarShalom01, section
        5.4.2]; titles say which share is within. Measurements of another dimension than most of their kind are not drawn.
        What was not used is crossed.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes, optional
            Where to draw, one for each measurement.
        measurements : sequence of str, optional
            Which of them; all that the run has unless given.

        Returns
        -------
        (k,) of matplotlib.axes.Axes

        Raises
        ------
        ArgumentError
            The run has none, or none of that name.
        """
        updates = self._solution.updates
        known = list(dict.fromkeys(updates.measurement.tolist()))
        names = known if measurements is None else list(measurements)
        unknown = [name for name in names if name not in known]
        if unknown or not names:
            raise ArgumentError(
                f"measurements: the solution has no {', '.join(unknown) or 'measurements'}",
                "bad_option",
                f"it has {', '.join(known)}" if known else "no measurement was fused, or the frame that it was made of came without updates",
                argument="measurements",
            )
        drawn = _axes(ax, len(names))
        for axes, name in zip(drawn, names, strict=True):
            of_name = updates.measurement == name
            dof = int(np.bincount(updates.dof[of_name]).argmax())
            rows = of_name & (updates.dof == dof)
            time_s, nis = updates.time_s[rows], updates.nis[rows]
            low, high = CHI_SQUARE_95[dof]
            within = np.mean((nis >= low) & (nis <= high))
            used = ~np.isin(updates.verdict[rows], ["rejected", "frozen"])
            axes.plot(time_s[used], nis[used], ".", color=COLOURS[0], markersize=3, label="used")
            if not used.all():
                axes.plot(time_s[~used], nis[~used], "x", color="r", markersize=4, label="not used")
            for bound in (low, high):
                axes.axhline(bound, color="k", linestyle="--", linewidth=1, gid="bound")
            axes.set_yscale("log")
            # What is exactly as predicted has no place on a logarithmic axis.
            axes.set_ylim(bottom=low / 10)
            axes.set_ylabel("NIS")
            axes.set_title(f"{name}: {within:.1%} within the 95 % of chi-square, {dof} degrees of freedom", fontsize="small")
        return self._finished(drawn)

    def errors(self, reference: Any, ax: Sequence[Axes] | None = None, **options: Any) -> NDArray[Any]:
        """Errors of position, velocity and attitude against a reference, with three-sigma bands around zero.

        Parameters
        ----------
        reference : insnav.sim.Truth, Solution, path or mapping
            As of :func:`insnav.compare`.
        ax : nine matplotlib.axes.Axes, optional
            Where to draw north, east and down of each, in this order, whatever the shape.
        **options
            Keywords of :func:`insnav.compare`.

        Returns
        -------
        (3, 3) of matplotlib.axes.Axes
            Rows are north, east and down; columns position, velocity and attitude (as a small rotation).
        """
        from insnav import compare

        c = compare(self._solution, reference, **options)
        drawn = _axes(ax, 9, columns=3).reshape(3, 3)
        quantities = [
            ("position error (m)", c.position_error_n_m, c.sigma_position_n_m),
            ("velocity error (m/s)", c.velocity_error_n_m_per_s, c.sigma_velocity_n_m_per_s),
            ("attitude error (°)", c.attitude_error_n_deg, c.sigma_attitude_n_deg),
        ]
        for column, (label, errors, sigma) in enumerate(quantities):
            for i, direction in enumerate(("north", "east", "down")):
                axes = drawn[i, column]
                axes.fill_between(c.time_s, -3 * sigma[:, i], 3 * sigma[:, i], color=COLOURS[i], alpha=0.25, linewidth=0)
                axes.plot(c.time_s, errors[:, i], color=COLOURS[i], linewidth=1, label=direction)
                axes.set_ylabel(direction)
            drawn[0, column].set_title(label, fontsize="small")
        self._finished(drawn.ravel())
        for axes in drawn[-1]:
            axes.set_xlabel(TIME)
        return drawn

    def _finished(self, drawn: NDArray[Any]) -> NDArray[Any]:
        """Stops shaded, time along the last one."""
        for axes in drawn:
            shade_stops(axes, self._solution)
        drawn[-1].set_xlabel(TIME)
        return drawn


def shade_stops(ax: Axes, solution: Solution) -> None:
    """A grey stretch for each stop."""
    stops = solution.stops
    for begin, end in zip(stops.begin_s, stops.end_s, strict=True):
        ax.axvspan(float(begin), float(end), color="0.85", zorder=0, linewidth=0, gid="stop")


def allan(deviation: AllanDeviation, fit: AllanFit | None, ax: Axes | None, unit: str) -> Axes:
    """See `AllanDeviation.plot`."""
    (ax,) = _axes(ax, 1)
    tau = deviation.tau_s
    if fit is None:
        ax.loglog(tau, deviation.deviation, "o", color=COLOURS[0], markersize=3, label="deviation")
    else:
        off = np.abs(fit.interval - deviation.deviation[:, None]).T
        ax.errorbar(tau, deviation.deviation, yerr=off, fmt="o", color=COLOURS[0], markersize=3, label="deviation, 1 sigma")
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.loglog(tau, fit.fitted, color=COLOURS[1], label="fit")
        by = f" {unit}" if unit else ""
        labels = [
            (f"slope −1/2: N = {fit.white:.3g}{by}√s", ":"),
            (f"slope 0: B = {fit.flicker:.3g}{by}", "--"),
            (f"slope +1/2: K = {fit.random_walk:.3g}{by}/√s", "-."),
        ]
        # A part far below everything that was measured would make the picture of the rest small.
        floor = 0.3 * deviation.deviation.min()
        for (label, style), values in zip(labels, fit.parts.T, strict=True):
            if values.max() > floor:
                ax.loglog(tau, np.where(values > floor, values, np.nan), style, color="0.4", linewidth=1, label=label)
    ax.set_xlabel("averaging time (s)")
    ax.set_ylabel(f"Allan deviation ({unit})" if unit else "Allan deviation")
    ax.grid(True, which="both", alpha=0.3)
    ax.legend()
    return ax


def _axes(given: Any, count: int, columns: int = 1) -> NDArray[Any]:
    """As many as are needed: those that are given, or those of a new figure."""
    if given is None:
        pyplot = needs("matplotlib.pyplot")
        rows = count // columns
        size = (9.0, 5.0 if rows == 1 else 1.0 + 2.0 * rows)
        _, made = pyplot.subplots(rows, columns, sharex=True, squeeze=False, figsize=size, layout="constrained")
        return np.asarray(made).ravel()
    drawn = np.asarray(given, dtype=object).ravel()
    if len(drawn) != count:
        raise ArgumentError(
            f"ax: {len(drawn)} axes, expected {count}",
            "wrong_shape",
            "leave it out for a new figure",
            argument="ax",
            received=str(len(drawn)),
            expected=str(count),
        )
    return drawn


def _band(ax: Axes, time_s: Floats, values: Floats, half: Floats, colour: str, label: str) -> None:
    ax.fill_between(time_s, values - half, values + half, color=colour, alpha=0.25, linewidth=0)
    ax.plot(time_s, values, color=colour, linewidth=1, label=label)


def _map(solution: Solution) -> Callable[[Any], Floats]:
    """What gives north, east and down from the solution's first epoch."""
    if not len(solution):
        return lambda of: np.empty((0, 3))

    def positions(of: Any) -> Floats:
        return np.column_stack([np.radians(of.latitude_deg), np.radians(of.longitude_deg), of.height_m])

    frame = LocalFrame(positions(solution)[0])
    return lambda of: frame.to_ned(positions(of))


def _row_at(solution: Solution, time_s: float) -> int:
    """The epoch that is nearest to an instant, be it outside."""
    return int(np.abs(solution.time_s - time_s).argmin())


def _instants(solution: Solution, every_s: float | None) -> Floats:
    if not len(solution) or every_s == 0:
        return np.empty(0)
    first, last = float(solution.time_s[0]), float(solution.time_s[-1])
    if every_s is None:
        return np.linspace(first, last, 20)
    if not every_s > 0:
        raise ArgumentError(f"ellipse_every_s: {every_s}, expected 0 or more", "bad_option", argument="ellipse_every_s")
    return np.arange(first, last, every_s)
