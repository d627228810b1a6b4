"""A suite of the finished graph: what its stages made of each clip, the answers, their scores and curves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from tqdm import tqdm

from pipeline.clips.events import Event, Thresholds, event_of_row
from pipeline.clips.schedule import Schedule
from pipeline.report.event_scores import score_events
from pipeline.report.scene_scores import Reference, measured_reference, score_with_pairs, true_reference
from pipeline.report.summary import best_of_k_curve, mean_best_so_far
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene
from pipeline.shards.dataset import ShardedDataset

Suite = Mapping[str, ShardedDataset]
Row = dict[str, Any]
#: Forecast -> column of the stage `predict`; the first row, the search's own replay, has more columns.
FORECASTS = {
    "last masks, moved with the replay": "moved_with_replay",
    "constant velocity": "constant_velocity",
    "frozen": "frozen",
}


def reference(suite: Suite, clip: int, schedule: Schedule) -> Reference:
    """What a clip's answers are compared with.

    For a sampled clip its own exact replay; for a real one the masks and the flow that were measured.
    """
    if "sample" in suite:
        return true_reference(read_scene(suite["sample"][clip].row()["scene"]), schedule)
    masks, first = suite["render"][clip].array("mask"), schedule.pairs[:, 0]
    return measured_reference(masks, suite["flow"][clip].array("flow"), first)


def greedy_row(suite: Suite, clip: int) -> Row:
    """The model's greedy answer, from the stage `infer`."""
    return next(row for row in suite["infer"][clip].rows() if row["sample"] < 0)


