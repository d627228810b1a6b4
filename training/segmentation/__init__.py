"""The network for moving bodies: rendered clips with exact instance masks, and training."""
