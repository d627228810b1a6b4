"""Tables as people have them: the same throws, written in many ways, come back as they were."""

import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pipeline.discovery.tables.motion_table import MotionTable, read_motion_table
from pipeline.discovery.tables.said import Said
from pipeline.errors import MeasurementError, ParamsError

TIME = np.arange(40) / 60
BODIES = {"ball": 0.05}
TWO = {"ball": 0.05, "puck": 0.02}


def throw(speed: float = 2.0, up: float = 3.0) -> np.ndarray:
    """(T, 2) m: x and height of a throw."""
    return np.column_stack([0.1 + speed * TIME, 1.0 + up * TIME - 4.905 * TIME**2])


def slide(speed: float = 2.0, angle: float = 0.4) -> np.ndarray:
    """(T, 2) m: x and y of a puck that slows down."""
    way = np.array([np.cos(angle), np.sin(angle)])
    return np.outer(speed * TIME - 0.5 * 1.2 * TIME**2, way)


def lines(columns: Sequence[np.ndarray], separator: str = ",", form: str = "{:.5f}", comma: bool = False) -> list[str]:
    rows = [separator.join("" if np.isnan(v) else form.format(v) for v in row) for row in zip(*columns, strict=True)]
    return [row.replace(".", ",") for row in rows] if comma else rows


def read(folder: Path, text: str | bytes, name: str = "throw.txt", bodies=BODIES, **said: object) -> MotionTable:  # type: ignore[no-untyped-def]
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_motion_table(path, bodies, Said(**said))  # type: ignore[arg-type]


def place(table: MotionTable, clip: str | None = None, body: str = "ball") -> np.ndarray:
    rows = table.rows[table.rows["object"] == body]
    return rows[rows["clip"] == clip][["x", "y", "z"]].to_numpy() if clip else rows[["x", "y", "z"]].to_numpy()


X, Z = throw().T
UPRIGHT = np.column_stack([X, 0 * X, Z])
VERNIER = ["Vernier Format 2", "throw.cmbl 5/2/2024", "Latest"]
VIDEO_ANALYSIS = ",".join(f'"Video Analysis: {c}"' for c in ("Time (s)", "X (m)", "Y (m)", "X Velocity (m/s)"))
ONE_THROW: dict[str, str | bytes] = {
    "comma": "\n".join(["t,x,y", *lines([TIME, X, Z])]),
    "semicolon and decimal commas": "\n".join(["Zeit;x;y", *lines([TIME, X, Z], ";", comma=True)]),
    "tabs and decimal commas": "\n".join(["t\tx\ty", *lines([TIME, X, Z], "\t", comma=True)]),
    "spaces": "\n".join(["  t    x    y", *lines([TIME, X, Z], "   ")]),
    "byte order mark": "\ufeff" + "\n".join(["t,x,y", *lines([TIME, X, Z])]),
    "UTF-16": "\n".join(["t\tx\ty", *lines([TIME, X, Z], "\t")]).encode("utf-16"),
    "Windows-1252": "\n".join(["Höhe (m);Zeit;x (m)", *lines([Z, TIME, X], ";")]).encode("cp1252"),
    "lines of Windows": "\r\n".join(["t,x,y", *lines([TIME, X, Z])]),
    "comments": "\n".join(["# filmed by Anna, 2 May", "# t x y", *lines([TIME, X, Z], " ")]),
    "units in the header": "\n".join(["t [ms],x (cm),y (cm)", *lines([1e3 * TIME, 100 * X, 100 * Z])]),
    "units after the names": "\n".join(["time_ms,x_mm,y_mm", *lines([1e3 * TIME, 1e3 * X, 1e3 * Z])]),
    "units in a row": "\n".join(["Time,X,Y", "ms,in,in", *lines([1e3 * TIME, X / 0.0254, Z / 0.0254], form="{:.7f}")]),
    "Tracker": "\n".join(["mass A\t\t", "t\tx\ty", *lines([TIME, X, Z], "\t", "{:.6E}")]),
    "Tracker without header": "\n".join(lines([TIME, X, Z], "\t", "{:.6E}", comma=True)),
    "y down": "\n".join(["t,x,y", *lines([TIME, X, -Z])]),
    "Vernier's text": "\n".join([*VERNIER, "Time\tX\tY", "t\tx\ty", "s\tm\tm", *lines([TIME, X, Z], "\t")]),
    "Vernier's CSV": "\n".join([VIDEO_ANALYSIS, *lines([TIME, X, Z, X])]),
    "quoted decimal commas": "\n".join(
        ["t,x,y", *(",".join(f'"{v:.5f}"'.replace(".", ",") for v in row) for row in zip(TIME, X, Z, strict=True))]
    ),
    "a numbered column without a name": "\n".join([",t,x,y", *lines([60 * TIME, TIME, X, Z])]),
    "quoted, with other columns": "\n".join(
        ['"frame","t","x","y","v_{x}","step"', *lines([60 * TIME, TIME, X, Z, 0 * X, 60 * TIME])]
    ),
}  # fmt: skip


