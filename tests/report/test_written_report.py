"""The parts of a report: pages, tables, Markdown, plots and pictures."""

import io
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from pipeline.clips.intervals import MeanInterval
from pipeline.report.clip_pictures import PANELS, as_jpeg, as_webp, painted, tiled
from pipeline.report.figures import bars, curves
from pipeline.report.scores_page import benchmark_tables
from pipeline.report.summary import Summary
from pipeline.report.written_report import Section, drawing, folded, html_table, page, picture, prose, prose_by_heading

RESULTS = Path("benchmarks/results")


def test_plots_are_well_formed_and_the_same_each_time() -> None:
    found = {("id", "greedy"): {"iou": MeanInterval(0.5, 0.4, 0.6, 9)}}
    summary = Summary(found, {("id", "greedy"): 0.0}, {("id", "greedy"): 0.0})
    for draw in (lambda: bars(summary, "iou", "IoU"), lambda: curves({"a": ([1, 2], [0.1, 0.4])}, "k", "IoU")):
        assert draw() == draw()
        assert ElementTree.fromstring(draw()).tag.endswith("svg")


@pytest.mark.parametrize("tint", [0.45, 0.0])
def test_a_painted_mask_changes_its_object_only(rng: np.random.Generator, tint: float) -> None:
    frame = rng.integers(0, 255, (40, 60, 3), dtype=np.uint8)
    mask = np.zeros((40, 60), np.uint8)
    mask[10:20, 10:30] = 1
    out = painted(frame, mask, tint)
    far, inside = np.ones((40, 60), bool), np.s_[12:18, 12:28]
    far[8:22, 8:32] = False
    assert (out[far] == frame[far]).all() and (out[10, 10:30] != frame[10, 10:30]).any()
    assert (out[inside] != frame[inside]).any() == (tint > 0)


def test_pictures_are_jpeg_and_animations_are_webp_with_all_frames(rng: np.random.Generator) -> None:
    frames = rng.integers(0, 255, (5, 40, 60, 3), dtype=np.uint8)
    sheet = as_jpeg(tiled([("a", list(frames[:2])), ("b", [frames[2]])]))
    moving = as_webp(frames, 15)
    assert "data:image/jpeg" in picture(sheet, "c") and "data:image/webp" in picture(moving, "c", PANELS)
    read = Image.open(io.BytesIO(moving))
    assert (read.n_frames, read.size) == (5, (60, 40)) and moving == as_webp(frames, 15)


def test_a_page_escapes_its_texts_and_keeps_ready_made_html() -> None:
    body = html_table(["<h>"], [["<c>"]]) + folded("<f>", "<p>") + drawing("<svg></svg>", "<d>")
    text = page("<t>", "a < b", {"<x>": "<y>"}, [Section("<s>", "n & m", body), Section("folded", "", "", folded=True)])
    for raw in ("<t>", "<x>", "<y>", "<s>", "<h>", "<c>", "<f>", "<d>", "<pre><p>", "a < b"):
        assert raw not in text
    assert "&lt;c&gt;" in text and "n &amp; m" in text and "<svg></svg>" in text
    assert text.count('<details class="section">') == 1


def test_the_interval_of_a_number_stands_below_it_and_other_brackets_stay() -> None:
    text = html_table(["a", "b"], [["0.53 (0.47–0.6)", "1 (2)"], ["-0.01 (-0.05–0.04)", "ball (held out)"]])
    assert "<td>0.53<small>0.47–0.6</small></td>" in text and "<td>-0.01<small>-0.05–0.04</small></td>" in text
    assert "<td>1 (2)</td>" in text and "<td>ball (held out)</td>" in text


def test_markdown_links_are_taken_from_its_folder_and_raw_html_is_escaped(tmp_path: Path) -> None:
    text = prose("[a](a.csv) [b](https://b.org) [c](#c) <script>", "../x")
    assert 'href="../x/a.csv"' in text and 'href="https://b.org"' in text and 'href="#c"' in text
    assert "<script>" not in text
    (tmp_path / "README.md").write_text("# T\n\nskipped\n\n## One\n\n`1`\n\n## Two\n\n- 2\n")
    found = prose_by_heading(tmp_path / "README.md")
    assert list(found) == ["One", "Two"] and "<code>1</code>" in found["One"] and "<li>2</li>" in found["Two"]


def test_every_benchmark_table_of_the_page_has_its_text_beside_its_results() -> None:
    for folder, tables in benchmark_tables(RESULTS).items():
        assert list(prose_by_heading(RESULTS / folder / "README.md")) == list(tables)
    text = Path("pipeline/report/scores_page.py").read_text(encoding="utf-8")
    used = set(re.findall(r'^        "([A-Z][\w ]+)": \w+_table', text, re.MULTILINE)) | {"Sequence IoU"}
    assert set(prose_by_heading(Path("reports/README.md"))) == used
