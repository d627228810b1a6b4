"""Soft targets of numbers."""

import numpy as np
import torch
from sampled_scenes import draw
from torch.nn import functional

from pipeline.language.codec import Codec
from pipeline.language.completion import REAL_PART, VECTORS, completion_grammar, write_completion
from pipeline.language.grammar import Number, split
from pipeline.language.tokenizer import build_tokenizer
from training.tiny.soft_numbers import SPREAD, SoftTargets, soft_loss, soft_targets

CODEC = Codec(build_tokenizer(), 12)


def places(text: str) -> list[tuple[Number, str, int]]:
    """The numbers of a completion without reasoning, as they are written, and where their tokens begin."""
    found, place = [], len(CODEC.prompt_ids)
    for element, written in split(completion_grammar(False, 1.0), text):
        if isinstance(element, Number):
            found.append((element, written, place))
        place += len(CODEC.segment_ids(element, written))
    return found


def target(soft: SoftTargets, place: int) -> dict[str, float]:
    here = soft.at == place
    return {CODEC.decode([int(i)]): float(s) for i, s in zip(soft.ids[here], soft.share[here], strict=True)}


def test_a_target_is_a_gaussian_about_the_number_and_zeros_and_heights_stay_hard(rng: np.random.Generator) -> None:
    gaussians = 0
    for scene in draw(int(rng.integers(2**31)), range(6)).scenes:
        text = write_completion(scene, None, 1.0)
        soft = soft_targets(CODEC, split(completion_grammar(False, 1.0), text))
        positions = 0
        for number, written, place in places(text):
            first, second = target(soft, place), target(soft, place + 1)
            positions += number == VECTORS["position"]
            if number == VECTORS["position"] and positions % 3 == 0:
                assert not first and not second
                continue
            assert abs(sum(first.values()) - 1) < 1e-5 and abs(sum(second.values()) - 1) < 1e-5
            value, spread = float(written), SPREAD[number]
            if value == (1 if number == REAL_PART else 0):
                assert first == {written[:-2]: 1} and second == {written[-2:]: 1}
                continue
            assert max(second, key=lambda tail: second[tail]) == written[-2:]
            drawn = np.array([float(written[:-2] + tail) for tail in second])
            expected = np.exp(-0.5 * ((drawn - value) / spread) ** 2)
            np.testing.assert_allclose(list(second.values()), expected / expected.sum(), atol=1e-5)
            # the weight of all numbers that have the first token of the written one
            step = 10.0**-number.decimals
            grid = np.arange(round((value - 3 * spread) / step), round((value + 3 * spread) / step) + 1) * step
            grid = grid[(grid > number.low - step / 2) & (grid < number.high + step / 2)]
            weight = np.exp(-0.5 * ((grid - value) / spread) ** 2)
            same_head = np.array([number.text(g)[:-2] == written[:-2] for g in grid])
            assert abs(first[written[:-2]] - weight[same_head].sum() / weight.sum()) < 0.01
            gaussians += len(first) > 1
    assert gaussians > 20


def test_the_loss_is_cross_entropy_with_these_targets(rng: np.random.Generator) -> None:
    log_p = torch.log_softmax(torch.as_tensor(rng.normal(0, 1, (2, 4, 5))), -1)
    labels = torch.tensor([[1, -100, 3, 2], [-100, 0, 4, -100]])
    nothing = SoftTargets(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.float32))
    plain = functional.cross_entropy(log_p.flatten(0, 1), labels.flatten(), ignore_index=-100)
    torch.testing.assert_close(soft_loss(log_p, labels, [nothing, nothing], 10), plain)
    soft = SoftTargets(np.array([12, 12]), np.array([3, 4]), np.array([0.75, 0.25], np.float32))
    expected = plain + (log_p[0, 2, 3] - 0.75 * log_p[0, 2, 3] - 0.25 * log_p[0, 2, 4]) / 5
    torch.testing.assert_close(soft_loss(log_p, labels, [soft, nothing], 10), expected)