@pytest.mark.parametrize("how", ONE_THROW)
def test_one_throw_is_read_however_it_is_written(tmp_path: Path, how: str) -> None:
    table = read(tmp_path, ONE_THROW[how])
    np.testing.assert_allclose(table.rows["time"], TIME, atol=1e-5)
    found = place(table)
    if how == "y down":  # from an origin of its own
        assert "down, and was turned around" in " ".join(table.notes)
    np.testing.assert_allclose(found, UPRIGHT, atol=2e-5)
    assert set(table.rows["clip"]) == {"throw"} and set(table.rows["object"]) == {"ball"}
    assert table.own_heights and any("one upright plane" in note for note in table.notes)


def test_pixels_need_a_known_length_and_y_down_is_seen(tmp_path: Path) -> None:
    pixels = [TIME, 100 + 400 * X, 700 - 400 * Z]
    text = "\n".join(["t\tx (px)\ty (px)", *lines(pixels, "\t")])
    with pytest.raises(MeasurementError, match="positions are in pixels; needed: --length"):
        read(tmp_path, text)
    for length in ((0, 0, 300, 400, 1.25), (400, 1.0)):
        found = place(read(tmp_path, text, length=length))
        np.testing.assert_allclose(np.ptp(found, axis=0), np.ptp(UPRIGHT, axis=0), atol=1e-4)
        np.testing.assert_allclose(found[:, 2] - found[0, 2], Z - Z[0], atol=1e-4)


def test_lengths_without_a_unit_that_are_no_metres_are_named(tmp_path: Path) -> None:
    for factor, unit in ((100, "cm"), (1000, "mm"), (430, "px")):
        with pytest.raises(MeasurementError, match=f"positions look like {unit}; needed: --unit {unit}"):
            read(tmp_path, "\n".join(["t,x,y", *lines([TIME, factor * X, factor * Z])]))
    text = "\n".join(["t,x,y", *lines([TIME, 100 * X, 100 * Z])])
    np.testing.assert_allclose(place(read(tmp_path, text, unit="cm")), UPRIGHT, atol=1e-6)


def test_columns_said_by_hand_win(tmp_path: Path) -> None:
    text = "\n".join(["id;clock;X1;Y1;noise", *lines([0 * X, TIME, 400 * X, -400 * Z, X], ";")])
    said = {"columns": "time=clock,x=X1,y=-Y1", "unit": "px", "length": (400, 1.0)}
    np.testing.assert_allclose(place(read(tmp_path, text, **said)), UPRIGHT, atol=1e-5)
    said["columns"] = "time=2,x=3,z=-4"
    np.testing.assert_allclose(place(read(tmp_path, text, **said)), UPRIGHT, atol=1e-5)
    said["columns"] = "time=clock,ball:x=X1,ball:y=-Y1,puck:x=X1,puck:y=-Y1"
    table = read(tmp_path, text, bodies=TWO, **said)
    np.testing.assert_allclose(place(table, body="puck"), UPRIGHT, atol=1e-5)


