"""What a clip determines, and what it does not."""

from dataclasses import replace

import numpy as np
from targets import evaluator, exact_target, sampled

from pipeline.scene.scene import Scene, SceneObject
from pipeline.search.certainty import (
    PRIOR_PRECISION,
    Certainty,
    certainties,
    remove_information,
    scale_direction,
    weakly_identified,
)
from pipeline.search.parameters import search_space


def lone_ball(rng: np.random.Generator) -> Scene:
    ball = SceneObject("sphere", (0.15,), 1.0, position=(0, 0.2, 0.15), velocity=(0.4, -0.3, 0))
    return replace(sampled(rng, 1), objects=(ball,))


def known(scene: Scene) -> list[Certainty]:
    """What an exact look at a scene tells of it."""
    own = evaluator(scene)
    return certainties(own, scene, own.pairs(scene))


def test_the_mass_of_a_lone_body_is_not_determined_and_its_motion_is(rng: np.random.Generator) -> None:
    scene = lone_ball(rng)
    found = {c.place: c for c in known(scene)}
    assert not found["objects[0].mass"].determined
    assert "mass" in weakly_identified(list(found.values()))
    assert found["objects[0].velocity[0]"].determined
    assert all(0 <= c.share <= 1 and c.spread > 0 for c in found.values())


def test_a_world_that_grows_about_the_camera_looks_the_same(rng: np.random.Generator) -> None:
    scene = sampled(rng, 2)
    space = search_space(scene)
    grown = space.scene(space.encode() + 0.1 * scale_direction(space))
    assert grown.objects[0].size != scene.objects[0].size
    # In the first frames: contacts, whose time constants do not grow, part what collides sooner or later.
    ours, theirs = (exact_target(s).masks[:3] for s in (scene, grown))
    assert (ours != theirs).sum() < 0.1 * ((ours > 0) | (theirs > 0)).sum()


def test_information_along_a_direction_is_taken_and_no_other(rng: np.random.Generator) -> None:
    rows = rng.normal(size=(9, 5))
    information, direction = rows.T @ rows, rng.normal(size=5)
    left = remove_information(information, direction)
    np.testing.assert_allclose(left @ direction, 0, atol=1e-9)
    assert np.linalg.eigvalsh(left).min() > -1e-9
    across = rng.normal(size=5)
    across -= direction * (direction @ information @ across) / (direction @ information @ direction)
    np.testing.assert_allclose(left @ across, information @ across, atol=1e-9)


def test_nothing_is_known_worse_than_by_its_bounds(rng: np.random.Generator) -> None:
    scene = lone_ball(rng)
    space = search_space(scene)
    for c, span in zip(known(scene), space.span, strict=True):
        if c.kind != "mass":
            assert c.spread <= span / np.sqrt(PRIOR_PRECISION) + 1e-9
