"""Laws of textures: a texel lies on the surface and is found again, and what was not seen is mirrored or filled in."""

import numpy as np
import pytest

from pipeline.editing.surface_texture import (
    INVENTED,
    MEASURED,
    MIRRORED,
    completed,
    cube_directions,
    surface_points,
)
from pipeline.scene.scene import SceneObject

SIZE = 12


@pytest.mark.parametrize(("shape", "size"), [("sphere", (0.3,)), ("box", (0.2, 0.4, 0.6)), ("cylinder", (0.2, 0.5))])
def test_texels_lie_on_the_surface(shape: str, size: tuple[float, ...]) -> None:
    x, y, z = np.moveaxis(surface_points(SceneObject(shape, size, 1.0), SIZE), -1, 0)
    if shape == "sphere":
        reach = np.sqrt(x**2 + y**2 + z**2) / 0.3
    elif shape == "box":
        reach = np.maximum.reduce([abs(x) / 0.1, abs(y) / 0.2, abs(z) / 0.3])
    else:
        reach = np.maximum(np.hypot(x, y) / 0.2, abs(z) / 0.25)
    np.testing.assert_allclose(reach, 1, atol=1e-9)


def test_what_was_seen_on_one_side_is_mirrored_to_the_other() -> None:
    directions = cube_directions(SIZE)
    colour = np.stack([directions[..., 0] ** 2, directions[..., 1], directions[..., 2]], -1)  # symmetric in x
    seen = directions[..., 0] > 0
    out, kind = completed(colour, seen)
    np.testing.assert_allclose(out, colour, atol=1e-6)
    assert (kind[seen] == MEASURED).all()
    assert (kind[~seen] == MIRRORED).all()


def test_what_no_mirror_shows_is_filled_in_from_around_it() -> None:
    seen = cube_directions(SIZE)[..., 2] ** 2 < 0.3
    colour = np.where(seen[..., None], [10.0, 120.0, 200.0], 0.0)
    out, kind = completed(colour, seen)
    np.testing.assert_allclose(out, np.broadcast_to([10.0, 120.0, 200.0], out.shape), rtol=1e-5)
    assert (kind[~seen] == INVENTED).all()
