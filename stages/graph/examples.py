"""The worked examples of a few-shot prompt: the first clips of train, with the completions that training would show."""

from dataclasses import dataclass

from pipeline.errors import ParamsError
from pipeline.shards.dataset import Clip, open_shards
from stages.graph.clip_pictures import picture_stage
from stages.graph.run import folder

SUITE = "train"


@dataclass(frozen=True)
class Example:
    """content: the hash of the shard with its pictures, so that these are in the keys of what was answered."""

    clip: int
    completion: str
    content: str


def choose_examples(shots: int, suite: str, kind: str) -> list[Example]:
    """So many examples for the clips of a suite, with pictures of model.input `kind`.

    Raises ParamsError where train has fewer, or is the suite itself (a clip would be shown with its answer), ShardError
    where train's completions or pictures are missing.
    """
    if not shots:
        return []
    if suite == SUITE:
        raise ParamsError(f"`infer.shots` is {shots}: the examples are clips of {SUITE}; valid: any other suite")
    told, shown = (open_shards(folder(stage, SUITE)) for stage in ("tokenize", picture_stage(kind)))
    if shots > min(len(told), len(shown)):
        raise ParamsError(
            f"`infer.shots` is {shots}, but {told.folder} has {len(told)} clips and {shown.folder} "
            f"{len(shown)}; valid: at most as many"
        )
    return [Example(k, told[k].row()["completion"], shown[k].shard.entry.content) for k in range(shots)]


def example_clip(example: Example, kind: str) -> Clip:
    """The example's pictures, checked by hash."""
    clip = open_shards(folder(picture_stage(kind), SUITE))[example.clip]
    clip.shard.verify()
    return clip