WIDE = {
    "x_1": "time,x_1,y_1,x_2,y_2",
    "X1": "t,X1,Y1,X2,Y2",
    "ball_x": "time,ball_x,ball_y,puck_x,puck_y",
    "ball.x (m)": "time (s),ball.x (m),ball.y (m),puck.x (m),puck.y (m)",
    "x ball": "Time,x_ball,y_ball,x_puck,y_puck",
    "names above": ",ball,,puck,\nt,x,y,x,y",
    "Tracker's": "#multi:\n\tmass A\t\tmass B\t\nt\tx\ty\tx\ty",
}


@pytest.mark.parametrize("how", WIDE)
def test_bodies_side_by_side_are_told_apart(tmp_path: Path, how: str) -> None:
    other = throw(-1.0, 2.0)
    separator = "\t" if "\t" in WIDE[how] else ","
    text = "\n".join([WIDE[how], *lines([TIME, X, Z, *other.T], separator)])
    table = read(tmp_path, text, bodies=TWO)
    np.testing.assert_allclose(place(table, body="ball"), UPRIGHT, atol=1e-5)
    np.testing.assert_allclose(place(table, body="puck")[:, [0, 2]], other, atol=1e-5)
    assert set(table.rows["clip"]) == {"throw"}


def test_runs_side_by_side_are_recordings_of_one_body(tmp_path: Path) -> None:
    short = throw(-1.0, 2.0).copy()
    short[30:] = np.nan
    clock = np.where(np.isnan(short[:, 0]), np.nan, TIME)
    head = ",".join(f'"Run {k}: {c}"' for k in (1, 2) for c in ("Time (s)", "X (m)", "Y (m)"))
    table = read(tmp_path, "\n".join([head, *lines([TIME, X, Z, clock, *short.T])]))
    np.testing.assert_allclose(place(table, "Run 1"), UPRIGHT, atol=1e-5)
    np.testing.assert_allclose(place(table, "Run 2")[:, [0, 2]], short[:30], atol=1e-5)


@pytest.mark.parametrize("how", ["a column", "a clock that begins anew", "blocks"])
def test_trials_one_below_the_other_are_recordings(tmp_path: Path, how: str) -> None:
    other, names = throw(-1.0, 2.0), ("1", "2")
    first, second = lines([TIME, X, Z]), lines([TIME, *other.T])
    if how == "a column":
        text = "\n".join(["Trial #,t,x,y", *(f"1,{r}" for r in first), *(f"2,{r}" for r in second)])
    elif how == "blocks":
        text = "\n".join(["t,x,y", *first, "", "t,x,y", *second])
        names = ("throw", "throw_2")
    else:
        text = "\n".join(["t,x,y", *first, *second])
        names = ("throw_1", "throw_2")
    table = read(tmp_path, text)
    np.testing.assert_allclose(place(table, names[0]), UPRIGHT, atol=1e-5)
    np.testing.assert_allclose(place(table, names[1])[:, [0, 2]], other, atol=1e-5)


def test_what_slows_down_is_on_the_ground_unless_said_otherwise(tmp_path: Path) -> None:
    text = "\n".join(["t,x,y", *lines([TIME, *slide().T]), *lines([TIME, *slide(1.5, 2.0).T])])
    table = read(tmp_path, text, bodies={"puck": 0.02})
    np.testing.assert_allclose(place(table, "throw_1", "puck"), np.column_stack([slide(), 0.02 + 0 * X]), atol=1e-5)
    assert not table.own_heights and any("(nothing falls" in note for note in table.notes)
    upright = place(read(tmp_path, text, bodies={"puck": 0.02}, plane="upright"), "throw_1", "puck")
    np.testing.assert_allclose(upright[:, [0, 2]], slide(), atol=1e-5)


@pytest.mark.parametrize(("title", "sign"), [("Height (m)", 1), ("Position (m)", 1), ("Distance (m)", -1)])
def test_one_coordinate_that_falls_is_a_height(tmp_path: Path, title: str, sign: int) -> None:
    table = read(tmp_path, "\n".join([f"Time (s),{title},Velocity (m/s)", *lines([TIME, sign * Z, X])]))
    np.testing.assert_allclose(place(table), np.column_stack([0 * X, 0 * X, Z]), atol=1e-5)
    assert any("columns not used: Velocity (m/s)" in note for note in table.notes)


