"""Video in, editable physics out: the library behind the stages and the `dynamics` command."""
