"""The initial layout of the viewer: the scene beside the pictures; plots, events and notes below."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb
from rerun.encodings import Plane3D

from pipeline.viewer.footage import Footage, Pictures
from pipeline.viewer.motion import PLOTS
from pipeline.viewer.timeline import SIM_TIME
from pipeline.vision.rendering.camera import pinhole

CAMERA = "world/camera"
REPLAYED = "replayed"
PLAYBACK_SPEED = 0.5


def blueprint(footage: Footage) -> rrb.Blueprint:
    """The layout for the parts that the footage has."""
    below: list[rrb.View] = []
    if footage.motions:
        below += [rrb.TimeSeriesView(origin=f"plots/{plot}", name=title) for plot, title in PLOTS.items()]
    if any(m.events for m in footage.motions):
        columns = rrb.TextLogColumns(timeline_columns=[SIM_TIME], text_log_columns=["body"])
        below.append(rrb.TextLogView(origin="events", name="events", columns=columns))
    below.append(rrb.TextDocumentView(origin="notes", name="about this clip"))
    pictures = picture_views(footage)
    above: list[rrb.View | rrb.Container] = [scene_view(footage)] if footage.motions else []
    if pictures:
        above.append(rrb.Grid(*pictures, grid_columns=1 if len(pictures) < 3 else 2))
    shares = [1.0] * len(above)
    return rrb.Blueprint(
        rrb.Vertical(rrb.Horizontal(*above, column_shares=shares), rrb.Horizontal(*below), row_shares=[3, 1])
        if above
        else rrb.Horizontal(*below),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed", timeline=SIM_TIME, playback_speed=PLAYBACK_SPEED, loop_mode="all", play_state="playing"
        ),
    )


def scene_view(footage: Footage) -> rrb.View:
    """The 3D view from a point beside the camera, without the depth, mask and flow pictures."""
    motion = footage.motions[0]
    centre = motion.trace.position[0].mean(0) if len(motion.scene.objects) else np.zeros(3)
    grid: rrb.LineGrid3D | None = rrb.LineGrid3D(visible=False)
    if motion.scene.ground is not None:
        grid = rrb.LineGrid3D(visible=True, spacing=0.1, plane=Plane3D((0, 0, 1), motion.scene.ground))
    eye = None
    if motion.scene.camera is not None:
        view = pinhole(motion.scene.camera)
        right, up, back = view.rotation_world.T
        distance = float(np.linalg.norm(view.position_world - centre))
        position = view.position_world + distance * (0.5 * right + 0.3 * up + 0.5 * back)
        target = 0.7 * centre + 0.3 * view.position_world
        eye = rrb.EyeControls3D(position=position, look_target=target, eye_up=(0, 0, 1))
    contents = ["world/**", *(f"- {CAMERA}/{kind}/**" for kind in ("depth", "masks", "flow"))]
    return rrb.Spatial3DView(origin="world", contents=contents, name="scene", line_grid=grid, eye_controls=eye)


def picture_views(footage: Footage) -> list[rrb.View]:
    """2D views of the clip and of the replay: picture with masks, flow, and depth."""
    views: list[rrb.View] = []
    both = ((CAMERA, footage.seen), (REPLAYED, footage.replayed))
    for (path, pictures), title in zip(both, footage.titles, strict=True):
        if pictures.rgb is not None or pictures.masks is not None:
            kinds = {"rgb": pictures.rgb, "masks": pictures.masks}
            views.append(
                _view(path, [k for k, v in kinds.items() if v is not None], f"{title}: {_kinds_text(pictures)}")
            )
        if pictures.flow is not None:
            views.append(_view(path, ["flow"], f"{title}: optical flow"))
        if pictures.depth is not None:
            views.append(_view(path, ["depth"], f"{title}: depth"))
    return views


def _view(path: str, kinds: list[str], title: str) -> rrb.View:
    return rrb.Spatial2DView(origin=path, contents=[f"$origin/{kind}" for kind in kinds], name=title)


def _kinds_text(pictures: Pictures) -> str:
    if pictures.rgb is None:
        return "masks"
    return "picture" if pictures.masks is None else "picture and masks"
