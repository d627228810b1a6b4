"""Training of the tiny vision-language model."""
