"""Hidden worlds: the two engines agree, recipes repeat, verdicts are judged as the issue says."""

import numpy as np
import pytest

from pipeline.clips.intervals import wilson
from pipeline.discovery.tracks.known_scene import FITTED
from pipeline.hidden.engine import ENGINES, run_event_driven, run_mujoco
from pipeline.hidden.judge import confusion, equals_of, judge, macro_f1
from pipeline.hidden.law_perturbation import WRONG_LAWS, LawPerturbation
from pipeline.hidden.recipe import Recipe, perturbed_kinds, recipe_of
from pipeline.hidden.scenario import EVERY, draw_fit, draw_name, draw_scenario
from pipeline.hidden.world import make_world
from pipeline.scene.effects import hiding
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import Effect, Scene, SceneObject

TIMES = np.arange(31) / 60
BALL = SceneObject(
    "sphere", (0.05,), 0.2, position=(0, 0, 3), velocity=(2, 1, 1), angular_velocity=(5, -10, 20), name="ball"
)


@pytest.mark.parametrize(
    "effect",
    [
        Effect("air_drag", (("coefficient", 0.01),)),
        Effect("magnus_lift", (("coefficient", 0.002),)),
        Effect("rotating_frame", (("angular_velocity", 0.5),)),
        Effect("buoyancy", (("fraction", 0.3),)),
        Effect("impulse", (("time", 0.2), ("momentum", (0.1, 0.0, 0.1)))),
        Effect("tilted_gravity", (("tilt", (0.1, 0.05)),)),
    ],
    ids=lambda e: e.name,
)
def test_in_the_air_both_engines_agree(effect: Effect) -> None:
    scene = Scene((BALL,), effects=(effect,))
    ours, mujoco = (run(scene, TIMES, LawPerturbation()).position for run in (run_event_driven, run_mujoco))
    free = run_mujoco(Scene((BALL,)), TIMES, LawPerturbation()).position
    start = np.linspace(0, 1, len(TIMES))[:, None, None]
    apart = ours - mujoco
    assert (
        np.abs(apart - start * apart[-1]).max() < 0.02 * np.abs(mujoco - free).max() + 1e-3
    )  # MuJoCo's Euler drifts linearly


@pytest.mark.parametrize(("name", "coefficient"), [("air_drag", 0.01), ("magnus_lift", 0.002)])
def test_bullet_agrees_in_the_air(name: str, coefficient: float) -> None:
    pytest.importorskip("pybullet", reason="an extra: benchmark")
    scene = Scene((BALL,), effects=(Effect(name, (("coefficient", coefficient),)),))
    ours, bullet = (ENGINES[e](scene, TIMES, LawPerturbation()).position for e in ("events", "bullet"))
    assert np.abs(ours - bullet).max() < 0.03


def test_a_ball_bounces_off_with_its_restitution_at_once() -> None:
    ball = SceneObject("sphere", (0.05,), 0.2, 0.0, position=(0, 0, 0.55), name="ball")
    scene = Scene((ball,), effects=(Effect("restitution", (("coefficient", 0.8),)),))
    z = run_event_driven(scene, np.arange(241) / 240, LawPerturbation()).position[:, 0, 2]
    assert z.min() > 0.049
    assert z[100:].max() - 0.05 == pytest.approx(0.5 * 0.8**2, rel=0.02)


def test_a_puck_stops_where_friction_says() -> None:
    puck = SceneObject("cylinder", (0.05, 0.02), 0.2, 0.3, position=(0, 0, 0.01), velocity=(1, 0, 0), name="puck")
    x = run_event_driven(Scene((puck,)), TIMES, LawPerturbation()).position[-1, 0, 0]
    assert x == pytest.approx(1 / (2 * 0.3 * 9.81), rel=0.01)


