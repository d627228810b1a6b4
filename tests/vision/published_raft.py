"""Names and shapes of the parameters in the authors' checkpoints (princeton-vl/RAFT), built from its description,
not from our module."""

BATCH_NORM = {"weight": (1,), "bias": (1,), "running_mean": (1,), "running_var": (1,), "num_batches_tracked": ()}


def convolution(name: str, inputs: int, outputs: int, kernel: tuple[int, int]) -> dict[str, tuple[int, ...]]:
    return {f"{name}.weight": (outputs, inputs, *kernel), f"{name}.bias": (outputs,)}


def batch_norm(name: str, planes: int) -> dict[str, tuple[int, ...]]:
    return {f"{name}.{key}": tuple(planes for _ in shape) for key, shape in BATCH_NORM.items()}


def encoder(name: str, outputs: int, planes: tuple[int, int, int], bottleneck: bool, norm: bool) -> dict:
    """One encoder; `norm`: batch normalisation, which has parameters (instance normalisation here has none)."""
    found = convolution(f"{name}.conv1", 3, planes[0], (7, 7)) | convolution(
        f"{name}.conv2", planes[2], outputs, (1, 1)
    )
    if norm:
        found |= batch_norm(f"{name}.norm1", planes[0])
    inputs = planes[0]
    for layer, width in enumerate(planes, start=1):
        for unit in range(2):
            at = f"{name}.layer{layer}.{unit}"
            inner = width // 4 if bottleneck else width
            if bottleneck:
                found |= convolution(f"{at}.conv1", inputs, inner, (1, 1))
                found |= convolution(f"{at}.conv2", inner, inner, (3, 3))
                found |= convolution(f"{at}.conv3", inner, width, (1, 1))
            else:
                found |= convolution(f"{at}.conv1", inputs, inner, (3, 3))
                found |= convolution(f"{at}.conv2", inner, inner, (3, 3))
            if norm:
                found |= batch_norm(f"{at}.norm1", inner) | batch_norm(f"{at}.norm2", inner)
            if layer > 1 and unit == 0:
                found |= convolution(f"{at}.downsample.0", inputs, width, (1, 1))
                if norm:  # the release registers this one twice
                    found |= batch_norm(f"{at}.norm3", width) | batch_norm(f"{at}.downsample.1", width)
            inputs = width
    return found


def published_small() -> dict[str, tuple[int, ...]]:
    """raft-small.pth, without the `module.` prefix."""
    at = "update_block"
    found = encoder("fnet", 128, (32, 64, 96), True, False) | encoder("cnet", 160, (32, 64, 96), True, False)
    found |= convolution(f"{at}.encoder.convc1", 196, 96, (1, 1))
    found |= convolution(f"{at}.encoder.convf1", 2, 64, (7, 7)) | convolution(f"{at}.encoder.convf2", 64, 32, (3, 3))
    found |= convolution(f"{at}.encoder.conv", 128, 80, (3, 3))
    for gate in "zrq":
        found |= convolution(f"{at}.gru.conv{gate}", 242, 96, (3, 3))
    return (
        found
        | convolution(f"{at}.flow_head.conv1", 96, 128, (3, 3))
        | convolution(f"{at}.flow_head.conv2", 128, 2, (3, 3))
    )


def published_large() -> dict[str, tuple[int, ...]]:
    """raft-things.pth, raft-sintel.pth and the like, without the `module.` prefix."""
    at = "update_block"
    found = encoder("fnet", 256, (64, 96, 128), False, False) | encoder("cnet", 256, (64, 96, 128), False, True)
    found |= convolution(f"{at}.encoder.convc1", 324, 256, (1, 1))
    found |= convolution(f"{at}.encoder.convc2", 256, 192, (3, 3))
    found |= convolution(f"{at}.encoder.convf1", 2, 128, (7, 7)) | convolution(f"{at}.encoder.convf2", 128, 64, (3, 3))
    found |= convolution(f"{at}.encoder.conv", 256, 126, (3, 3))
    for step, kernel in ((1, (1, 5)), (2, (5, 1))):
        for gate in "zrq":
            found |= convolution(f"{at}.gru.conv{gate}{step}", 384, 128, kernel)
    found |= convolution(f"{at}.flow_head.conv1", 128, 256, (3, 3))
    found |= convolution(f"{at}.flow_head.conv2", 256, 2, (3, 3))
    return found | convolution(f"{at}.mask.0", 128, 256, (3, 3)) | convolution(f"{at}.mask.2", 256, 576, (1, 1))