def test_a_fall_that_ends_at_a_steady_speed_is_a_fall(tmp_path: Path) -> None:
    time, end = np.arange(60) / 50, 1.2  # m/s
    height = 3 - end**2 / 9.81 * np.log(np.cosh(9.81 * time / end))
    table = read(tmp_path, "\n".join(["Time (s),Position (m)", *lines([time, height])]))
    np.testing.assert_allclose(place(table)[:, 2], height, atol=1e-5)


def test_one_coordinate_along_a_track_is_on_the_ground(tmp_path: Path) -> None:
    table = read(tmp_path, "\n".join(["Time (s)\tPosition (cm)", *lines([TIME, 100 * slide()[:, 0]], "\t")]))
    np.testing.assert_allclose(place(table), np.column_stack([slide()[:, 0], 0 * X, 0.05 + 0 * X]), atol=1e-5)


def test_motion_capture_has_y_up_and_markers_by_name(tmp_path: Path) -> None:
    one, other = throw(), throw(-1.0, 2.0)
    parts = [60 * TIME, TIME, *np.tile([[0], [0], [0], [1.0]], len(TIME)), one[:, 0], one[:, 1], 0.3 + 0 * TIME]
    motive = [
        "Format Version,1.23,Take Name,throw,Capture Frame Rate,60.0,Length Units,Meters",
        "",
        ",," + ",".join(["Rigid Body"] * 7 + ["Rigid Body Marker"] * 3),
        ",," + ",".join(["ball"] * 7 + ["ball:Marker1"] * 3),
        ",," + ",".join(['"8A14F8D2"'] * 10),
        ",," + ",".join(["Rotation"] * 4 + ["Position"] * 6),
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X,Y,Z",
    ]
    text = "\n".join([*motive, *lines([*parts, other[:, 0], other[:, 1], 0 * TIME])])
    table = read(tmp_path, text)
    np.testing.assert_allclose(place(table), np.column_stack([X, -0.3 + 0 * X, Z]), atol=1e-5)
    np.testing.assert_allclose(
        table.rows[["qw", "qx", "qy", "qz"]].to_numpy()[0], [0.5**0.5, 0.5**0.5, 0, 0], atol=1e-6
    )
    assert any("ball:Marker1" in note for note in table.notes)

    vicon = ["Trajectories", "60", ",,Anna:ball,,,Anna:puck,,", "Frame,Sub Frame,X,Y,Z,X,Y,Z", ",,mm,mm,mm,mm,mm,mm"]
    columns = [60 * TIME, 0 * TIME, 1e3 * X, 0 * X, 1e3 * Z, 1e3 * other[:, 0], 0 * X, 1e3 * other[:, 1]]
    table = read(tmp_path, "\n".join([*vicon, *lines(columns)]), bodies=TWO, rate=60.0)
    np.testing.assert_allclose(place(table, body="puck")[:, [0, 2]], other, atol=1e-5)

    qualisys = ["NO_OF_FRAMES\t40", "FREQUENCY\t60", "MARKER_NAMES\tball\tpuck", "Frame\tTime\tball X\tball Y\tball Z"]
    table = read(tmp_path, "\n".join([*qualisys, *lines([60 * TIME, TIME, X, 0 * X, Z], "\t")]), bodies=TWO)
    np.testing.assert_allclose(place(table), UPRIGHT, atol=1e-5)


def test_frames_need_a_rate(tmp_path: Path) -> None:
    text = "\n".join(["frame,x,y", *lines([60 * TIME, X, Z])])
    with pytest.raises(MeasurementError, match="counts frames; needed: a column of times, or --fps"):
        read(tmp_path, text)
    np.testing.assert_allclose(read(tmp_path, text, rate=60.0).rows["time"], TIME, atol=1e-6)


