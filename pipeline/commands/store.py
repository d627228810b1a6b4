"""`dynamics store`: what the store of computed shards takes, pruning, and mending."""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.commands.arguments import positive

SUMMARY = "the store of computed shards: its size, pruning, mending"
DESCRIPTION = """\
The store of computed shards ($DYNAMICS_STORE, else .shards beside dvc.yaml).

  info     how many shards, and the bytes of shards, scratch and temporary files
  prune    remove what was not used for --keep-days, then the least recently used until --keep-gib are left. What a run
           that is going on uses stays; a stage that needs a removed shard computes it again
  fsck     compare the store, data/ and DVC's cache, and mend each damaged file from a copy whose hash is right. What
           has no good copy is removed, so that `make repro` makes it again
  link     let the store share the bytes of data/ and of DVC's cache (hard links), which halves the disk space. Damage
           then meets all copies at once; the run makes them again

examples:
  dynamics store info
  dynamics store prune --keep-gib 50
  dynamics store fsck
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("action", choices=("info", "prune", "fsck", "link"), metavar="ACTION", help="info, prune, fsck or link")
    add("--keep-days", type=positive, metavar="D", help="prune: keep what was used in the last D days")
    add("--keep-gib", type=positive, metavar="G", help="prune: keep at most G GiB")
    add("--root", type=Path, default=Path(), metavar="FOLDER", help="fsck, link: the folder of dvc.yaml (this one)")


def run(arguments: argparse.Namespace) -> None:
    from pipeline.commands import store_actions

    store_actions.ACTIONS[arguments.action](arguments)
