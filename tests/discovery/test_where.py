"""Laws of the search for where a scene fails: intervals of a path, and the region that holds them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from small_world import KNOWN, effect, thrown

from pipeline.discovery.fitting.model import Model, known_model, with_effect, with_free_region
from pipeline.discovery.tracks.arc import Arc
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.problem import build_problem
from pipeline.discovery.where.clean_part import CleanPart, Leftover, find_clean_part
from pipeline.discovery.where.intervals import bends_at, find_intervals, intervals_where
from pipeline.discovery.where.local_law import LawFits
from pipeline.discovery.where.path_evidence import Paths, paths_of
from pipeline.discovery.where.region_search import find_regions
from pipeline.errors import SceneError
from pipeline.scene.effects.discovery_rules import Start
from pipeline.scene.effects.kind import local_kind
from pipeline.scene.effects.region import Region, share_within
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import Effect, Scene, SceneObject
from pipeline.scene.text import read_scene, write_scene

SIGMA, PRICE = 0.002, 45.0
TIME = np.arange(61) / 60


def path(rng: np.random.Generator, *parts: tuple[float, float, float]) -> np.ndarray:
    """A straight path with noise, with an acceleration along x in each part (begin, end, m/s²)."""
    out = np.outer(TIME, [0.5, 0.2, 0.0])
    for begin, end, size in parts:
        out[:, 0] += 0.5 * size * (np.maximum(TIME - begin, 0) ** 2 - np.maximum(TIME - end, 0) ** 2)
    return out + rng.normal(0, SIGMA, out.shape)


def weights() -> np.ndarray:
    return np.tile([1 / SIGMA, 1 / SIGMA, 0.0], (len(TIME), 1))


def test_a_straight_path_has_no_interval(rng: np.random.Generator) -> None:
    assert all(not find_intervals(TIME, path(rng), weights(), PRICE).intervals for _ in range(20))


@pytest.mark.parametrize(("begin", "end", "size"), [(0.3, 0.6, 1.0), (0.0, 0.4, -1.5), (0.7, 1.0, 3.0)])
def test_the_ends_of_an_interval_are_found_and_its_acceleration(
    begin: float, end: float, size: float, rng: np.random.Generator
) -> None:
    drawn = [find_intervals(TIME, path(rng, (begin, end, size)), weights(), PRICE).intervals for _ in range(20)]
    found = np.median([(v.start, v.end, v.acceleration[0]) for (v,) in drawn], axis=0)
    assert found == pytest.approx((begin, end, size), rel=0.1, abs=0.02)
    assert all(v.acceleration[2] == 0 for (v,) in drawn)


def test_a_blow_is_an_interval_of_a_sample_or_two(rng: np.random.Generator) -> None:
    lengths = []
    for _ in range(20):
        (found,) = find_intervals(TIME, path(rng, (0.5, 0.5 + 1 / 60, 60.0)), weights(), PRICE).intervals
        assert found.acceleration[0] * (found.end - found.start) == pytest.approx(1.0, rel=0.1)
        lengths.append(found.end - found.start)
    assert np.median(lengths) < 2.5 / 60 and max(lengths) < 4.5 / 60


CLIPS = tuple(f"clip_{k}" for k in range(24))


def paths(rng: np.random.Generator, region: Region, size: float = 0.8, blown: int | None = None) -> Paths:
    """What straight motions through a square leave, with a push of so many m/s² along x in a region; in one recording a
    body is hit."""
    arcs, leftovers, explained = [], [], []
    sigma, rows = np.full(len(TIME), SIGMA), np.arange(len(TIME))
    for number, clip in enumerate(CLIPS):
        velocity = rng.uniform(-1.5, 1.5, 2)
        position = np.column_stack([rng.uniform(-0.6, 0.6, 2) + TIME[:, None] * velocity, np.full(len(TIME), 0.02)])
        speeds = np.tile([*velocity, 0.0], (len(TIME), 1))
        push = size * region.holds(TIME, position, speeds)
        left = path(rng)
        left[:, 0] += -np.diff(bends_at(TIME)[1], axis=1) @ push
        if number == blown:
            left[:, 1] += 0.2 * np.maximum(TIME - 0.505, 0)
        arcs.append(Arc(clip, 0, False, TIME, position, sigma, rows, np.zeros((len(TIME), 0, 3))))
        leftovers.append((Leftover(left, np.zeros((0, *left.shape)), weights()),))
        explained.append((find_intervals(TIME, left, weights(), PRICE),))
    clean = CleanPart(Model((), ()), np.zeros(0), np.zeros((0, 0)), tuple(leftovers), tuple(explained), 0.0, 0.0)
    return paths_of(tuple(arcs), clean, CLIPS, 0.05, 7.0)


@pytest.mark.parametrize(
    "region",
    [
        Region(after=0.4),
        Region(faster=1.2),
        Region(centre=(0.1, -0.1, 0.02), radius=0.3),
        Region(normal=(0.6, 0.8, 0.0), offset=0.1),
    ],
    ids=["after", "faster", "within", "beyond"],
)
@pytest.mark.parametrize("blown", [None, 3], ids=["", "with a blow"])
def test_the_region_is_of_the_kind_that_was_hidden(region: Region, blown: int | None, rng: np.random.Generator) -> None:
    shown = paths(rng, region, blown=blown)
    found = find_regions(shown, CLIPS)[0].region
    assert set(found.as_dict()) >= set(region.as_dict())  # a second condition may explain an edge or a blow
    samples = shown.samples
    says, true = (r.holds(samples.time, samples.position, samples.velocity) for r in (found, region))
    assert (says == true).mean() > 0.9


def test_what_fails_everywhere_has_no_part(rng: np.random.Generator) -> None:
    (found,) = find_regions(paths(rng, Region(after=-1.0)), CLIPS)
    assert found.region == Region()


def test_noise_has_no_region(rng: np.random.Generator) -> None:
    assert find_regions(paths(rng, Region(), size=0.0), CLIPS) == []


def test_a_known_law_acts_where_it_shows(rng: np.random.Generator) -> None:
    acts = (TIME >= 0.3) & (TIME <= 0.6)
    drawn = [path(rng, (0.29, 0.61, 0.4)) for _ in range(20)]
    found = [intervals_where(TIME, one, weights(), acts, (), price=7.0).intervals[0] for one in drawn]
    assert all((v.start, v.end) == pytest.approx((0.29, 0.61), abs=0.01) for v in found)
    assert np.mean([v.acceleration[0] for v in found]) == pytest.approx(0.4, rel=0.1)


def test_what_does_not_show_is_no_interval_of_a_law(rng: np.random.Generator) -> None:
    assert not any(intervals_where(TIME, path(rng), weights(), TIME > 0.5, (), price=15.0).intervals for _ in range(20))


def law_fits(rng: np.random.Generator, *effects: Effect) -> LawFits:
    """What a scene without effects leaves of throws with some."""
    known = known_scene(KNOWN)
    problem = build_problem(thrown(rng, 8, effects), known, 0.0, rng)
    model = known_model(known, problem.stacks)
    clean = find_clean_part(problem, model, model.start)
    left = paths_of(problem.arcs, clean, problem.clips, 0.05, float(np.log(problem.effective_rows)))
    return LawFits.of(problem, model, model.start, left)


def test_a_law_is_fitted_to_the_paths_with_its_region(rng: np.random.Generator) -> None:
    fits = law_fits(rng, Effect("air_drag", (("coefficient", 0.02),), None, Region(after=0.4)))
    law = fits.best(effect_kinds()["air_drag"], [(Region(), None), (Region(after=0.6), None)], 2)
    assert law is not None and set(law.region.as_dict()) == {"after"}
    assert law.region.after == pytest.approx(0.4, abs=0.05)
    assert law.numbers[0] == pytest.approx(0.02, rel=0.3)


@pytest.mark.filterwarnings("error")
def test_a_law_that_makes_the_motion_diverge_explains_nothing(rng: np.random.Generator) -> None:
    fits, kind = law_fits(rng, effect("air_drag", coefficient=0.02)), effect_kinds()["air_drag"]
    far = Start(np.array([1e200]), np.array([[1e199]]))
    wild = replace(kind, discovery=replace(kind.discovery, starts=lambda _: [far]))
    assert fits.best(wild, [(Region(), None)], 1) is None


def scene_text(only: str) -> str:
    """A scene's text with an effect that acts where `only` says."""
    plain = write_scene(Scene((SceneObject("sphere", (0.05,), 0.1, 0.5, name="ball"),)))
    return plain.replace("effects: []", f"effects:\n- {{name: air_drag, coefficient: 0.01, only: {only}}}")


