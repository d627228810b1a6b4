"""The console script `dynamics`: one subcommand a module of `verbs`, and what they share."""
