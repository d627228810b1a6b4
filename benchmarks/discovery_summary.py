"""Summary of the blind benchmark's answers: tables with Wilson's intervals, and the confusion matrix."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.clips.intervals import wilson
from pipeline.hidden.confusion_figure import confusion_figure
from pipeline.hidden.judge import Judgement, confusion, equals_of, judge, macro_f1
from pipeline.hidden.scenario import EVERY, TWO_OR_THREE

ONE = tuple(name for name in EVERY if name not in TWO_OR_THREE)
LATER_GROUPS = ("unlisted beside", "unknown spin", "clock and drag", "smoothed")
SINDY = ("air_drag", "linear_drag", "magnus_lift", "tilted_gravity", "gravity_error")


def write_summary(answers: Sequence[dict[str, Any]], folder: Path) -> str:
    """Write summary.md, summary.json and confusion.svg; returns the text."""
    good = [a for a in answers if "error" not in a]
    judged = [judge(a["report"]["verdict"], a["truth"]) for a in good]
    lines = [
        f"{len(good)} worlds answered, {len(answers) - len(good)} failed.",
        "",
        "| group | worlds | right | 95 % interval | false claim | macro-F1 |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    numbers: dict[str, Any] = {}
    groups: dict[str, list[int]] = {}
    for k, a in enumerate(good):
        for group in _groups(a):
            groups.setdefault(group, []).append(k)
    for group, rows in groups.items():
        some = [judged[k] for k in rows]
        hits = sum(j.right for j in some)
        low, high = wilson(hits, len(some))
        false = sum(j.false for j in some)
        shares = f"{hits / len(some):.3f} | {low:.2f} to {high:.2f} | {false / len(some):.3f}"
        lines.append(f"| {group} | {len(some)} | {shares} | {macro_f1(some):.2f} |")
        numbers[group] = {
            "worlds": len(some),
            "right": hits / len(some),
            "low": low,
            "high": high,
            "false": false / len(some),
            "one_at_least": sum(j.some for j in some) / len(some),
        }
    lines += [
        "",
        *_parameters(good, judged),
        "",
        *_gaps(good, judged),
        "",
        *_confidence(good, judged),
        "",
        *_rivals(good, judged),
        "",
        *_sysid(good),
        "",
        *_by_effect(judged, good),
    ]
    seconds = [a["seconds"] for a in good]
    lines += ["", f"Time of a world: median {np.median(seconds):.1f} s, largest {max(seconds):.1f} s."]
    timed = [a for a in good if "processor_seconds" in a and a["truth"]["clips"] == 12]
    for words, bodies in (("one object", ONE), ("two or three", TWO_OR_THREE)):
        spent = [a["processor_seconds"] for a in timed if a["truth"]["scenario"] in bodies]
        if spent:
            lines.append(
                f"Processor time with 12 clips, {words}: median {np.median(spent):.1f} s, largest "
                f"{max(spent):.1f} s ({len(spent)})."
            )
    for a in answers:
        if "error" in a:
            lines.append(f"- failed: {a['group']} {a['recipe']['effects']} seed {a['recipe']['seed']}: {a['error']}")
    text = "\n".join(lines) + "\n"
    (folder / "summary.md").write_text(text)
    (folder / "summary.json").write_text(json.dumps(numbers, indent=1) + "\n")
    main = [j for j, a in zip(judged, good, strict=True) if a["truth"]["clips"] == 12 and a["truth"]["strength"] >= 10]
    if main:
        (folder / "confusion.svg").write_text(confusion_figure(*confusion(main)))
    return text


def _groups(a: dict[str, Any]) -> list[str]:
    groups = [a["group"]]
    if a["truth"].get("struck") and equals_of(a["truth"]["effects"][0], a["truth"]):
        groups = ["struck off, an equal of it listed"]
    if a["group"].startswith("12 clips, 2 mm") and a["truth"]["scenario"] in ("throw", "bounce"):
        groups.append(f"{a['group']}, {'with' if a['truth']['bounces'] else 'without'} bounces")
    return groups


def _parameters(good: Sequence[dict[str, Any]], judged: Sequence[Judgement]) -> list[str]:
    out = ["| noise | parameters | median relative error | 95 % intervals cover |", "| --- | --- | --- | --- |"]
    for noise in sorted({a["truth"]["noise"] for a in good}):
        mine = [j for j, a in zip(judged, good, strict=True) if a["truth"]["noise"] == noise and j.right]
        errors = [e for j in mine for e in j.errors.values() if np.isfinite(e)]
        covered = [c for j in mine for c in j.covered.values()]
        if errors:
            out.append(f"| {1e3 * noise:g} mm | {len(errors)} | {np.median(errors):.3f} | {np.mean(covered):.2f} |")
    return out


def _gaps(good: Sequence[dict[str, Any]], judged: Sequence[Judgement]) -> list[str]:
    shrunk, worse = [], []
    for a, j in zip(good, judged, strict=True):
        g = a["report"]["gap"]
        if j.right and a["truth"]["effects"] and not a["truth"].get("struck"):
            above = np.sqrt(max(g["before"] ** 2 - g["noise_floor"] ** 2, 0))
            left = np.sqrt(max(g["after"] ** 2 - g["noise_floor"] ** 2, 0))
            worse.append(g["after"] > g["before"] * 1.001)
            if above > 0.3 * g["noise_floor"]:
                shrunk.append(1 - left / above)
    if not shrunk:
        return []
    return [
        f"Held-out gap above the noise floor, right verdicts: shrinks by {np.median(shrunk):.2f} "
        f"(median of {len(shrunk)} worlds where it "
        f"is more than 0.3 of the floor); gets worse in {np.mean(worse):.3f} of {len(worse)}."
    ]


def _confidence(good: Sequence[dict[str, Any]], judged: Sequence[Judgement]) -> list[str]:
    head = "| stated confidence | worlds | right | 95 % interval | of listed laws | right | 95 % interval |"
    out = [head, "| --- " * 7 + "|"]
    stated = np.array([a["report"]["verdict"]["confidence"] for a in good])
    right = np.array([j.right for j in judged])
    listed = np.array([not a["truth"].get("struck") and a["group"] not in LATER_GROUPS for a in good])
    for low, high in ((0, 0.8), (0.8, 0.9), (0.9, 0.95), (0.95, 1.01)):
        cells = [f"{low:g} to {min(high, 1):g}"]
        for mine in ((stated >= low) & (stated < high), (stated >= low) & (stated < high) & listed):
            hits, count = int(right[mine].sum()), int(mine.sum())
            bounds = wilson(hits, count) if count else (0.0, 1.0)
            cells += [str(count), f"{hits / max(count, 1):.2f}", f"{bounds[0]:.2f} to {bounds[1]:.2f}"]
        out.append(f"| {' | '.join(cells)} |")
    return [
        *out,
        "",
        "Of listed laws: without effects struck off the list and without " + ", ".join(LATER_GROUPS) + ".",
    ]


def _rivals(good: Sequence[dict[str, Any]], judged: Sequence[Judgement]) -> list[str]:
    both = [(a, j) for a, j in zip(good, judged, strict=True) if not a["truth"].get("struck")]
    mine = [(a, j) for a, j in both if [e["name"] for e in a["truth"]["effects"]] in [[n] for n in SINDY]]
    if not mine:
        return []
    names = [a["truth"]["effects"][0]["name"] for a, _ in mine]
    out = [
        f"On the {len(mine)} worlds whose effect is in the library of PySINDy ({', '.join(SINDY)}):",
        "",
        "| method | exact structure |",
        "| --- | --- |",
    ]
    for rival in ("pysindy_raw", "pysindy_segmented"):
        out.append(
            f"| {rival} | {np.mean([a['rivals'][rival] == [n] for (a, _), n in zip(mine, names, strict=True)]):.2f} |"
        )
    out.append(f"| ours | {np.mean([j.right for _, j in mine]):.2f} |")
    oracle = [a["rivals"]["oracle"] for a in good if a.get("rivals", {}).get("oracle")]
    ours = [a["report"]["gap"] for a in good if a.get("rivals", {}).get("oracle")]
    if oracle:
        ratio = [np.median([g[k] / g["noise_floor"] for g in ours]) for k in ("before", "after")]
        best = np.median([o["after"] / o["floor"] for o in oracle])
        out += [
            "",
            f"Gap over the noise floor, medians of {len(oracle)} worlds with one effect: parameters alone "
            f"{ratio[0]:.2f}, ours {ratio[1]:.2f}, an oracle that knows the name {best:.2f} (it claims "
            f"in {np.mean([o['claimed'] for o in oracle]):.2f}).",
        ]
    return out


def _sysid(good: Sequence[dict[str, Any]]) -> list[str]:
    """MuJoCo's identification of parameters alone, our calibrated model, and our answer."""
    out = []
    for words, bounces in (("without", False), ("with", True)):
        some = [a for a in good if "sysid" in a.get("rivals", {}) and a["truth"]["bounces"] == bounces]
        if some:
            floor = np.array([a["report"]["gap"]["noise_floor"] for a in some])
            theirs = np.median([a["rivals"]["sysid"]["after"] for a in some] / floor)
            before, after = (np.median([a["report"]["gap"][k] for a in some] / floor) for k in ("before", "after"))
            out.append(
                f"4 clips, 2 mm, one object, {words} bounces: gap over the noise floor, medians of {len(some)} "
                f"worlds: `mujoco.sysid` with parameters alone {theirs:.2f}, our calibrated model "
                f"{before:.2f}, our answer {after:.2f}."
            )
    return out


def _by_effect(judged: Sequence[Judgement], good: Sequence[dict[str, Any]]) -> list[str]:
    out = ["12 clips, 2 mm:", "", "| effect | weak | medium | strong |", "| --- | --- | --- | --- |"]
    table: dict[str, dict[str, list[bool]]] = {}
    for j, a in zip(judged, good, strict=True):
        if a["group"].startswith("12 clips, 2 mm"):
            table.setdefault(j.truth, {}).setdefault(a["group"].rpartition(" ")[2], []).append(j.right)
    for name in sorted(table):
        cells = [f"{sum(v)}/{len(v)}" if (v := table[name].get(w, [])) else "" for w in ("weak", "medium", "strong")]
        out.append(f"| {name} | {' | '.join(cells)} |")
    return out
