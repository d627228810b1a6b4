"""SAM 2 and EdgeTAM with random weights, as small as their architectures allow, in the format of published ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from transformers import EdgeTamVideoConfig, EdgeTamVideoModel, Sam2VideoConfig, Sam2VideoModel

from pipeline.bodies.networks.repvit import use_repvit

SIDE = 64  # px of the pictures
WIDTHS, DEPTHS = [8, 16, 32, 64], [1, 1, 2, 1]
HIDDEN = 128  # a multiple of the memory's channels, which are 64 in the architecture
COMMON: dict[str, Any] = {
    "image_size": SIDE,
    "prompt_encoder_config": {"hidden_size": HIDDEN, "image_size": SIDE, "mask_input_channels": 4},
    "mask_decoder_config": {
        "hidden_size": HIDDEN,
        "mlp_dim": 16,
        "num_attention_heads": 2,
        "iou_head_hidden_dim": 16,
    },
    "memory_attention_hidden_size": HIDDEN,
    "memory_attention_num_layers": 1,
    "memory_attention_rope_feat_sizes": [SIDE // 16, SIDE // 16],
    "memory_encoder_hidden_size": HIDDEN,
    "mask_downsampler_embed_dim": HIDDEN,
    "memory_fuser_embed_dim": HIDDEN,
    "memory_fuser_intermediate_dim": 16,
}
VISION: dict[str, Any] = {
    "backbone_channel_list": WIDTHS[::-1],
    "backbone_feature_sizes": [[SIDE // n, SIDE // n] for n in (4, 8, 16)],
    "fpn_hidden_size": HIDDEN,
}
HIERA = {
    "model_type": "sam2_hiera_det_model",
    "hidden_size": WIDTHS[0],
    "image_size": [SIDE, SIDE],
    "blocks_per_stage": DEPTHS,
    "embed_dim_per_stage": WIDTHS,
    "num_attention_heads_per_stage": [1, 1, 2, 2],
    "window_size_per_stage": [4, 4, 4, 4],
    "global_attention_blocks": [3],
}
REPVIT = {
    "model_type": "timm_wrapper",
    "architecture": "repvit_m1",
    "model_args": {
        "in_chans": 3,
        "features_only": True,
        "out_indices": [0, 1, 2, 3],
        "embed_dim": WIDTHS,
        "depth": DEPTHS,
    },
}


def save_sam2(folder: Path, dtype: torch.dtype = torch.float32) -> Path:
    vision = {"model_type": "sam2_vision_model", "backbone_config": HIERA, **VISION}
    config = Sam2VideoConfig(vision_config=vision, memory_attention_feed_forward_hidden_size=16, **COMMON)
    return _saved(Sam2VideoModel(config), folder, dtype)


def save_edgetam(folder: Path) -> Path:
    vision = {"model_type": "edgetam_vision_model", "backbone_config": REPVIT, **VISION}
    given = {
        "memory_attention_mlp_hidden_size": 16,
        "memory_attention_rope_k_sizes": [2, 2],
        "perceiver_resampler_num_latents": 4,
        "perceiver_resampler_num_latents_2d": 4,
        "perceiver_resampler_mlp_intermediate_size": 16,
        "enable_occlusion_spatial_embedding": False,
        "enable_temporal_pos_encoding_for_object_pointers": False,
        **COMMON,
    }
    config = EdgeTamVideoConfig.from_dict(use_repvit({"vision_config": vision, **given}))
    _saved(EdgeTamVideoModel(config), folder, torch.float32)
    stored = json.loads((folder / "config.json").read_text())
    stored["vision_config"]["backbone_config"] = REPVIT  # as a published configuration names it
    (folder / "config.json").write_text(json.dumps(stored))
    return folder


def _saved(model: Any, folder: Path, dtype: torch.dtype) -> Path:
    torch.nn.init.constant_(model.mask_decoder.pred_obj_score_head.proj_out.bias, 10.0)  # bodies are always in view
    model.to(dtype).save_pretrained(folder)
    return folder
