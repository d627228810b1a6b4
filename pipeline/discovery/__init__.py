"""Where a simulation and measured motion disagree, and which physical effect explains it.

Data flows one way, and imports go the other way: tracks -> fitting -> selection -> report; `discover.py` calls them.
`filmed/` measures motion from videos, `tables/` reads it, `mechanisms/` asks the same of a user's own MuJoCo model.
"""
