"""A Qwen2.5-VL of a few million parameters that reads bodies, or whole frames, and writes words.

The modules are transformers' own. What is shown of a body is its crops, for the vision tower, and one token a frame
for its place; of a frame, the picture. Both can show optical flow or colours: the prompt's first two tokens say which.
The answer is a row of decisions (`pipeline.model.decisions`).
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional
from transformers import PretrainedConfig, PreTrainedModel, Qwen2_5_VLConfig, Qwen2_5_VLForConditionalGeneration

from pipeline.model import decisions as d
from pipeline.model.fields import BINS, MOTION, NOTHING
from pipeline.model.instances import FULL, HEIGHT, SIDE, WIDTH

FRAMES = 10
PATCH, MERGE = 8, 2
#: Of a picture: colours, flow, and the share of the body less that of others. What is not shown is 0.
CHANNELS = ("red", "green", "blue", "right", "down", "mask")
WAVES = 8


class WordsConfig(PretrainedConfig):
    """Widths and depths of the language model and of the vision tower: config.json."""

    model_type = "words"

    def __init__(
        self,
        width: int = 320,
        layers: int = 8,
        heads: int = 10,
        inner: int = 896,
        vision_width: int = 160,
        vision_depth: int = 4,
        vision_heads: int = 5,
        vision_inner: int = 416,
        **rest: Any,
    ) -> None:
        self.width, self.layers, self.heads, self.inner = width, layers, heads, inner
        self.vision_width, self.vision_depth = vision_width, vision_depth
        self.vision_heads, self.vision_inner = vision_heads, vision_inner
        super().__init__(**rest)


def qwen_config(size: WordsConfig) -> Qwen2_5_VLConfig:
    """The configuration of Qwen2.5-VL at this size."""
    head = size.width // size.heads
    section = head // 2 // 3
    text = {
        "vocab_size": d.TOKENS,
        "hidden_size": size.width,
        "intermediate_size": size.inner,
        "num_hidden_layers": size.layers,
        "num_attention_heads": size.heads,
        "num_key_value_heads": size.heads,
        "max_position_embeddings": 4096,
        "tie_word_embeddings": False,
        "rope_parameters": {
            "rope_type": "default",
            "rope_theta": 10000.0,
            "mrope_section": [head // 2 - 2 * section, section, section],
        },
        "bos_token_id": None,
        "eos_token_id": d.END,
        "pad_token_id": d.PAD,
    }
    vision = {
        "depth": size.vision_depth,
        "hidden_size": size.vision_width,
        "intermediate_size": size.vision_inner,
        "num_heads": size.vision_heads,
        "patch_size": PATCH,
        "spatial_merge_size": MERGE,
        "temporal_patch_size": 2,
        "in_channels": len(CHANNELS),
        "out_hidden_size": size.width,
        "fullatt_block_indexes": list(range(size.vision_depth)),
        "window_size": 8 * PATCH,
        "tokens_per_second": 1,
    }
    return Qwen2_5_VLConfig(
        text_config=text,
        vision_config=vision,
        image_token_id=d.VIDEO,
        video_token_id=d.VIDEO,
        vision_start_token_id=d.PAD,
        vision_end_token_id=d.PAD,
        tie_word_embeddings=False,
    )


def waves(share: Tensor) -> Tensor:
    """(…, 1 + 2 WAVES) features of numbers -1 to 1."""
    phase = share[..., None] * (math.pi * 2.0 ** torch.arange(WAVES, device=share.device))
    return torch.cat([share[..., None], phase.sin(), phase.cos()], -1)


#: Features of a body's place in a frame.
PLACE_FEATURES = 6 * (1 + 2 * WAVES) + 4 + 2 + 2 + 4 + 1


def place_features(places: Tensor, flow: Tensor) -> Tensor:
    """(…, T, PLACE_FEATURES) of places (…, T, 14), px of 240x160; none knows a camera.

    flow: (…, 1) 1 where flow may be known, else 0.
    """
    seen = places[..., :1]
    left, right, top, bottom, x, y, area = (places[..., k] for k in range(1, 8))
    spots = torch.cat([torch.stack([left, right, x], -1) / WIDTH, torch.stack([top, bottom, y], -1) / HEIGHT], -1)
    wide, high, area = (right - left).clamp(min=1), (bottom - top).clamp(min=1), area.clamp(min=1)
    sizes = torch.stack([wide.log() - 3.3, high.log() - 3.3, 0.5 * area.log() - 3, 2 * area / (wide * high) - 1.5], -1)
    both = (places[..., :-1, 0] * places[..., 1:, 0])[..., None]
    centre = torch.stack([x, y], -1)
    step = functional.pad((centre[..., 1:, :] - centre[..., :-1, :]) / 10 * both, (0, 0, 1, 0))
    moving = torch.asinh(2 * places[..., 8:10]) * flow[..., None]
    parts = [waves(2 * spots - 1).flatten(-2), sizes, moving, step, places[..., 10:14], torch.ones_like(seen)]
    return torch.cat(parts, -1) * seen


class WordsNetwork(PreTrainedModel):
    """From bodies or frames to a row of decisions."""

    config_class = WordsConfig
    base_model_prefix = "words"
    _supports_sdpa = True

    def __init__(self, size: WordsConfig) -> None:
        super().__init__(size)
        self.size = size
        self.qwen = Qwen2_5_VLForConditionalGeneration(qwen_config(size))
        width = size.width
        self.number = nn.Linear(1 + 2 * WAVES, width, bias=False)
        self.ask = nn.Embedding(d.ASKS, width)
        self.place = nn.Sequential(nn.Linear(PLACE_FEATURES, width), nn.GELU(), nn.Linear(width, width))
        self.frame = nn.Embedding(FRAMES, width)
        self.bins = nn.Linear(width, BINS)
        #: Learned beside the answer: shape, motion, and which kinds of event come before the next frame.
        self.beside = nn.Linear(width, NOTHING + 1 + MOTION + len(d.KINDS))
        self._turns: dict[tuple, tuple[Tensor, Tensor]] = {}
        self.post_init()

    @property
    def token_embedding(self) -> nn.Embedding:
        """The embedding of tokens."""
        return self.qwen.model.language_model.embed_tokens

    def _turn(self, rows: int, columns: int, like: Tensor) -> tuple[Tensor, Tensor]:
        """Cosines and sines (1, 1, P, D) of the vision tower's rotary embedding, patches in merge order."""
        key = (rows, columns, like.device)
        if key not in self._turns:
            grid = torch.stack(torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij"), -1)
            grid = grid.view(rows // 2, 2, columns // 2, 2, 2).permute(0, 2, 1, 3, 4).reshape(-1, 2)
            size = self.size.vision_width // self.size.vision_heads
            inverse = 1.0 / (10000.0 ** (torch.arange(0, size // 2, 2).float() / (size // 2)))
            angle = (grid[..., None] * inverse).flatten(1).to(like.device)
            angle = torch.cat([angle, angle], -1)
            self._turns[key] = angle.cos(), angle.sin()
        return self._turns[key]

    def encode_pictures(self, pictures: Tensor) -> Tensor:
        """(M, T/2 · h/16 · w/16, width) of pictures (M, T, 6, h, w), -1 to 1: Qwen2.5-VL's vision tower.

        All pictures have one size, so that a tensor has a row a pair of frames and no lengths need be told.
        """
        m, t, c, h, w = pictures.shape
        rows, columns = h // PATCH, w // PATCH
        x = pictures.view(m, t // 2, 2, c, rows // 2, 2, PATCH, columns // 2, 2, PATCH)
        x = x.permute(0, 1, 4, 7, 5, 8, 3, 2, 6, 9).reshape(m * t // 2, rows * columns, c * 2 * PATCH * PATCH)
        tower = self.qwen.model.visual
        x = functional.linear(x, tower.patch_embed.proj.weight.flatten(1))
        cos, sin = self._turn(rows, columns, x)

        def turned(q: Tensor) -> Tensor:
            a, b = q.chunk(2, -1)
            return (q * cos + torch.cat([-b, a], -1) * sin).to(q.dtype)

        for block in tower.blocks:
            q, k, v = (
                block.attn.qkv(block.norm1(x)).view(*x.shape[:2], 3, self.size.vision_heads, -1).permute(2, 0, 3, 1, 4)
            )
            seen = functional.scaled_dot_product_attention(turned(q), turned(k), v)
            x = x + block.attn.proj(seen.transpose(1, 2).reshape(x.shape))
            x = x + block.mlp(block.norm2(x))
        return tower.merger(x.reshape(-1, x.shape[-1])).view(m, -1, self.size.width)

    def as_pictures(self, crops: Tensor, colours: bool) -> Tensor:
        """Pictures (…, 6, h, w) of crops (…, C, h, w) int8: colours or flow, then the mask where there is one."""
        x = crops.float() / FULL
        out = x.new_zeros(*x.shape[:-3], len(CHANNELS), *x.shape[-2:])
        first, count = (0, 3) if colours else (3, 2)
        out[..., first : first + count, :, :] = x[..., :count, :, :]
        if x.shape[-3] > count:
            out[..., 5, :, :] = x[..., count, :, :]
        return out

    def bodies_prompt(self, crops: Tensor, colours: bool, places: Tensor, numbers: Tensor) -> tuple[Tensor, Tensor]:
        """The prompt (B, L, width) and its rotary positions (3, B, L).

        Args:
            crops: (B, N, T, C, S, S) int8.
            colours: Whether they show colours; else flow.
            places: (B, N, T, 14).
            numbers: (B, N) place of each body in the prompt, 0 to PLACES - 1.
        """
        b, n, t = places.shape[:3]
        seen = self.encode_pictures(self.as_pictures(crops.flatten(0, 1), colours)).view(b, n, -1, self.size.width)
        known = places.new_full((b, n, 1), 0.0 if colours else 1.0)
        at = self.place(place_features(places, known)) + self.frame.weight
        here = places[..., :1] > 0
        at = torch.where(here, at, (self.token_embedding.weight[d.UNSEEN] + self.frame.weight).to(at.dtype))
        name = self.token_embedding(d.PLACE0 + numbers)[:, :, None]
        body = torch.cat([name, (seen + name).to(name.dtype), (at + name).to(name.dtype)], 2).flatten(1, 2)
        where = (self._body_positions(t, body.device) + (2 + d.TOKENS_OF_BODY * numbers)[None, :, :, None]).flatten(2)
        return self._with_head(body, where, colours, d.BODIES)

    def _body_positions(self, frames: int, device: torch.device) -> Tensor:
        """(3, 1, 1, P) of a body's tokens from its first."""
        side = SIDE // PATCH // MERGE
        grid = torch.stack(
            torch.meshgrid(*(torch.arange(k) for k in (frames // 2, side, side)), indexing="ij")
        ).flatten(1)
        one = torch.zeros(3, 1, dtype=torch.long)
        places = (1 + frames // 2 + torch.arange(frames)).expand(3, -1)
        return torch.cat([one, 1 + grid, places], 1)[:, None, None].to(device)

    def frame_prompt(self, frames: Tensor, colours: bool) -> tuple[Tensor, Tensor]:
        """The same of whole frames (B, T, C, h, w) int8."""
        b, t, _, h, w = frames.shape
        seen = self.encode_pictures(self.as_pictures(frames, colours))
        grid = torch.meshgrid(
            *(torch.arange(k) for k in (t // 2, h // PATCH // MERGE, w // PATCH // MERGE)), indexing="ij"
        )
        where = 2 + torch.stack(grid).flatten(1)[:, None].expand(-1, b, -1).to(seen.device)
        return self._with_head(seen, where, colours, d.FRAME)

    def _with_head(self, x: Tensor, where: Tensor, colours: bool, sees: int) -> tuple[Tensor, Tensor]:
        b = len(x)
        head = self.token_embedding(torch.tensor([d.RGB if colours else d.FLOW, sees], device=x.device)).expand(
            b, -1, -1
        )
        first = torch.arange(2, device=x.device).expand(3, b, -1)
        return torch.cat([head, x.to(head.dtype)], 1), torch.cat([first, where], 2)

    def embed_decisions(self, token: Tensor, share: Tensor, ask: Tensor, of: Tensor) -> Tensor:
        """(…, width) of what was decided last and what is to be decided."""
        number = (token >= d.FIELD0)[..., None]
        x = self.token_embedding(token) + self.number(waves(share)) * number + self.ask(ask)
        return x + self.token_embedding(of) * (of > 0)[..., None]

    def language_states(self, x: Tensor, where: Tensor, cache=None) -> Tensor:
        """The language model's last states (B, L, width). where: (3, B, L) rotary positions."""
        out = self.qwen.model.language_model(
            inputs_embeds=x, position_ids=where, use_cache=cache is not None, past_key_values=cache
        )
        return out.last_hidden_state
