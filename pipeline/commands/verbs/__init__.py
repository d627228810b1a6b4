"""The subcommands, a module each: adding one is adding a file.

A module has `SUMMARY` (one line for `dynamics --help`), `DESCRIPTION` (what it does, with examples),
`add_arguments(parser)` and `run(arguments)`. It imports nothing heavy before `run`.
"""
