"""Discovery on published measurements: verdicts, parameters, gaps, and forecasts of samples that were not fitted.

Reads the folders of `real_motion` (DYNAMICS_DATA, else ../shared/data). Writes reports/real_motion.md; with --write
FOLDER it writes only each set's tracks and known scene to that folder, for `dynamics discover`.
Run: python -m benchmarks.real_motion [--tosses 24] [--flights 54] [--write FOLDER]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from ruamel.yaml import YAML

from benchmarks.published.ball_drops import read_ball_drops, together
from benchmarks.published.cube_tosses import read_cube_tosses
from benchmarks.published.published_set import RealSet
from benchmarks.published.table_tennis import read_table_tennis
from pipeline.discovery.discover import discover
from pipeline.discovery.fitting.initial_states import stack_initial_states
from pipeline.discovery.fitting.least_squares import fit
from pipeline.discovery.fitting.model import known_model, with_effect
from pipeline.discovery.fitting.predictions import run
from pipeline.discovery.report.discovery import Discovery
from pipeline.discovery.report.remainder import Remainder
from pipeline.discovery.selection.gap import body_gap
from pipeline.discovery.tracks.arc import Arc
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.stack import stack_arcs
from pipeline.discovery.tracks.track import tracks_table
from pipeline.report.markdown import markdown, table_row
from pipeline.scene.effects.registry import effect_kinds
from training.data_folder import needed

SEEN = 0.4  # share of the second drop that is fitted
FORECASTS = (None, "linear_drag", "air_drag")
HEAD = (
    *("set", "verdict", "confidence", "equivalent", "parameters or form", "remains"),
    *("gap before, mm", "after", "floor", "s"),
)


def forecast_errors(real: RealSet) -> list[float]:
    """RMS errors, m, over the unseen 60 % of drop 2, without drag, with linear and with quadratic drag.

    The models are fitted by least squares to all samples of drop 1 and to the first 40 % of drop 2.
    """
    known = known_scene(real.known)
    arcs = [
        Arc(
            clip=t.clip,
            object=0,
            grounded=False,
            time=t.time - t.time[0],
            position=t.position,
            sigma=np.ones(len(t.time)),
            row=np.arange(len(t.time)),
            others=np.zeros((len(t.time), 0, 3)),
        )
        for t in real.tracks
    ]
    stack = stack_arcs(arcs, known, False)
    seen = int(SEEN * len(arcs[1].time))
    weight = stack.weight.copy()
    weight[1, seen:] = 0
    fitted = replace(stack, weight=weight)
    out = []
    for name in FORECASTS:
        model = known_model(known, [fitted])
        if name:
            model = with_effect(model, effect_kinds()[name], known)
        found = fit([fitted], model, model.start, [stack_initial_states(fitted)], [np.ones(2, bool)])
        rows, _ = run(stack, model, found.theta[None], found.starts[0][None])
        predicted = rows[0, 1].reshape(-1, 3)[seen : len(arcs[1].time), 2]  # in units of 1 m
        out.append(float(np.sqrt(np.mean((arcs[1].position[seen:, 2] - predicted) ** 2))))
    return out


def verdict_row(name: str, found: Discovery, seconds: float) -> list[str]:
    v, g = found.verdict, found.gap
    numbers = "; ".join(f"{k} {_short(e.value)} ± {_short(e.stderr)} {e.unit}" for k, e in v.parameters.items())
    alike = " / ".join(", ".join(s) for s in v.equivalent)
    said = [" + ".join(v.effects) or "none", f"{v.confidence:.2f}", alike, numbers or (v.form or "")]
    sizes = [f"{1e3 * size:.3g}" for size in (g.before, g.after, g.noise_floor)]
    return [name, *said, _remaining(v.remainder), *sizes, f"{seconds:.1f}"]


def gaps_by_object(found: Discovery) -> str:
    """A table: root mean square residuals of each object before and after, mm, over all clips; of one object none."""
    names = [o.name for o in found.problem.known.scene.objects]
    if len(names) < 2:
        return ""
    rows = []
    for number, name in enumerate(names):
        before, after = (1e3 * body_gap(model, number) for model in (found.selection.baseline, found.answer))
        rows.append([name, f"{before:.3g}", f"{after:.3g}"])
    return "\n" + markdown(["object", "gap before, mm", "after"], rows)


def _remaining(left: Remainder | None) -> str:
    if left is None:
        return ""
    where = f" in {', '.join(left.regimes)}" if left.regimes else ""
    return f"{left.share:.0%}, {left.noise_floors:.1f} floors{where}: {left.form}"


def _short(value: float | list[float] | None) -> str:
    if value is None:
        return "?"
    return "[" + ", ".join(f"{x:.3g}" for x in value) + "]" if isinstance(value, list) else f"{value:.3g}"


def write_sets(sets: Sequence[RealSet], folder: Path) -> None:
    """Write <name>.parquet and <name>.yaml of each set, for `dynamics discover`."""
    folder.mkdir(parents=True, exist_ok=True)
    for real in sets:
        name = real.name.replace(" ", "_")
        pq.write_table(tracks_table(real.tracks), folder / f"{name}.parquet")
        YAML(typ="safe").dump(real.known, folder / f"{name}.yaml")
        print(f"wrote {folder / name}.parquet and .yaml")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tosses", type=int, default=48)
    parser.add_argument("--flights", type=int, default=54)
    parser.add_argument("--out", type=Path, default=Path("reports/real_motion.md"))
    parser.add_argument("--write", type=Path, help="folder for the sets as `dynamics discover` takes them")
    arguments = parser.parse_args()
    folder = needed("real_motion")
    drops = read_ball_drops(folder / "ball_drops")
    sets = [
        *drops,
        together(drops),
        read_table_tennis(folder / "table_tennis", arguments.flights),
        read_cube_tosses(folder / "cube_tosses", arguments.tosses),
    ]
    if arguments.write:
        write_sets(sets, arguments.write)
        return
    rows, by_object = [], ""
    for real in sets:
        began = time.perf_counter()
        found = discover(real.tracks, known_scene(real.known), 0.3, tuple(effect_kinds()), np.random.default_rng(0))
        rows.append(verdict_row(real.name, found, time.perf_counter() - began))
        by_object += gaps_by_object(found)
        notes = (f"    {note}" for note in found.notes)
        print("\n".join([table_row(rows[-1]), *notes, gaps_by_object(found)]), flush=True)
    words = "Forecasts of the unseen 60 % of drop 2, RMS error in m, after drop 1 and 40 % of drop 2:"
    forecasts = [[real.name, *(f"{e:.2f}" for e in forecast_errors(real))] for real in drops]
    forecast_table = markdown(["ball", "no drag", "linear drag", "quadratic drag"], forecasts)
    print(forecast_table)
    arguments.out.parent.mkdir(exist_ok=True)
    arguments.out.write_text(f"{markdown(HEAD, rows)}{by_object}\n{words}\n\n{forecast_table}", encoding="utf-8")


if __name__ == "__main__":
    main()
