"""Compares cycles with the machine in the loop and with the same nominal motion imposed, over beds.

    python examples/machine/study.py --seeds 1,2,3,4,5,6
    python examples/machine/study.py --kinds loop --seeds 1,2,3 --set preset_pressure=80e5,110e5 --set squeeze_time=0.6,0.8

Each bed is tamped three times: by the unit in the loop (`loop`), by its motion without load (`imposed`), and by that motion
up to the mean closing which the loop reached on this bed (`same closing`). Written are `figures.csv`, a row for each bed and
setting, and `study.md`: means and standard deviations over beds, and differences to the loop with their standard errors. A
stopped study continues where it was.
"""

import argparse
import hashlib
import itertools
import sys
from functools import partial
from pathlib import Path

import ballast
import numpy as np
import pandas as pd
from ballast import study

HERE = Path(__file__).parent
KINDS = ("loop", "imposed", "same closing")


def measure(case, beds, *, kinds, settings, folder, source):
    """Returns figures of the cycles on a bed; `source` is a digest of the programs, so that changed ones run again."""
    sys.path.insert(0, folder)
    import tamp

    found = {}
    for kind in kinds:
        others = dict(settings)
        if kind == "same closing":
            others["closing_limit"] = found["loop: mean closing, mm"] * 1e-3
        texts = [text for name, value in others.items() for text in ("--set", f"{name}={value}")]
        args = tamp.arguments(texts + ["--imposed"] * (kind != "loop"))
        with ballast.open(case, bed_cache=beds, threads=1, progress=False) as sim:
            coupling, unit = tamp.couple_unit(sim, case, args)
            run = tamp.new_run(sim, args)
            for _ in tamp.cycle_windows(coupling, unit, run, args):
                pass
            found |= {f"{kind}: {name}": value for name, value in figures(tamp.summary(run, unit, sim)).items()}
    return found


def figures(f):
    squeezes = f["squeezes"].values()
    before, after = f["compactness"][0], f["compactness"][-1]

    def change(zone):
        values = [after[name] / before[name] - 1 for name in before if name.startswith(zone) and name in after]
        return 100 * float(np.mean(values))

    return {
        "mean closing, mm": 1e3 * float(np.mean([s["closing"] for s in squeezes])),
        "largest period mean of a closing force, kN": 1e-3 * max(s["mean_force"] for s in squeezes),
        "work in the squeeze, J": sum(s["work"] for s in squeezes),
        "work on the ballast, J": f["received"],
        "compactness up to the lifted level, %": change("under_lifted/"),
        "compactness of the cribs, %": change("crib_"),
        "pairs stopped by pressure": sum(s["cause"] == "pressure" for s in squeezes),
        "steps not converged": f["steps_not_converged"],
    }


def main():
    parser = argparse.ArgumentParser(description="Compare the machine in the loop with imposed motion, over beds")
    parser.add_argument("case", nargs="?", default=HERE / "tamping.toml", help="case file")
    parser.add_argument("--kinds", default=",".join(KINDS), help="cycles to compare, the loop first")
    parser.add_argument("--seeds", default="1,2,3,4,5,6", help="seeds of the beds")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE,...", help="parameter of the unit, or several")
    parser.add_argument("--out", type=Path, default=Path("runs/machine_study"), help="folder of the results")
    parser.add_argument("--jobs", type=int, help="processes (default: one per processor)")
    args = parser.parse_args()
    case, names = ballast.Case.load(args.case), [text.partition("=")[0] for text in args.set]
    kinds = args.kinds.split(",")
    if kinds[0] != "loop" or not set(kinds) <= set(KINDS):
        raise SystemExit(f"--kinds: expected loop, or loop with some of {', '.join(KINDS[1:])}; found {args.kinds}")
    tables = []
    for values in itertools.product(*(text.partition("=")[2].split(",") for text in args.set)):
        settings = dict(zip(names, values, strict=True))
        points = study.grid({"bed.seed": [int(seed) for seed in args.seeds.split(",")]})
        bound = partial(measure, kinds=kinds, settings=settings, folder=str(HERE), source=digest())
        table = study.run(case, points, args.out, measure=bound, jobs=args.jobs)
        tables.append(table.assign(**settings))
    table = pd.concat(tables, ignore_index=True)
    table.to_csv(args.out / "figures.csv", index=False)
    if "error" in table and table["error"].notna().any():
        raise SystemExit(f"{table['error'].notna().sum()} of {len(table)} points failed: see {args.out / 'figures.csv'}")
    lines = []
    for values, group in table.groupby(names) if names else [((), table)]:
        lines += [", ".join(f"{name} = {value}" for name, value in zip(names, values, strict=True)), ""] * bool(names)
        lines += [*report(group, kinds), ""]
    (args.out / "study.md").write_text("\n".join(lines))
    print("\n".join(lines))


def digest():
    programs = [(HERE / name).read_bytes() for name in ("machine.py", "tamp.py", "study.py")]
    return hashlib.sha256(b"".join(programs)).hexdigest()


def report(table, kinds):
    """Yields means over beds for each kind, and differences to the loop."""
    differences = [f"{kind} less loop" for kind in kinds[1:]]
    yield from (f"| {' | '.join(['figure', *kinds, *differences])} |", "|---" * (1 + len(kinds) + len(differences)) + "|")
    names = [column.removeprefix("loop: ") for column in table.columns if column.startswith("loop: ")]
    # Beds are the same for all kinds, so that their scatter cancels.
    table = table.assign(**{f"{kind} less loop: {name}": table[f"{kind}: {name}"] - table[f"loop: {name}"]
                            for kind in kinds[1:] for name in names})  # fmt: skip
    over_beds = study.statistics_over_beds(table)
    for name in names:
        cells = ["{mean:.3g} ± {std:.2g}".format(**over_beds.loc[f"{kind}: {name}"]) for kind in kinds]
        for kind in differences:
            figure = over_beds.loc[f"{kind}: {name}"]
            cells.append(f"{figure['mean']:+.3g} ± {figure['std'] / figure['count'] ** 0.5:.2g}")
        yield f"| {name} | {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