@pytest.mark.parametrize(
    "only",
    [
        "{after: 0.5}",
        "{before: 1.0, faster: 2.5}",
        "{within: {center: [0.1, 0.2, 0.0], radius: 0.3}}",
        "{beyond: {normal: [1.0, 0.0, 0.0], offset: 0.25}}",
        '{slower: 0.4, clips: ["a"]}',
    ],
)
def test_where_an_effect_acts_is_written_as_it_was_read(only: str) -> None:
    scene = read_scene(scene_text(only))
    assert scene.effects[0].only is not None
    assert read_scene(write_scene(scene)) == scene
    assert Region.of(scene.effects[0].only.as_dict()) == scene.effects[0].only


def test_a_blow_acts_in_some_recordings_and_has_no_other_region() -> None:
    blow = "{name: impulse, time: 0.3, momentum: [0.1, 0.0, 0.0], only: ONLY}"
    text = scene_text("{after: 0.5}")
    line = next(row for row in text.splitlines() if "air_drag" in row)
    scene = read_scene(text.replace(line, "- " + blow.replace("ONLY", '{clips: ["a"]}')))
    assert scene.effects[0].only == Region(clips=("a",))
    with pytest.raises(SceneError, match="impulse has a time of its own; valid: clips"):
        read_scene(text.replace(line, "- " + blow.replace("ONLY", "{after: 0.5}")))


