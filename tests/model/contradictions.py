"""Reads what `<think>` says and holds every sentence against the clip, with a logic of its own.

Nothing here comes from `pipeline.model.language`: bodies are followed by where they are at each step, surface points by
finite differences, and areas by counting pixels.
"""

import re

import numpy as np

from pipeline.physics.trace import Trace
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import Scene

RATE, FPS = 240, 30
MOVING = 0.03  # m/s; slower is rest
HIT = 0.2  # m/s
VISIBLE = 32.0  # px of 480x320
HALF_CENT = 0.005  # s, to which times are rounded
LEVER = 0.1  # m

_SENTENCE = re.compile(
    r"t=(?P<time>\d+\.\d\d)s: object (?P<first>\d+) (?:hits object (?P<second>\d+)|(?P<said>hits the ground|"
    r"(?:enters|leaves) the view|(?:starts|stops) (?:rolling|sliding)))\."
)


def contradictions(text: str, scene: Scene, trace: Trace, masks: np.ndarray) -> list[str]:
    """What is wrong with the words of `<think>`; masks: (F, H, W) of every frame."""
    header, *lines = text.splitlines()
    wrong = []
    count, names = re.fullmatch(r"(\d+) objects?: (.*)\.", header).groups()  # type: ignore[union-attr]
    if tuple(names.split(", ")) != scene.shapes or int(count) != len(scene.objects):
        wrong.append(f"{header!r}, but there are {scene.shapes}")
    clip = _Clip(scene, trace, masks)
    earliest = 0.0
    for line in lines:
        found = _SENTENCE.fullmatch(line)
        if found is None:
            wrong.append(f"{line!r} is no sentence")
            continue
        time, first = float(found["time"]), int(found["first"]) - 1
        if time < earliest:
            wrong.append(f"{line!r} comes after t={earliest}")
        earliest = time
        second = None if found["second"] is None else int(found["second"]) - 1
        wrong += [f"{line!r}: {fault}" for fault in clip.faults(found["said"] or "hits", time, first, second)]
    return wrong + _sequences(text, len(scene.objects))


