"""What the stages share: their parameters, how they run, and where their shards lie."""
