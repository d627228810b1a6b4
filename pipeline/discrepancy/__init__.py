"""Where a simulation and measured motion disagree, which effect the simulation lacks, and how much adding it helps."""
