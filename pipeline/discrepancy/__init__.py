"""Where a simulation and measured motion disagree, and which physical effect explains it.

Data flows one way, and imports go the other way: tracks -> fitting -> selection -> report; `discover.py` calls them.
"""
