"""Text in and out of the model: sentences on events, the grammar of the answer, tokens."""