REGIONS = [
    Region(after=0.41),
    Region(before=0.47, normal=(0.6, 0.8, 0.0), offset=0.1),
    Region(centre=(0.1, -0.1, 0.0), radius=0.3),
    Region(slower=2.0),
]


@pytest.mark.parametrize("region", REGIONS, ids=["after", "beyond", "within", "slower"])
def test_the_shares_of_steps_sum_up_to_the_time_inside(region: Region, rng: np.random.Generator) -> None:
    gravity = np.array([0.0, 0.0, -9.81])
    start, velocity = np.array([-0.4, -0.4, 0.0]), np.array([*rng.uniform(0.5, 1.0, 2), rng.uniform(2.5, 3.0)])

    def inside(count: int) -> float:
        """Time inside during one second, from so many steps."""
        step = 1 / count
        t = (np.arange(count) + 0.5) * step
        path = start + t[:, None] * velocity * (1, 1, 0)
        speeds = velocity * (1, 1, 0) if region.slower is None else velocity + t[:, None] * gravity
        shares = share_within(region.edges, t, path, np.broadcast_to(speeds, path.shape), step, gravity)
        return float(shares.sum() * step)

    assert inside(40) == pytest.approx(inside(4000), abs=2e-3)


@pytest.mark.parametrize("region", REGIONS, ids=["after", "beyond", "within", "slower"])
def test_a_region_with_its_own_numbers_is_itself(region: Region) -> None:
    again = region.moved({name: value for name, (value, _) in region.free.items()})
    for name, (value, unit) in region.free.items():
        assert again.free[name] == (pytest.approx(value), unit)
    assert len(region.free) <= region.numbers


@pytest.mark.parametrize("region", REGIONS, ids=["after", "beyond", "within", "slower"])
def test_a_region_that_was_fitted_can_be_written_as_json(region: Region) -> None:
    known = known_scene({"objects": [{"name": "ball", "shape": "sphere", "radius": 0.05, "mass": 0.2}]})
    kind = local_kind(effect_kinds()["air_drag"], region)
    model = with_free_region(with_effect(Model((), ()), kind, known), region)
    found = model.region(kind, model.start)
    assert found is not None
    assert set(json.loads(json.dumps(found.as_dict()))) == set(region.as_dict())


@pytest.mark.parametrize(
    ("only", "words"),
    [
        ("{aftr: 0.5}", "only.aftr: unknown condition"),
        ("{within: {center: [0, 0, 0]}}", "only.within: must have the keys center and radius"),
        ("{after: soon}", "only.after: must be a finite number"),
        ("3", "only: must be a mapping of conditions"),
    ],
)
def test_a_condition_that_is_none_is_named(only: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        read_scene(scene_text(only))
