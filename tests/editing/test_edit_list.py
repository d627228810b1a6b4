"""Laws of lists of edits: what is read, what is refused, and their schema."""

import json
from pathlib import Path

import pytest

from pipeline.editing.edit_list import Edit, added_object, edits_schema, in_order, read_edits, read_object
from pipeline.errors import SceneError
from pipeline.shards.code_hash import ROOT

FILE = """\
edits:
- {at: 0.4, remove: box_1}
- {set: "objects[0].mass", value: 2.0}
- {at: 0.0, set: "objects[0].velocity", value: [1, 0, 0.5]}
- {at: 0.0, add: {name: ball, shape: sphere, radius: 0.05}}
"""


def test_a_file_of_edits_is_what_the_options_of_the_command_make(tmp_path: Path) -> None:
    (tmp_path / "edits.yaml").write_text(FILE)
    assert read_edits(tmp_path / "edits.yaml") == [
        Edit(0.4, remove="box_1"),
        Edit(0.0, set="objects[0].mass=2.0"),
        Edit(0.0, set="objects[0].velocity=[1, 0, 0.5]"),
        Edit(0.0, add={"name": "ball", "shape": "sphere", "radius": 0.05}),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("edits:\n- {at: 0.0, remvoe: box}\n", "did you mean 'remove'"),
        ("edits:\n- {at: -1, remove: box}\n", r"edits\[0\].at: .*greater than or equal to 0"),
        ("edits:\n- {at: 0.1}\n", "one of `set`"),
        ("edits:\n- {remove: a, set: gravity, value: 1}\n", "one of `set`"),
        ("edits:\n- {set: gravity}\n", "`set` and `value` belong together"),
        ("edit: []\n", "valid: edits"),
        ("- 1\n", "edits"),
        ("edits: [\n", "not YAML"),
    ],
)
def test_a_wrong_file_is_refused_with_what_is_valid(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "edits.yaml").write_text(text)
    with pytest.raises(SceneError, match=message):
        read_edits(tmp_path / "edits.yaml")


def test_an_added_object_is_a_mapping_with_a_shape(tmp_path: Path) -> None:
    (tmp_path / "ball.yaml").write_text("radius: 0.1\n")
    with pytest.raises(SceneError, match="a mapping with shape"):
        read_object(tmp_path / "ball.yaml")
    with pytest.raises(SceneError, match="there is no such file"):
        read_object(tmp_path / "none.yaml")


def test_edits_are_put_in_order_of_time_and_keep_their_order_within_one() -> None:
    edits = [Edit(0.5, set="a=1"), Edit(0.0, set="b=1"), Edit(0.5, remove="c"), Edit(0.0, set="d=1")]
    assert in_order(edits, 1.0) == [edits[1], edits[3], edits[0], edits[2]]
    with pytest.raises(SceneError, match=r"remove c at 0\.5 s: the clip is 0\.5 s long"):
        in_order(edits[2:3], 0.5)


def test_the_schema_in_docs_is_that_of_the_code() -> None:
    written = (ROOT / "docs" / "edits.schema.json").read_text(encoding="utf-8")
    assert json.loads(written) == edits_schema(), (
        "write it anew: python -c 'import json; from pipeline.editing.edit_list import edits_schema; "
        "print(json.dumps(edits_schema(), indent=2))' > docs/edits.schema.json"
    )
    assert set(edits_schema()["$defs"]["EditText"]["properties"]) == {"at", "set", "value", "remove", "add"}


@pytest.mark.parametrize("colour", ["red", [1, 2], [1, 2, 256], [1.5, 2, 3], [True, 0, 0], 5])
def test_a_colour_that_is_none_is_refused_with_what_is_valid(colour: object) -> None:
    assert added_object(Edit(0.0, add={"name": "a", "colour": [0, 10, 255]})) == ({"name": "a"}, (0, 10, 255))
    with pytest.raises(SceneError, match=r"add a at 0 s: colour: .*\[R, G, B\]"):
        added_object(Edit(0.0, add={"name": "a", "colour": colour}))
