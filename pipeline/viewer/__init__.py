"""Results to look at: clips and scenes in the rerun viewer, pages without a server. No other package imports rerun."""
