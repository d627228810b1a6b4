"""An exported page in Chromium without a network."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Visit, chromium, colours, visit
from result_folders import write_inferred

from pipeline.api import export as module

pytestmark = pytest.mark.app


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visit]:
    with chromium() as browser, pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "choose_backend", lambda choice: ("raycast", "our own ray caster"))
        folder: Path = tmp_path_factory.mktemp("page")
        module.write_page(module.export(write_inferred(folder / "out")), folder / "page.html")
        made = visit(browser, (folder / "page.html").as_uri(), offline=True)
        made.page.wait_for_selector(".panels[data-state=shown]")
        yield made


def test_clip_and_3d_view_are_drawn_without_a_network_and_without_complaints(opened: Visit) -> None:
    assert colours(opened.page, ".panels canvas >> nth=0") > 20
    assert colours(opened.page, ".panels canvas >> nth=2") > 20
    assert colours(opened.page, ".scene3d canvas") > 20
    assert [url for url in opened.requested if not url.startswith(("file:", "blob:", "data:"))] == []
    assert opened.complaints == []


def test_the_scrubber_stops_and_moves_panels_and_3d_view(opened: Visit) -> None:
    pictures = []
    for frame in ("2", "25"):
        opened.page.locator("input[type=range]").fill(frame)
        opened.page.wait_for_function(f"document.querySelector('output').textContent == '{int(frame) / 30:.2f} s'")
        opened.page.wait_for_timeout(300)
        canvases = [".panels canvas >> nth=0", ".scene3d canvas"]
        pictures.append([opened.page.locator(c).evaluate("c => c.toDataURL()") for c in canvases])
    assert opened.page.get_by_role("button", name="Play").is_visible()
    assert pictures[0][0] != pictures[1][0]
    assert pictures[0][1] != pictures[1][1]


def test_the_view_can_be_turned_and_set(opened: Visit) -> None:
    canvas = opened.page.locator(".scene3d canvas")
    shown = [canvas.evaluate("c => c.toDataURL()")]
    opened.page.get_by_role("button", name="From above").click()
    shown.append(canvas.evaluate("c => c.toDataURL()"))
    canvas.drag_to(canvas, source_position={"x": 200, "y": 200}, target_position={"x": 320, "y": 260})
    shown.append(canvas.evaluate("c => c.toDataURL()"))
    assert len(set(shown)) == 3
