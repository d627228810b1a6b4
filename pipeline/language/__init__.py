"""Text in and out of the model: events, their sentences, the answer's grammar, tokens."""
