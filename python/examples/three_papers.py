# %% [markdown]
# # Three papers, made again
#
# `insnav.sim` makes the experiments of three papers with the ordinary filters of this package, and puts what was published beside what comes
# out. Here with as few runs as a notebook has time for; the papers had one each, and a table worth reading takes a hundred
# (`insnav.sim.kozadaev2017(100)`, or `insnav reproduce kozadaev2017` from the shell). What was assumed where a paper is silent is in the
# result too.

# %%
from typing import Any

import insnav


def show(result: dict[str, Any]) -> None:
    """The rows of which the paper has a number."""
    print(f"{result['paper']}: {result['independent_runs']} runs, {len(result['rows'])} rows")
    for row in result["rows"]:
        if row["published"] is not None:
            spread = f" ± {row['standard_error']:.2g}" if row["standard_error"] is not None else ""
            print(f"  {row['case']:24} {row['variant']:22} {row['quantity']:30} published {row['published']:9.4g}  ours {row['ours']:9.4g}{spread}")


def ours(result: dict[str, Any], case: str, variant: str, quantity: str) -> float:
    """What came out here."""
    (row,) = [row for row in result["rows"] if (row["case"], row["variant"], row["quantity"]) == (case, variant, quantity)]
    return float(row["ours"])


# %% [markdown]
# ## What a filter makes of a stop
#
# Kozadaev and Makarenko 2017: zero velocities alone let the heading drift while a vehicle stands; with the heading held it does not.

# %%
stop = insnav.sim.kozadaev2017(2)
show(stop)

# By how much the heading left the one at the begin of five minutes, in degrees.
growth = {variant: ours(stop, "stop_300s", variant, "heading_growth_rms_deg") for variant in ("zupt", "paper_exact", "static")}
print(growth)
assert growth["zupt"] > 1.0 and growth["paper_exact"] < 0.1 and growth["static"] < 0.01

# %% [markdown]
# ## Drifts and azimuth from stops in two positions
#
# Lobusov and Fomichev 2014: a navigation-grade unit stands, turns, and stands again.

# %%
positions = insnav.sim.lobusov2014(2)
show(positions)

# While the vehicle rocks, and nothing else disturbs: percent of the drift. Published are 6.5.
rocking = ours(positions, "sway_noise_free_no_east", "joint", "drift_error_percent")
print(f"all stops in one regression: {rocking:.4f} % of the drift")
assert abs(rocking) < 6.5 / 100

# %% [markdown]
# ## Q and R of an attitude filter from its own innovations
#
# Belokurov 2018: at rest, turning, shaken, pushed, beside iron.

# %%
attitude = insnav.sim.belokurov2018(2)
show(attitude)

# At rest, how much less the angle scatters than that of the accelerometers alone.
for angle in ("pitch", "roll"):
    quieter = ours(attitude, "static", "raw", f"{angle}_std_deg") / ours(attitude, "static", "als_long", f"{angle}_std_deg")
    print(f"{angle}: 1/{quieter:.1f} of the scatter")
    assert quieter > 3.0

# %% [markdown]
# What the papers leave open, and what was taken:

# %%
for result in (stop, positions, attitude):
    print(result["paper"])
    for assumption in result["assumptions"]:
        print("  -", assumption)
    assert result["rows"] and result["assumptions"]
