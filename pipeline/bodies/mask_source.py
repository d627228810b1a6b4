"""Where the masks of a clip come from: a file, our network, or a published segmenter that follows what it finds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.bodies.prompts import Prompts
from pipeline.errors import ParamsError
from pipeline.vision.recordings.clip_folder import masks_beside

WEIGHTS = Path(__file__).resolve().parents[2] / "models" / "masks"  # the networks that ship
FAMILIES = ("sam2", "edgetam")  # as pipeline.bodies.networks.published_models has them, which imports torch


@dataclass(frozen=True)
class MaskSource:
    """given: a file or folder of masks. published: family and folder of a segmenter. Neither: our network."""

    given: Path | None = None
    published: tuple[str, Path] | None = None


def mask_source(place: Path | None, masks: str | Path | None, prompts: Prompts) -> MaskSource:
    """Where masks come from.

    Args:
        place: The clip; masks beside it are used where there are no prompts. None: these are not looked for.
        masks: What the user named: a path, or `sam2:PATH`, `edgetam:PATH`.
        prompts: For masks that are found.

    Raises:
        ParamsError: For a file of masks and prompts at once.
        ModelError: For a segmenter without a path.
    """
    if str(masks).partition(":")[0] in FAMILIES:
        from pipeline.bodies.networks.published_models import published_source

        return MaskSource(published=published_source(str(masks)))
    if masks is None:
        return MaskSource(None if prompts or place is None else masks_beside(place))
    if prompts:
        raise ParamsError(
            f"--masks {masks}: points, boxes and numbers of objects are for masks that are found; give one"
        )
    return MaskSource(Path(masks))
