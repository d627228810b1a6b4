"""Finding the scene whose replay matches a clip: the reward, best-of-K, CMA-ES."""
