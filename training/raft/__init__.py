"""Training of RAFT-small, the optical flow network."""