TRK = """<?xml version="1.0" encoding="UTF-8"?>
<object class="org.opensourcephysics.cabrillo.tracker.TrackerPanel">
 <property name="videoclip" type="object"><object class="org.opensourcephysics.media.core.VideoClip">
  <property name="startframe" type="int">5</property><property name="starttime" type="double">0.0</property>
 </object></property>
 <property name="clipcontrol" type="object"><object class="org.opensourcephysics.media.core.StepperClipControl">
  <property name="delta_t" type="double">16.666666666666668</property></object></property>
 <property name="coords" type="object"><object class="org.opensourcephysics.media.core.ImageCoordSystem">
  <property name="framedata" type="array"><property name="[0]" type="object">
   <object class="org.opensourcephysics.media.core.ImageCoordSystem$FrameData">
    <property name="xorigin" type="double">100.0</property><property name="yorigin" type="double">700.0</property>
    <property name="angle" type="double">10.0</property>
    <property name="xscale" type="double">400.0</property><property name="yscale" type="double">400.0</property>
   </object></property></property></object></property>
 <property name="tracks" type="collection"><property name="item" type="object">
  <object class="org.opensourcephysics.cabrillo.tracker.PointMass"><property name="name" type="string">ball</property>
   <property name="framedata" type="array">MARKS</property></object></property></property>
</object>
"""


def test_a_project_of_tracker_is_read_in_its_own_axes(tmp_path: Path) -> None:
    c, s = np.cos(np.radians(10)), np.sin(np.radians(10))
    right, up = c * X - s * Z, s * X + c * Z
    marks = "".join(
        f'<property name="[{5 + i}]" type="object">'
        '<object class="org.opensourcephysics.cabrillo.tracker.PointMass$FrameData">'
        f'<property name="x" type="double">{100 + 400 * a}</property><property name="y" type="double">{700 - 400 * b}'
        "</property></object></property>"
        for i, (a, b) in enumerate(zip(right, up, strict=True))
    )
    table = read(tmp_path, TRK.replace("MARKS", marks), "throw.trk")
    np.testing.assert_allclose(table.rows["time"], TIME, atol=1e-9)
    np.testing.assert_allclose(place(table), UPRIGHT, atol=1e-9)
    with pytest.raises(MeasurementError, match="no point mass with marks"):
        read(tmp_path, TRK.replace("MARKS", ""), "none.trk")
    with pytest.raises(MeasurementError, match="is damaged"):
        read(tmp_path, TRK[:900], "half.trk")


def workbook(path: Path, sheets: dict[str, list[list[object]]]) -> None:
    """A minimal workbook as Excel writes it: shared texts, cells by reference."""
    main = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    relation = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    texts: list[str] = []

    def cell(row: int, column: int, value: object) -> str:
        if value is None:
            return ""
        where = f'r="{chr(65 + column)}{row + 1}"'
        if isinstance(value, str):
            texts.append(value)
            return f'<c {where} t="s"><v>{len(texts) - 1}</v></c>'
        return f"<c {where}><v>{value!r}</v></c>"

    with zipfile.ZipFile(path, "w") as archive:
        for k, rows in enumerate(sheets.values()):
            body = "".join(
                f'<row r="{i + 1}">{"".join(cell(i, j, v) for j, v in enumerate(row))}</row>'
                for i, row in enumerate(rows)
            )
            archive.writestr(
                f"xl/worksheets/sheet{k + 1}.xml", f"<worksheet {main}><sheetData>{body}</sheetData></worksheet>"
            )
        names = "".join(f'<sheet name="{name}" sheetId="{k + 1}" r:id="rId{k + 1}"/>' for k, name in enumerate(sheets))
        archive.writestr(
            "xl/workbook.xml", f'<workbook {main} xmlns:r="{relation}"><sheets>{names}</sheets></workbook>'
        )
        links = "".join(
            f'<Relationship Id="rId{k + 1}" Target="worksheets/sheet{k + 1}.xml"/>' for k in range(len(sheets))
        )
        archive.writestr("xl/_rels/workbook.xml.rels", f"<Relationships>{links}</Relationships>")
        items = "".join(f"<si><t>{text}</t></si>" for text in texts)
        archive.writestr("xl/sharedStrings.xml", f"<sst {main}>{items}</sst>")


