"""Which law a user's own MuJoCo model lacks, from logs of the real mechanism.

Reading is in `mechanism` and `log`, simulation in `variant` and `simulation`, the laws in `kinds`.
"""