@dataclass(frozen=True)
class AnsweredSuite:
    """A suite whose clips were answered.

    Attributes:
        name: Of the suite.
        stages: Its shards by stage: render, flow, infer, best_of_k, cmaes, fit; sample and events where clips were
            sampled; regress where that is enabled.
        used: The clips that preference optimisation used. Their scores are summed up apart: they say nothing about
            clips that the model has not seen.
    """

    name: str
    stages: Suite
    used: frozenset[int] = frozenset()

    def __len__(self) -> int:
        return len(self.stages["infer"])

    def group(self, clip: int) -> str:
        """The name under which a clip's scores are summed up."""
        return f"{self.name}, used by prefer" if clip in self.used else self.name

    def label(self, clip: int) -> str:
        """Suite and number of a clip; of a user's clip its name."""
        real = self.stages["render"][clip].row()["name"] if self.name == "real" else clip
        return f"{self.group(clip)}/{real}"

    def answers(self, clip: int) -> dict[str, tuple[str, int]]:
        """By method: the answer's scene as text, and the simulations that it cost."""
        ranked = self.stages["best_of_k"][clip].rows()
        searched, fitted = self.stages["cmaes"][clip].row(), self.stages["fit"][clip].row()
        guess = {} if fitted["guess"] is None else {"guess": (fitted["guess"], fitted["guess_simulations"])}
        with_vivit = "regress" in self.stages
        vivit = {"vivit": (self.stages["regress"][clip].row()["scene"], 0)} if with_vivit else {}
        return {
            **vivit,
            **guess,
            "greedy": (greedy_row(self.stages, clip)["scene"], 0),
            f"best@{len(ranked)}": (ranked[0]["scene"], len(ranked)),
            "cmaes": (searched["scene"], len(ranked) + searched["simulations"]),
            "search": (fitted["scene"], len(ranked) + fitted["simulations"]),
        }

    def completions(self, clip: int) -> dict[str, str]:
        """By method: the text that the model wrote. Searches and other models give a scene without words."""
        ranked = self.stages["best_of_k"][clip].rows()
        best = next(row for row in self.stages["infer"][clip].rows() if row["sample"] == ranked[0]["sample"])
        return {"greedy": greedy_row(self.stages, clip)["text"], f"best@{len(ranked)}": best["text"]}

    def true_events(self, clip: int) -> list[Event] | None:
        """What happens in a clip; None where it is not known."""
        if "events" not in self.stages:
            return None
        return [event_of_row(row) for row in self.stages["events"][clip].rows("events")]

    def seconds_by_method(self) -> dict[str, float]:
        """Seconds of one worker a clip, for best-of-K and the searches; NaN where the store no longer has them."""
        spent = {stage: self.stages[stage].compute_seconds() for stage in ("best_of_k", "cmaes", "fit")}
        each = {stage: np.nan if s is None else s / max(len(self), 1) for stage, s in spent.items()}
        best = each["best_of_k"]
        searches = {"cmaes": best + each["cmaes"], "search": best + each["fit"]}
        return {"vivit": 0.0, "guess": np.nan, "greedy": 0.0, "best": best, **searches}

    def answered(self) -> Iterator[tuple[int, list[tuple[Row, str]]]]:
        """Of each clip: its number, and by method the head of its row of scores and the answer's scene as text."""
        seconds = self.seconds_by_method()
        for clip in tqdm(range(len(self)), desc=f"score {self.name}", unit="clip", disable=None):
            head = {"suite": self.group(clip), "clip": clip}
            yield (
                clip,
                [
                    ({**head, "method": method, "simulations": cost, "seconds": seconds[method.split("@")[0]]}, scene)
                    for method, (scene, cost) in self.answers(clip).items()
                ],
            )

    def score_rows(self, schedule: Schedule, thresholds: Thresholds) -> Iterator[Row]:
        """A row of scores for each clip and method, with counts of events where the clip's events are known.

        Args:
            schedule: Of the clips.
            thresholds: By which the true events were found.
        """
        for clip, answers in self.answered():
            truth, events = reference(self.stages, clip, schedule), self.true_events(clip)
            completions = {} if events is None else self.completions(clip)
            for head, text in answers:
                scene = read_scene(text)
                found = score_with_pairs(scene, truth, schedule)
                row = {**head, **found.metrics}
                if events is not None:
                    said = completions.get(head["method"])
                    row |= score_events(scene, found.pairs, said, events, schedule, thresholds)
                yield row

    def best_of_k_rows(self) -> list[Row]:
        """What more samples gain: rows of series, k, iou, the mean over clips that the model has not seen."""
        total, clips = np.zeros(0), self._unseen()
        for clip in clips:
            rows = self.stages["best_of_k"][clip].rows()
            curve = best_of_k_curve(*(np.array([row[key] for row in rows]) for key in ("reward", "iou")))
            total = total + curve if len(total) else curve
        return [{"series": self.name, "k": k + 1, "iou": float(v)} for k, v in enumerate(total / max(len(clips), 1))]

    def search_rows(self) -> list[Row]:
        """What more simulations gain: rows of series, simulations, reward, the mean over the same clips."""
        rows = []
        for method, stage in (("cmaes", "cmaes"), ("search", "fit")):
            curve = mean_best_so_far(partial(self._histories, stage))
            rows += [{"series": f"{self.name}: {method}", "simulations": s, "reward": r} for s, r in curve]
        return rows

    def _histories(self, stage: str) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for clip in self._unseen():
            row = self.stages[stage][clip].row()
            yield np.array(row["spent"]), np.array(row["history"])

    def certainties(self) -> Iterator[tuple[list[Row], Scene, list[int], Scene | None]]:
        """Of each clip, as `spreads_by_kind` takes them: the search's certainty, its scene, instances, true scene."""
        for clip, found in enumerate(self.stages["fit"]):
            row = found.row()
            sampled = "sample" in self.stages
            truth = read_scene(self.stages["sample"][clip].row()["scene"]) if sampled else None
            yield row["certainty"], read_scene(row["scene"]), row["instance"], truth

    def _unseen(self) -> list[int]:
        return [clip for clip in range(len(self)) if clip not in self.used]


def forecast_rows(name: str, predicted: ShardedDataset) -> Iterator[Row]:
    """Rows of suite, method, iou (over the unseen part) and, for the search, seen, from the stage `predict`."""
    for clip in predicted:
        row = clip.row()
        head = {"suite": name, "clip": row["clip"], "simulations": 0, "seconds": np.nan}
        search = {"iou": row["search"], "seen": row["seen"], "simulations": row["simulations"]}
        yield {**head, "method": "search", **search}
        yield from ({**head, "method": method, "iou": row[column]} for method, column in FORECASTS.items())