def test_each_sheet_of_a_workbook_is_a_body_or_a_recording(tmp_path: Path) -> None:
    other = throw(-1.0, 2.0)
    rows = {
        name: [["Drop #", "Time (s)", None, "Height (m)"]]
        + [[k, float(t), None, float(z)] for k in (1, 2) for t, z in zip(TIME, path[:, 1], strict=True)]
        for name, path in (("Ball", throw()), ("Puck", other))
    }
    workbook(tmp_path / "drops.xlsx", rows)  # type: ignore[arg-type]
    table = read_motion_table(tmp_path / "drops.xlsx", TWO, Said())
    assert list(dict.fromkeys(table.rows["clip"])) == ["Ball 1", "Ball 2", "Puck 1", "Puck 2"]
    np.testing.assert_allclose(place(table, "Puck 2", "puck")[:, 2], other[:, 1])


BY_COMMAS = "\n".join(lines([TIME, X, Z]))
FAULTS: dict[str, tuple[str | bytes, dict[str, str], str]] = {
    "no numbers": ("hello\nworld", {}, "no rows of numbers .* it begins with 'hello'; needed"),
    "a picture": (b"\x89PNG\0\0\0\0", {}, "it is no text; valid: text, .xlsx"),
    "an old workbook": (b"\xd0\xcf\x11\xe0\0\0", {}, "workbook of Excel 97 to 2003; save it as .xlsx or CSV"),
    "a broken workbook": (b"PK\3\4broken", {}, "no workbook of Excel"),
    "no times": ("x,y\n" + "\n".join(lines([X, Z])), {}, "no column of times among 'x', 'y'; needed: time"),
    "no positions": ("t,foo\n" + "\n".join(lines([TIME, Z])), {}, "no column of positions among 't', 'foo'"),
    "a header that says nothing": ("a,b,c\n" + "\n".join(lines([Z, X, Z])), {}, "no header over 3 columns"),
    "a word among numbers": ("t,x,y\n0,1,2\n1,far,2\n2,1,2", {}, "line 3: x is 'far', not a number"),
    "another unit": ("t,x (furlong),y (furlong)\n" + BY_COMMAS, {}, "'furlong' is no unit of length"),
    "two units": ("t,x (m),y (cm)\n" + "\n".join(lines([TIME, X, Z])), {}, "positions in different units \\(cm, m\\)"),
    "other bodies": (
        "t,A_x,A_y,B_x,B_y,C_x,C_y\n" + "\n".join(lines([TIME, X, Z, X, Z, X, Z])), TWO,
        "it shows 'A', 'B', 'C', the scene has ball, puck; needed: the same names",
    ),
    "which body": ("t,x,y\n" + BY_COMMAS, TWO, "which object of the scene moves; needed: a column"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_what_cannot_be_read_says_what_it_looks_like_and_what_it_needs(tmp_path: Path, fault: str) -> None:
    text, bodies, said = FAULTS[fault]
    with pytest.raises(MeasurementError, match=said):
        read(tmp_path, text, bodies=bodies or BODIES)


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"columns": "time=t,x=X9"}, "no column 'X9'"),
        ({"columns": "time=t,speed=x"}, "'speed=x'.*valid: WHAT=COLUMN"),
        ({"columns": "x=x,y=y"}, "time \\(or frame\\) and at least one of x, y, z"),
        ({"unit": "furlong"}, "'furlong' is no unit of length; valid: m, dm, cm"),
        ({"unit": "px"}, "--unit px: needs --length"),
        ({"length": (1.0, 1.0, 1.0, 1.0, 0.3)}, "the two points are the same"),
    ],
)
def test_what_is_said_by_hand_is_checked(tmp_path: Path, said: dict[str, object], message: str) -> None:
    with pytest.raises(ParamsError, match=message):
        read(tmp_path, "\n".join(["t,x,y", *lines([TIME, X, Z])]), **said)
