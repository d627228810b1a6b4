"""`dynamics export`: a result as one web page."""

from __future__ import annotations

import argparse
from pathlib import Path

SUMMARY = "a result as one web page: clip, replay, motion in 3D, scene; needs no server and no network"
DESCRIPTION = """\
Write what a folder of results shows as one web page.

The clip, its replay and outlines (or the edited clip) play in step, and the motion can be looked at in 3D from all
sides. The scene is there as text, with the grade and what was measured. The page is one file of less than 8 MB. It
needs no server and asks for nothing from any network.

OUT is a folder that `dynamics infer`, `dynamics edit` or `dynamics simulate` wrote.

examples:
  dynamics export out -o page.html
  dynamics export edited -o edited.html --force
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("found", type=Path, metavar="OUT", help="a folder that `dynamics infer`, `edit` or `simulate` wrote")
    add("-o", "--out", type=Path, required=True, metavar="PAGE", help="the page to write, as page.html")
    add("--force", action="store_true", help="replace PAGE where it is there")


def run(arguments: argparse.Namespace) -> None:
    from pipeline.api.export import check_new_file, export, write_page

    a = arguments
    check_new_file(a.out, a.force)
    page = export(a.found)
    write_page(page, a.out, a.force)
    print(f"{'written':<11}{a.out}: {len(page.encode()) / 1e6:.1f} MB, open it in a browser")