def test_viscous_friction_slows_a_puck_that_hops_as_it_slows_one_that_does_not() -> None:
    c, mu, speed = 0.3, 0.35, 2.5
    puck = SceneObject("cylinder", (0.05, 0.02), 0.2, mu, position=(0, 0, 0.01), velocity=(speed, 0, 0), name="puck")
    scene = Scene((puck,), effects=(Effect("viscous_friction", (("coefficient", c),)),))
    x = run_mujoco(scene, TIMES, LawPerturbation()).position[:, 0, 0]
    rate, friction = c / 0.2, mu * 9.81
    law = (speed + friction / rate) / rate * (1 - np.exp(-rate * TIMES)) - friction / rate * TIMES
    without = speed * TIMES - friction / 2 * TIMES**2
    assert abs(x[-1] - law[-1]) < 0.1 * abs(without[-1] - law[-1])


def test_a_world_is_a_function_of_its_recipe_and_generator() -> None:
    recipe = Recipe(3, ("air_drag",), clips=2)
    first, second = (make_world(recipe, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(first.tracks[0].position, second.tracks[0].position)
    assert first.truth == second.truth and "effects" not in first.known


def test_recipes_go_round_their_list() -> None:
    names = ["air_drag", "none", "unlisted", "air_drag+wind"]
    recipes = [recipe_of(k, names, 10, 0.002, 4, rng=np.random.default_rng(k)) for k in range(4)]
    assert [r.effects for r in recipes] == [("air_drag",), (), (), ("air_drag", "wind")]
    assert recipes[2].unlisted is not None and recipes[1].unlisted is None


def test_worlds_with_nothing_hidden_are_of_every_kind_and_know_what_others_know(rng: np.random.Generator) -> None:
    names, fits = set(), set()
    for _ in range(300):
        name = draw_name((), bool(rng.integers(2)), rng)
        names.add(name)
        fits.add(draw_scenario(name, (), rng).fit)
    assert names == set(EVERY)
    assert len(fits) == 2 ** len(FITTED)


def test_what_would_be_the_effect_by_another_name_is_known_and_nothing_else_depends_on_it(
    rng: np.random.Generator,
) -> None:
    for name, kind in effect_kinds().items():
        fits = {draw_fit((name,), rng) for _ in range(200)}
        assert not any(number in fit for fit in fits for number in kind.discovery.needs_known)
        assert len(fits) == 2 ** (len(FITTED) - len(kind.discovery.needs_known))


def test_every_effect_is_hidden_in_scenarios_and_engines_that_exist() -> None:
    assert set(hiding.ENGINES) == set(ENGINES)
    everywhere = [kind for kind in effect_kinds().values() if not kind.discovery.local]
    for kind in everywhere:
        assert kind.hiding is not None and (kind.hiding.values is None) != (kind.hiding.draw is None)
        assert set(kind.hiding.scenarios) <= set(EVERY) and set(kind.hiding.engines) <= set(ENGINES)
    assert set(perturbed_kinds().values()) == set(WRONG_LAWS)


def test_an_equal_of_an_effect_that_is_struck_off_is_no_wrong_name() -> None:
    heavier = {"name": "gravity_error", "gravity": 10.5}
    struck = {**truth(), "effects": [heavier], "struck": "gravity_error", "scenario": "throw", "clips": 12}
    assert judge(verdict("length_scale"), struck).right and not judge(verdict("length_scale"), struck).false
    assert judge(verdict("unknown"), struck).right
    assert judge(verdict("air_drag"), struck).false
    assert judge(verdict("buoyancy"), struck).false  # which makes nothing heavier
    lighter = {**struck, "effects": [{**heavier, "gravity": 9.5}]}
    assert judge(verdict("buoyancy"), lighter).right


def test_equals_are_at_most_three_and_hold_only_where_the_physics_is_the_same() -> None:
    for scenario in EVERY:
        for name, kind in effect_kinds().items():
            effect = {"name": name, **{p.name: p.scale for p in kind.parameters}}
            equals = equals_of(effect, {"scenario": scenario, "clips": 12})
            assert len(equals) <= 3 and name not in equals and equals <= set(effect_kinds())
    tilt = {"name": "tilted_gravity", "tilt": [0.1, 0.0]}
    assert equals_of(tilt, {"scenario": "throw", "clips": 12})
    assert not equals_of(tilt, {"scenario": "pair", "clips": 12})  # an attractor pulls all masses alike
    obstacle = {"name": "hidden_obstacle", "position": [0, 0, 1], "size": 0.2}
    assert equals_of(obstacle, {"scenario": "throw", "clips": 1}) == {"impulse"}
    assert not equals_of(obstacle, {"scenario": "throw", "clips": 12})


def verdict(*names: str, equivalent: tuple[tuple[str, ...], ...] = ()) -> dict[str, object]:
    return {"effects": list(names), "equivalent": [list(s) for s in equivalent], "parameters": {}}


def truth(*names: str, unlisted: str | None = None) -> dict[str, object]:
    return {"effects": [{"name": n} for n in names], "unlisted": unlisted}


def test_verdicts_are_right_by_name_or_by_a_small_set() -> None:
    assert judge(verdict("air_drag"), truth("air_drag")).right
    assert judge(verdict("wind", equivalent=(("wind", "air_drag"),)), truth("air_drag")).right
    large = ("a", "b", "c", "air_drag")
    assert not judge(verdict("a", equivalent=(large,)), truth("air_drag")).right
    assert judge(verdict(), truth()).right and judge(verdict("wind"), truth()).false
    assert judge(verdict("unknown"), truth(unlisted="swirl")).right
    assert judge(verdict("wind"), truth(unlisted="swirl")).false
    both = judge(verdict("wind"), truth("wind", "buoyancy"))
    assert both.some and not both.right


def test_beside_an_unlisted_law_the_remainder_has_to_be_reported() -> None:
    rest = {"remainder": {"share": 0.3}}
    beside = truth("air_drag", unlisted="swirl")
    assert judge({**verdict("air_drag"), **rest}, beside).right
    assert not judge(verdict("air_drag"), beside).right
    assert not judge(verdict("unknown"), beside).right
    assert judge({**verdict("tilted_gravity"), **rest}, beside).false
    alone = truth(unlisted="cubic_drag")
    assert judge({**verdict("air_drag"), **rest}, alone).right  # of the same kind
    assert judge(verdict("air_drag"), alone).false
    assert judge({**verdict("tilted_gravity"), **rest}, alone).false
    assert judge({**verdict("air_drag"), **rest}, truth(unlisted="swirl")).false


def test_each_of_two_effects_may_be_named_by_an_equal() -> None:
    scales, hidden = ("gravity_error", "buoyancy", "length_scale"), truth("wind", "buoyancy")
    by_equal = judge(verdict("wind", "gravity_error", equivalent=(scales,)), hidden)
    assert by_equal.right and not by_equal.false
    assert not judge(verdict("wind", "gravity_error"), hidden).right
    other = judge(verdict("air_drag", "gravity_error", equivalent=(scales,)), hidden)
    assert not other.right and other.some and other.false
    assert not judge(verdict("wind", "gravity_error", "impulse", equivalent=(scales,)), hidden).right
    assert not judge(verdict("gravity_error", equivalent=(("gravity_error", "wind", "buoyancy"),)), hidden).right


def test_a_direction_is_compared_up_to_its_period_and_a_wrong_law_has_no_true_numbers() -> None:
    hidden = {"effects": [{"name": "anisotropic_friction", "ratio": 0.9, "angle": -1.55}], "unlisted": None}
    told = verdict("anisotropic_friction") | {"parameters": {"angle": {"value": 1.56, "stderr": 0.03}}}
    found = judge(told, hidden)
    assert found.errors["anisotropic_friction.angle"] < 0.05 and found.covered["anisotropic_friction.angle"] == 1
    assert judge(told, {**hidden, "wrong": "drag_slope"}).errors == {}


def test_wilson_and_the_confusion_matrix() -> None:
    low, high = wilson(95, 100)
    assert low == pytest.approx(0.888, abs=0.002) and high == pytest.approx(0.978, abs=0.002)
    judged = [judge(verdict("air_drag"), truth("air_drag")), judge(verdict(), truth("wind"))]
    rows, columns, counts = confusion(judged)
    assert counts.sum() == 2 and rows == ["air_drag", "wind"] and "none" in columns
    assert macro_f1(judged) == pytest.approx(0.5)
