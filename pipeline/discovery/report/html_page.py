"""report.html: the discovery as one self-contained page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa

from pipeline.discovery.fitting.estimates import ParameterEstimate
from pipeline.discovery.report.discovery import Discovery, Verdict
from pipeline.discovery.report.figures import ranking_figure, residual_figure, trajectory_figure, where_figure
from pipeline.discovery.selection.comparison import Compared
from pipeline.report.written_report import Section, drawing, html_table, page
from pipeline.scene.effects.discovery_rules import Number
from pipeline.scene.effects.region import Region
from pipeline.scene.effects.registry import effect_kinds

LEAST_SURE = 0.6  # highest confidence of a verdict that is called doubtful
TITLE = "What the simulation lacks"


def sentence(report: Mapping[str, Any]) -> str:
    """The verdict of a report in words; a doubtful one begins with "Doubtful"."""
    doubtful = report["verdict"]["confidence"] <= LEAST_SURE
    return ("Doubtful. " if doubtful else "") + _said(report) + _mended_first(report["faults"])


def _mended_first(faults: Sequence[Mapping[str, Any]]) -> str:
    """What was mended in the recordings before, in words."""
    said = []
    frames = sum(f["size"] for f in faults if f["fault"] == "dropped_frames")
    if frames:
        recordings = len({f["clip"] for f in faults if f["fault"] == "dropped_frames"})
        said.append(f"{frames} dropped frames in {recordings} recording{'s' * (recordings > 1)}")
    for f in faults:
        if f["fault"] == "recording_scale":
            said.append(f"the lengths of {f['clip']}, {f['size']:.3f} times too large")
        elif f["fault"] == "bumped_camera":
            said.append(f"a shift of {f['clip']} by {1e3 * f['size']:.3g} mm at {f['time']:.2f} s")
        elif f["fault"] == "swapped_names":
            said.append(f"the names of {f['object']} in {f['clip']}, swapped at {f['time']:.2f} s")
    return f" Mended first: {'; '.join(said)}." if said else ""


def _said(report: Mapping[str, Any]) -> str:
    verdict, gap = report["verdict"], report["gap"]
    scale, unit = _shown_unit(gap)
    before, after, floor = (scale * gap[k] for k in ("before", "after", "noise_floor"))
    numbers = f"The gap on {'held-out' if report['clips']['held_out'] else 'fitted'} clips is {before:.3g} {unit}"
    sure = f"(confidence {verdict['confidence']:.2f})"
    equivalent = ", ".join(n for group in verdict["equivalent"] for n in group if n not in verdict["effects"])
    if not verdict["effects"]:
        extra = ""
        if equivalent:
            extra = f" A calibrated number differs much from what was stated, which amounts to {equivalent}."
        return (
            f"Nothing is missing {sure}: the calibrated model explains the measurements. {numbers}; the noise floor is "
            f"{floor:.3g} {unit}.{extra}"
        )
    if verdict["effects"] == ["unknown"]:
        what = (
            f"Something is missing {sure}; the measurements do not tell which of these: {equivalent}."
            if equivalent
            else f"Something is missing that no listed effect explains {sure}: {verdict['form']}."
        )
        if report["where"] is not None and report["where"]["only"]:
            what += f" It acts only {Region.of(report['where']['only']).words}."
        return f"{what} {numbers}, and no listed effect closes it; the noise floor is {floor:.3g} {unit}."
    alike = f" These measurements cannot tell it from {equivalent}." if equivalent else ""
    place = "".join(f" {Region.of(n['only']).words}" for n in verdict["named"] if "only" in n)
    return (
        f"The simulation lacks {' and '.join(verdict['effects'])}{place} {sure}.{alike} {numbers} without and "
        f"{after:.3g} {unit} with it; the noise floor is {floor:.3g} {unit}.{_remaining(verdict['remainder'])}"
    )


def _shown_unit(gap: Mapping[str, Any]) -> tuple[float, str]:
    """By what the numbers of the gap are multiplied to be shown, and their unit then."""
    return (1e3, f"m{gap['unit']}") if gap["unit"] in ("m", "rad") else (1.0, gap["unit"])


def _remaining(left: Mapping[str, Any] | None) -> str:
    """What the named effects leave, in words."""
    if left is None:
        return ""
    where = f" in {' and '.join(left['regimes'])}" if left["regimes"] else ""
    maybe = f" It may be {' or '.join(left['candidates'])}." if left["candidates"] else ""
    return f" {left['share']:.0%} of the gap beyond noise remains{where}: {left['form']}.{maybe}"


def html_page(found: Discovery, report: Mapping[str, Any], table: pa.Table, facts: Mapping[str, str]) -> str:
    """The page as HTML, with all figures in it.

    Args:
        found: The discovery.
        report: Its `report_dict`.
        table: Its `residual_table`.
        facts: What was read and asked, shown at the top.
    """
    sections = [
        Section("Where they disagree", _region(report), _where(found, report, table)),
        *verdict_sections(found.verdict, found.selection, report, effect_kinds()),
        Section(
            "Residuals",
            "Measured minus predicted coordinates. Each arc has its own initial state.",
            drawing(residual_figure(table), "by regime"),
        ),
        Section(
            "Trajectories",
            "Measured and predicted.",
            drawing(trajectory_figure(found, table), "z over time; from above"),
        ),
        Section("Calibrated", "Free parameters of the known scene.", parameter_table(found.calibrated)),
        Section("Faults of the measurement", _mended(report), _faults(report)),
        Section("Notes", "", "".join(f"<p>{note}</p>" for note in report["notes"])),
    ]
    return page(TITLE, sentence(report), facts, sections)


def verdict_sections(
    verdict: Verdict, selection: Compared, report: Mapping[str, Any], kinds: Mapping[str, Any]
) -> list[Section]:
    """What remains, the verdict, and the candidates.

    Args:
        verdict: The answer.
        selection: The models that were compared.
        report: Its `report_dict`.
        kinds: The effects by name, each with a formula.
    """
    left = report["verdict"]["remainder"]
    tells = "" if left is None else f"What would tell: {left['experiment']}."
    laws = "".join(f"<p>{name}: {kinds[name].formula}</p>" for name in verdict.effects if name in kinds)
    ranking = drawing(ranking_figure(selection, verdict.effects), "ranking") if selection.singles else ""
    note = "Models with one effect each. Green: effects of the verdict."
    return [
        *([] if left is None else [Section("What remains", tells, _remainder(report))]),
        Section("Verdict", f"The next experiment: {verdict.experiment}.", parameter_table(verdict.parameters) + laws),
        Section("Candidates", note, _candidates(report) + ranking),
    ]


def _mended(report: Mapping[str, Any]) -> str:
    return "What was wrong with the recordings, not with the physics." if report["faults"] else "None was found."


def _faults(report: Mapping[str, Any]) -> str:
    rows = [
        (
            f["fault"].replace("_", " "),
            f["clip"] or "all",
            f["object"] or "all",
            "throughout" if f["time"] is None else f"{f['time']:.3f}",
            f"{f['size']:.4g}",
            f["unit"],
        )
        for f in report["faults"]
    ]
    return html_table(["fault", "recording", "object", "time, s", "size", "unit"], rows) if rows else ""


def _remainder(report: Mapping[str, Any]) -> str:
    """The gap before and after, and what remains."""
    gap, left = report["gap"], report["verdict"]["remainder"]
    scale, unit = _shown_unit(gap)
    rows = [
        (f"gap before, {unit}", f"{scale * gap['before']:.3g}"),
        (f"gap after, {unit}", f"{scale * gap['after']:.3g}"),
        (f"noise floor, {unit}", f"{scale * gap['noise_floor']:.3g}"),
        ("remains of the gap beyond noise", f"{left['share']:.0%}"),
        ("in", ", ".join(left["regimes"]) or "no regime more than in others"),
        ("of", ", ".join(left["objects"]) or "no object more than of others"),
        ("force", left["form"]),
        ("may be", ", ".join(left["candidates"]) or "none of the listed effects"),
    ]
    return html_table(["", ""], rows)


def _number(value: Number | str | list[str] | None) -> str:
    if value is None:
        return "not determined"
    if isinstance(value, str):
        return value
    return "[" + ", ".join(map(_number, value)) + "]" if isinstance(value, list) else f"{value:.4g}"


def parameter_table(numbers: Mapping[str, ParameterEstimate]) -> str:
    """Parameters with their standard errors."""
    if not numbers:
        return "<p>none</p>"
    rows = [(k, _number(e.value), _number(e.stderr), e.unit) for k, e in numbers.items()]
    return html_table(["parameter", "value", "standard error", "unit"], rows)


def _candidates(report: Mapping[str, Any]) -> str:
    rows = [
        (
            c["effect"],
            f"{c['probability']:.3f}",
            f"{c['delta_bic']:.1f}",
            f"{c['held_out_gain']:.1f}",
            "; ".join(f"{k} {_number(v['value'])} ± {_number(v['stderr'])}" for k, v in c["parameters"].items()),
        )
        for c in report["candidates"]
    ]
    return html_table(["effect", "probability", "delta BIC", "held-out gain, nats", "parameters"], rows)


def _region(report: Mapping[str, Any]) -> str:
    """The region in which the known scene fails, in words."""
    where = report["where"]
    if where is None:
        return "Intervals in which something unknown acts, the most significant first."
    who = f", of {', '.join(where['objects'])} alone" if where["objects"] else ""
    if not where["only"]:
        return f"The known scene fails everywhere{who}."
    return f"The known scene fails {Region.of(where['only']).words}{who}: {where['share']:.0%} of the time of motion."


def _where(found: Discovery, report: Mapping[str, Any], table: pa.Table) -> str:
    if not report["disagreement"]:
        return "<p>nowhere by more than the noise</p>"
    picture = drawing(where_figure(found, table), "in the place, and against time and speed")
    return picture + disagreement_table(report)


def disagreement_table(report: Mapping[str, Any]) -> str:
    """The strongest intervals in which something unknown acts."""
    rows = [
        (
            d["clip"],
            d["object"],
            f"{d['t_start']:.2f} to {d['t_end']:.2f} s",
            d["regime"],
            f"{d['residual']:.3g} {d['unit']}",
            f"{d['z_score']:.1f}",
            d["direction"],
        )
        for d in report["disagreement"][:15]
    ]
    return html_table(["clip", "object", "time", "regime", "missing force", "z", "direction"], rows)
