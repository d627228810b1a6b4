"""The Python interface: `from pipeline import infer, simulate, discover`. The command `dynamics` calls the same."""