class _Clip:
    def __init__(self, scene: Scene, trace: Trace, masks: np.ndarray) -> None:
        self.scene, self.trace, self.steps = scene, trace, len(trace.position) - 1
        scale = 480 * 320 / masks[0].size
        self.areas = np.stack([(masks == i + 1).sum((1, 2)) * scale for i in range(len(scene.objects))], 1)

    def faults(self, said: str, time: float, first: int, second: int | None) -> list[str]:
        if said == "hits":
            assert second is not None
            return self.hit(time, first, second)
        if said == "hits the ground":
            return self.hit(time, first, -1)
        if said.endswith("the view"):
            return self.view(time, first, said.startswith("enters"))
        verb, motion = said.split()
        return self.start(time, first, motion) if verb == "starts" else self.stop(time, first, motion)

    def pair(self, first: int, second: int) -> np.ndarray:
        """Rows of contacts between the two."""
        c = self.trace.contacts
        return np.flatnonzero(((c.first == first) & (c.second == second)) | ((c.first == second) & (c.second == first)))

    def carried(self, body: int, point: np.ndarray, step: int, other_step: int) -> np.ndarray:
        """Where the body's point that is at `point` at `step` is at the other step; the ground stays."""
        if body < 0:
            return point
        turn = matrix_from_quaternion(self.trace.quaternion[:, body])
        local = turn[step].T @ (point - self.trace.position[step, body])
        return self.trace.position[other_step, body] + turn[other_step] @ local

    def relative_velocity(self, row: int) -> np.ndarray:
        """Of the first body's contact point against the second's, m/s, over the step before the contact acts."""
        c = self.trace.contacts
        step = int(c.step[row])
        before = max(step - 1, 0)
        now = before + 1
        a, b = (
            [self.carried(int(body), c.position[row], step, s) for s in (before, now)]
            for body in (c.first[row], c.second[row])
        )
        return ((a[1] - a[0]) - (b[1] - b[0])) * RATE

    def hit(self, time: float, first: int, second: int) -> list[str]:
        c = self.trace.contacts
        rows = self.pair(first, second)
        near = rows[np.abs(c.step[rows] / RATE - time) <= HALF_CENT + 1e-9]
        if not len(near):
            return ["they do not touch then"]
        began = c.step[near].min()
        if ((c.step[rows] < began) & (c.step[rows] >= began - 0.05 * RATE)).any():
            return ["they touched before"]
        opening = near[c.step[near] == began]
        closing = max(-float(self.relative_velocity(row) @ c.normal[row]) for row in opening)
        faults = []
        if closing < 0.8 * HIT:
            faults.append(f"they close at {closing:.2f} m/s only")
        pushed = rows[(c.step[rows] >= began) & (c.step[rows] < began + 0.02 * RATE)]
        if np.abs(c.force[pushed]).max() == 0:
            faults.append("neither pushes the other")
        exact, last = began / RATE * FPS, len(self.areas) - 1
        in_view = self.areas[[min(int(np.floor(exact - 1e-9)), last), min(int(np.ceil(exact)), last)]] >= VISIBLE
        if not in_view[:, [b for b in (first, second) if b >= 0]].any():
            faults.append("nobody sees it")
        return faults

    def view(self, time: float, body: int, enters: bool) -> list[str]:
        frame = round(time * FPS)
        seen = self.areas[:, body] >= VISIBLE
        faults = []
        if frame == 0 or seen[frame - 1] == enters:
            faults.append(f"it was {'in' if enters else 'out of'} view before")
        if seen[frame] != enters or (frame + 1 < len(seen) and seen[frame + 1] != enters):
            faults.append(f"it is {'out of' if enters else 'in'} view then")
        return faults

    def undisturbed(self, body: int, start: float, stop: float) -> float:
        """`stop`, or when the body first touches another after `start`."""
        c = self.trace.contacts
        touches = c.step[((c.first == body) | (c.second == body)) & (c.second >= 0) & (c.step > start * RATE)]
        return min(stop, (touches.min() - 1) / RATE) if len(touches) else stop

    def speeds(self, body: int, start: float, stop: float) -> tuple[np.ndarray, np.ndarray]:
        """Speed, and rate of turning times `LEVER`, m/s, of the steps in a stretch of time, by differences."""
        a, b = max(round(start * RATE), 0), min(round(stop * RATE), self.steps)
        moved = np.linalg.norm(np.diff(self.trace.position[a : b + 1, body], axis=0), axis=1) * RATE
        q = self.trace.quaternion[a : b + 1, body]
        cosine = np.clip(np.abs(np.sum(q[1:] * q[:-1], 1)), 0, 1)
        return moved, 2 * np.arccos(cosine) * RATE * LEVER

    def slips(self, body: int, start: float, stop: float) -> np.ndarray:
        """Speeds of the body's contact points on the ground in a stretch of time, m/s."""
        c = self.trace.contacts
        rows = self.pair(body, -1)
        rows = rows[(c.step[rows] >= start * RATE) & (c.step[rows] <= stop * RATE)]
        velocity = np.array([self.relative_velocity(row) for row in rows]).reshape(-1, 3)
        return np.hypot(velocity[:, 0], velocity[:, 1])

    def stands(self, body: int, start: float, stop: float) -> bool:
        """Whether the body is on the ground for most of a stretch of time, and does not hop over it."""
        steps = self.trace.contacts.step[self.pair(body, -1)]
        return len(np.unique(steps[(steps >= start * RATE) & (steps <= stop * RATE)])) > 0.5 * (stop - start) * RATE

    def travel(self, body: int, start: float, stop: float) -> float:
        """How far the body gets between two times, m, turning by a radian counted as `LEVER`."""
        a, b = max(round(start * RATE), 0), min(round(stop * RATE), self.steps)
        q = self.trace.quaternion[[a, b], body]
        turn = 2 * np.arccos(min(abs(float(q[0] @ q[1])), 1.0))
        return float(np.linalg.norm(self.trace.position[b, body] - self.trace.position[a, body]) + LEVER * turn)

    def stop(self, time: float, body: int, motion: str) -> list[str]:
        end = self.undisturbed(body, time, time + 0.2)
        faults = []
        gone = self.travel(body, time + HALF_CENT, max(end, time + HALF_CENT))
        later = self.slips(body, time + HALF_CENT, end)
        rocks = motion == "sliding" and len(later) > 0 and later.max() < MOVING  # on an edge that rests
        if end > time + 0.02 and gone > 2 * MOVING * (end - time) + 0.002 and not rocks:
            faults.append(f"it goes on: {1000 * gone:.1f} mm in {end - time:.2f} s")
        path = sum(float(each.sum()) for each in self.speeds(body, time - 0.2, time)) / RATE  # it may turn back
        if path < MOVING * 0.1:
            faults.append(f"it was at rest before: {1000 * path:.1f} mm in 0.2 s")
        speed, turning = self.speeds(body, time - 0.1 - HALF_CENT, time)
        slips = self.slips(body, time - 0.1 - HALF_CENT, time)
        if not len(slips):
            return [*faults, "it was not on the ground before"]
        share = slips.mean() / max(speed.mean(), turning.mean())
        if motion == "sliding" and share < 0.1 and slips.max() < 0.1:
            faults.append(f"it did not slide: its contacts slipped at {share:.2f} of its speed")
        usual = np.median(slips) / max(speed.mean(), turning.mean())  # a rim that comes down slips for a moment
        if motion == "rolling" and share > 0.5 and usual > 0.2:
            faults.append(f"it did not roll: its contacts slipped at {share:.2f} of its speed")
        if motion == "rolling" and self.scene.objects[body].shape == "box":
            faults.append("boxes do not roll")
        return faults

    def start(self, time: float, body: int, motion: str) -> list[str]:
        end = self.undisturbed(body, time + 0.02, time + 0.1)
        slips = self.slips(body, time + HALF_CENT, end)
        if not len(slips) and end == time + 0.1:  # it may hop first
            end = self.undisturbed(body, time + 0.02, time + 0.15)
            slips = self.slips(body, time + HALF_CENT, end)
        after, _ = self.speeds(body, time + HALF_CENT, end)
        if not len(slips) or not len(after):
            return [] if end < time + 0.15 else ["it is not on the ground then"]
        if end < time + 0.06:
            return []  # hit again too soon to tell
        alone = self.undisturbed(body, time - 0.15, time) == time
        earlier = self.slips(body, time - 0.1, time - HALF_CENT - 1 / RATE)
        share = slips.mean() / max(after.mean(), 1e-9)
        faults = []
        if motion == "rolling":
            if np.median(after) < 0.8 * MOVING:
                faults.append("it rests then")
            if share > 0.5 or slips.mean() > max(0.1, 0.2 * after.mean()):
                faults.append(f"its contacts still slip at {slips.mean():.3f} m/s of {after.mean():.3f}")
            if self.scene.objects[body].shape == "box":
                faults.append("boxes do not roll")
            moved = self.travel(body, time - 0.1, time - HALF_CENT) > 0.1 * MOVING
            stood = self.stands(body, time - 0.1, time - HALF_CENT) and len(earlier) > 0
            if stood and alone and moved and earlier.max() < slips.mean():
                faults.append("it slipped less before")
        else:
            if share < 0.05 or slips.max() < 0.05:
                faults.append(f"its contacts hold: they slip at {slips.mean():.3f} m/s of {after.mean():.3f}")
            if len(earlier) and alone and earlier.mean() > slips.mean():
                faults.append("it slipped more before")
        return faults


def _sequences(text: str, objects: int) -> list[str]:
    """Sentences about one object's motion that cannot follow one another unless something hits it in between."""
    wrong = []
    for k in range(1, objects + 1):
        state = ""
        for line in text.splitlines()[1:]:
            _, what = line.split(": ", 1)
            if "hits" in what and re.search(rf"object {k}\b", what):
                state = ""
            if not what.startswith(f"object {k} st"):
                continue
            verb, motion = what.rstrip(".").split()[-2:]
            if verb == "starts" and state == motion:
                wrong.append(f"{line!r}: it did so already")
            if verb == "stops" and state not in ("", motion):
                wrong.append(f"{line!r}: it was {state}")
            state = motion if verb == "starts" else "resting"
    return wrong
