"""The loss of the words model on groups of examples of one kind and number of bodies."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from pipeline.model import decisions as d
from pipeline.model.fields import BINS, MOTION, NOTHING, SCENE_FIELDS
from pipeline.model.words_network import FRAMES, WordsNetwork

#: How much each part counts.
MIX = {"shape": 2.0, "events": 0.5, "time": 0.5, "scene": 1.0, "numbers": 1.0, "beside": 0.3}
USUAL_BODIES = 2.4  # of a clip of whole frames
MOTION_SCALE = [0.5] * 3 + [0.8] * 3 + [4.0] * 3  # m, m/s, rad/s that count as 1


def soft_targets(number: Tensor, field: Tensor) -> Tensor:
    """(M, BINS) Gaussians of one bin about shares (M,); an exact zero of a field that has them is one bin."""
    place = ((number + 1) / 2 * (BINS - 1)).clamp(0, BINS - 1)
    soft = torch.exp(-0.5 * (torch.arange(BINS, device=number.device) - place[:, None]) ** 2)
    hard = functional.one_hot(place.round().long(), BINS).to(soft.dtype)
    low, high, zero = (torch.as_tensor(a, device=number.device)[field] for a in (d.LOW, d.HIGH, d.ZERO))
    at_zero = -low / (high - low) * 2 - 1
    exact = zero & ((number - at_zero).abs() < 2e-6)
    soft = torch.where(exact[:, None], hard, soft)
    return soft / soft.sum(-1, keepdim=True)


def losses(model: WordsNetwork, group: dict[str, Tensor], colours: bool) -> dict[str, Tensor]:
    """Sums of losses.

    Args:
        model: The network.
        group: crops (B, N, T, C, S, S) int8, places (B, N, T, 14), numbers (B, N), shapes (B, N), motion (B, N, T, 9),
            soon (B, N, T, 8) of bodies, or frames (B, T, C, h, w) int8; and the arrays of `Answer` (B, L).
        colours: Whether the pictures show colours.
    """
    said, bodies = _states(model, group, colours)
    out = _of_answer(model, said, group)
    if bodies is not None:
        out["beside"] = _beside(model, bodies, group)
    return out


def log_probabilities(model: WordsNetwork, group: dict[str, Tensor], colours: bool) -> Tensor:
    """(B,) log-probabilities, nats, of the answers of a group as in `losses`: of each choice among all tokens, and of
    each number's bin."""
    said, _ = _states(model, group, colours)
    choice, field = group["choice"], group["field"]
    out = torch.zeros(choice.shape, device=said.device)
    of_tokens = model.qwen.lm_head(said).float().log_softmax(-1)
    out = torch.where(choice >= 0, of_tokens.gather(2, choice.clamp(min=0)[..., None])[..., 0], out)
    place = ((group["number"] + 1) / 2 * (BINS - 1)).round().clamp(0, BINS - 1).long()
    of_bins = model.bins(said).float().log_softmax(-1)
    return torch.where(field >= 0, of_bins.gather(2, place[..., None])[..., 0], out).sum(1)


def _states(model: WordsNetwork, group: dict[str, Tensor], colours: bool) -> tuple[Tensor, Tensor | None]:
    """The language model's states (B, L, width) that decide the answer, and those of bodies in the prompt."""
    frame = "frames" in group
    if frame:
        prompt, where = model.frame_prompt(group["frames"], colours)
    else:
        prompt, where = model.bodies_prompt(group["crops"], colours, group["places"], group["numbers"])
    p = prompt.shape[1]
    answer = model.embed_decisions(group["token"], group["share"], group["ask"], group["of"]).to(prompt.dtype)
    where = torch.cat([where, group["position"].expand(3, -1, -1)], 2)
    h = model.language_states(torch.cat([prompt, answer], 1), where)
    return h[:, p:], None if frame else h[:, 2:p]


def means(model: WordsNetwork, group: dict[str, Tensor], colours: bool) -> dict[str, Tensor]:
    """Mean losses: the scene's by clip, others by body."""
    clips = len(group["ask"])
    bodies = group["shapes"].numel() if "shapes" in group else USUAL_BODIES * clips
    return {k: v / (clips if k == "scene" else bodies) for k, v in losses(model, group, colours).items()}


def _of_answer(model: WordsNetwork, said: Tensor, group: dict[str, Tensor]) -> dict[str, Tensor]:
    out: dict[str, Tensor] = {}
    choice, field = group["choice"], group["field"]
    chosen = choice >= 0
    each = functional.cross_entropy(model.qwen.lm_head(said[chosen]).float(), choice[chosen], reduction="none")
    ask = group["ask"][chosen]
    out["shape"] = each[ask == d.ASK_SHAPE].sum()
    out["events"] = each[ask != d.ASK_SHAPE].sum()
    numbers = field >= 0
    f = field[numbers]
    log_p = model.bins(said[numbers]).float().log_softmax(-1)
    each = -(soft_targets(group["number"][numbers], f) * log_p).sum(-1) * torch.as_tensor(d.WEIGHT, device=f.device)[f]
    out["time"] = each[f == 0].sum()
    out["scene"] = each[(f > 0) & (f <= len(SCENE_FIELDS))].sum()
    out["numbers"] = each[f > len(SCENE_FIELDS)].sum()
    return out


def _beside(model: WordsNetwork, bodies: Tensor, group: dict[str, Tensor]) -> Tensor:
    """Of each body and frame: shape, motion, kinds of event that come before the next frame; mean over frames."""
    b, n = group["shapes"].shape
    read = model.beside(bodies.view(b, n, -1, bodies.shape[-1])[:, :, -FRAMES:]).float()
    here = group["places"][..., 0] > 0
    shape, motion, soon = read.split([NOTHING + 1, MOTION, len(d.KINDS)], -1)
    wrong = functional.cross_entropy(
        shape.flatten(0, 2), group["shapes"].repeat_interleave(FRAMES, 1).flatten(), reduction="none"
    )
    off = motion - group["motion"] / torch.tensor(MOTION_SCALE, device=read.device)
    moved = functional.smooth_l1_loss(off, torch.zeros_like(off), reduction="none").sum(-1)
    happens = functional.binary_cross_entropy_with_logits(soon, group["soon"].float(), reduction="none").sum(-1)
    known = here & (group["shapes"] != NOTHING)[..., None]
    return ((wrong.view_as(here) * here).sum() + ((moved + happens) * known).sum()) / FRAMES
