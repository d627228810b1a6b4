"""One module for each effect of mechanisms: its law as a change of the model, its parameters, and where fits begin."""
