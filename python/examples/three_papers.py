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


# %% [markdown]
# ## What a filter makes of a stop
#
# Kozadaev and Makarenko 2017: zero velocities alone let the heading drift while a vehicle stands; with the heading held it does not.

# %%
stop = insnav.sim.kozadaev2017(2)
show(stop)


# %% [markdown]
# ## Drifts and azimuth from stops in two positions
#
# Lobusov and Fomichev 2014: a navigation-grade unit stands, turns, and stands again.

# %%
positions = insnav.sim.lobusov2014(2)
show(positions)

# %% [markdown]
# ## Q and R of an attitude filter from its own innovations
#
# Belokurov 2018: at rest, turning, shaken, pushed, beside iron.

# %%
attitude = insnav.sim.belokurov2018(2)
show(attitude)

# %% [markdown]
# What the papers leave open, and what was taken:

# %%
for result in (stop, positions, attitude):
    print(result["paper"])
    for assumption in result["assumptions"]:
        print("  -", assumption)
    assert result["rows"] and result["assumptions"]
