"""The vision-language model: building, loading, training and constrained generation."""
