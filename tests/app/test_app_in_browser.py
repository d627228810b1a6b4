"""The page of `dynamics app` in Chromium: the whole way from a clip to an edited one, and what goes wrong on it."""

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import Visit, chromium, colours, visit
from local_server import serving

from pipeline.app.server import AppServer

pytestmark = pytest.mark.app
LONG = 900_000  # ms: a busy machine
CALM = {"reduced_motion": "reduce"}  # nothing plays by itself: Chromium draws by the processor that computes, too


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def server() -> Iterator[AppServer]:
    with serving() as made:
        yield made


def opened(browser: Any, server: AppServer) -> Visit:
    made = visit(browser, server.address, **CALM)
    made.page.wait_for_selector("[data-sample]")
    return made


def click_at(page: Any, x: float, y: float) -> None:
    """Click on the stage at shares of its width and height."""
    box = page.locator("#stage").bounding_box()
    page.locator("#stage").click(position={"x": x * box["width"], "y": y * box["height"]})


@pytest.mark.slow
def test_from_a_sample_to_an_edited_clip_and_its_downloads(browser: Any, server: AppServer, tmp_path: Path) -> None:
    made = opened(browser, server)
    page = made.page
    page.click("[data-sample=cross_engine_17]")
    page.wait_for_selector("#job progress")
    page.wait_for_selector("#stage[data-state=shown]", timeout=LONG)
    assert page.locator("#bodies-note").inner_text().startswith("2 bodies")
    assert colours(page, "#stage") > 20

    # Join both bodies by two clicks, then take that back.
    page.locator("#stage-clock input[type=range]").fill("8")
    found = page.evaluate("() => fetch('api/state').then((r) => r.json())")["bodies"]
    centres = []
    for polygons in found["outlines"][8]:
        xs, ys = polygons[0][::2], polygons[0][1::2]
        centres.append((sum(xs) / len(xs) / found["size"][0], sum(ys) / len(ys) / found["size"][1]))
    page.click("[data-tool=join]")
    for centre in centres:
        click_at(page, *centre)
    page.wait_for_selector("#bodies-note:has-text('1 body')")
    page.click("#undo")
    page.wait_for_selector("#bodies-note:has-text('2 bodies')")
    page.click("[data-tool=length]")
    click_at(page, 0.2, 0.8)
    click_at(page, 0.6, 0.8)
    page.wait_for_selector("#length-label:not([hidden])")
    page.fill("#metres", "0.5")

    page.select_option("#search", "quick")
    page.click("#infer")
    page.wait_for_selector("#panels .panels[data-state=shown]", timeout=LONG)
    assert page.locator("#grade").inner_text() in ("good", "doubtful", "poor")
    assert page.locator("#panels canvas").count() == 3
    assert colours(page, "#panels canvas >> nth=1") > 20
    assert colours(page, "#scene3d canvas") > 20
    page.wait_for_selector("#live[data-seconds]")
    before = page.locator("#live canvas").evaluate("c => c.toDataURL()")
    page.locator("input[name=speed]").fill("2")
    page.locator("input[name=gravity]").fill("3")
    page.wait_for_selector("#live[data-edits*='gravity=']")
    first = page.locator("#panels canvas >> nth=0").evaluate("c => c.toDataURL()")
    page.locator("#result-clock input[type=range]").fill("20")
    page.wait_for_timeout(1000)
    assert page.locator("#panels canvas >> nth=0").evaluate("c => c.toDataURL()") != first
    assert page.locator("#live canvas").evaluate("c => c.toDataURL()") != before

    page.click("#edit")
    page.wait_for_selector("#panels figure:nth-child(4)", timeout=LONG)
    page.wait_for_selector("#panels .panels[data-state=shown]")
    assert "seen" in page.locator("#edit-note").inner_text()
    with page.expect_download() as taken:
        page.click("text=Everything (zip) >> visible=true")
    taken.value.save_as(tmp_path / "all.zip")
    with zipfile.ZipFile(tmp_path / "all.zip") as archive:
        names = set(archive.namelist())
        assert {"out/scene.yaml", "out/result.json", "edited/edited.mp4", "edited/scene.yaml"} <= names
        length = json.loads(archive.read("out/result.json"))["clip"]
    assert length.endswith("cross_engine_17")
    with page.expect_download() as taken:
        page.click("text=Page (one file")
    taken.value.save_as(tmp_path / "page.html")
    alone = visit(browser, (tmp_path / "page.html").as_uri(), offline=True)
    alone.page.wait_for_selector(".panels[data-state=shown]")

    assert made.complaints == alone.complaints == []
    assert [u for u in made.requested if not u.startswith((server.address, "blob:", "data:"))] == []


@pytest.mark.slow
def test_the_example_of_discovery_shows_its_report(browser: Any, server: AppServer) -> None:
    made = opened(browser, server)
    made.page.click("[data-tab=discovery]")
    made.page.click("#example")
    made.page.wait_for_selector("#discovery:not([hidden])", timeout=LONG)
    assert "drag" in made.page.locator("#sentence").inner_text()
    report = made.page.frame_locator("#report")
    report.locator("h1").first.wait_for()
    assert made.complaints == []


def test_wrong_files_are_one_sentence_and_the_page_goes_on(browser: Any, server: AppServer, tmp_path: Path) -> None:
    made = opened(browser, server)
    page, message = made.page, made.page.locator("#message")
    with (tmp_path / "long.mp4").open("wb") as file:
        file.truncate(2**31)  # takes no room on the disk
    page.set_input_files("#file", tmp_path / "long.mp4")
    message.wait_for()
    assert "long.mp4 has 2,048 MiB; at most 500 MiB are taken." in message.inner_text()

    (tmp_path / "notes.mp4").write_text("this is a text\n" * 50)
    page.set_input_files("#file", tmp_path / "notes.mp4")
    page.wait_for_selector("#message:has-text('notes.mp4 is not a video')", timeout=LONG)

    (tmp_path / "notes.txt").write_text("this is a text\n")
    page.set_input_files("#file", tmp_path / "notes.txt")
    page.wait_for_selector("#message:has-text('notes.txt is no video; valid: .mp4')")

    page.click("[data-sample=cross_engine_01]")
    page.wait_for_selector("#job:not([hidden])")
    page.click("#cancel")
    page.wait_for_selector("#message:has-text('Cancelled. Nothing of the run is left.')", timeout=LONG)


def test_two_visitors_at_once_wait_for_each_other_and_both_go_on(browser: Any, server: AppServer) -> None:
    one, other = opened(browser, server), opened(browser, server)
    one.page.click("[data-sample=cross_engine_01]")
    one.page.wait_for_selector("#job:not([hidden])")
    other.page.click("[data-sample=cross_engine_02]")
    other.page.wait_for_selector("#job-step:has-text('1 run before yours')")
    one.page.click("#cancel")
    one.page.wait_for_selector("#message:has-text('Cancelled')", timeout=LONG)
    other.page.wait_for_selector("#job-step:not(:has-text('before yours'))", timeout=LONG)
    other.page.click("#cancel")
    other.page.wait_for_selector("#message:has-text('Cancelled')", timeout=LONG)
    assert one.complaints == other.complaints == []
