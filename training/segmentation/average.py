"""The mean of the weights of several steps of one training, which is better than each while the learning rate is high.

    python -m training.segmentation.average OUT WORK/steps/033250 WORK/steps/033500 ...

Averaging of weights as Izmailov et al. (UAI 2018). The configuration, with its regression of scores, is the last one's.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch

from pipeline.segmentation.network import SegmentationNetwork, load_network, save_network


def averaged(networks: list[SegmentationNetwork]) -> SegmentationNetwork:
    """A network of the mean weights of networks of the same channels."""
    states = [n.state_dict() for n in networks]
    out = SegmentationNetwork(networks[-1].channels)  # type: ignore[arg-type]
    mean = {
        k: torch.stack([s[k] for s in states]).mean(0) if v.is_floating_point() else v for k, v in states[-1].items()
    }
    out.load_state_dict(mean)
    return out.eval()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("weights", type=Path, nargs="+", help="folders of weights, the latest last")
    arguments = parser.parse_args()
    networks = [load_network(p) for p in arguments.weights]
    if len({tuple(n.channels) for n in networks}) > 1:
        parser.error("the networks differ in their channels; valid: weights of one training")
    config = {k: v for k, v in networks[-1].config.items() if k != "channels"}
    save_network(averaged(networks), arguments.out, config | {"averaged": len(networks)})


if __name__ == "__main__":
    main()
