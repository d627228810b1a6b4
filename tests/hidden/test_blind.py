"""The discovery cannot see the truth: neither through the graph nor through imports."""

from pathlib import Path

import pytest

from pipeline.shards.code_hash import ROOT, module_closure

TRUTH = "data/hide/truth"
STAGES = ("stages/discover.py", "stages/discover_filmed.py")


def ancestors(name: str, stages: dict[str, object]) -> set[str]:
    """The stages whose outputs `name` depends on, through any number of others."""
    found: set[str] = set()
    waiting = [name]
    while waiting:
        deps = {d.def_path for d in stages[waiting.pop()].deps if not hasattr(d, "params")}  # type: ignore[attr-defined]
        for other, stage in stages.items():
            outs = {o.def_path for o in stage.outs}  # type: ignore[attr-defined]
            if any(d == o or d.startswith(o + "/") for d in deps for o in outs) and other not in found:
                found.add(other)
                waiting.append(other)
    return found


def test_no_stage_but_verify_depends_on_the_truth() -> None:
    if not (ROOT / ".dvc").is_dir():
        pytest.skip("this is no DVC repository (an archive without .dvc)")
    from dvc.repo import Repo

    with Repo(str(ROOT)) as repo:
        stages = {s.name: s for s in repo.index.stages}

    def sees(stage: object) -> bool:
        deps = [d.def_path for d in stage.deps if not hasattr(d, "params")]  # type: ignore[attr-defined]
        return any(d.startswith(TRUTH) or TRUTH.startswith(d + "/") for d in deps)

    assert [name for name, stage in stages.items() if sees(stage)] == ["verify"]
    for name, hiding, seen in (
        ("discover", "hide", "data/hide/measured"),
        ("discover_filmed", "hide_filmed", "data/hide/filmed"),
    ):
        assert ancestors(name, stages) == {hiding}
        assert not any(sees(stages[own]) for own in (name, hiding))
        assert [d.def_path for d in stages[name].deps if d.def_path.startswith("data/")] == [seen]


def test_the_discovery_imports_nothing_of_what_hides() -> None:
    for module in (*STAGES, "pipeline/commands/discover.py"):
        closure = module_closure(ROOT / module)
        assert not [path for path in closure if Path("pipeline/hidden") in path.relative_to(ROOT).parents]
        assert (
            ROOT / "pipeline/scene/effects/kinds/air_drag.py"
        ) in closure  # the registry's modules are in the closure


@pytest.mark.parametrize("stage", STAGES)
def test_the_code_of_the_discovery_names_no_truth(stage: str) -> None:
    for path in module_closure(ROOT / stage):
        if path != ROOT / stage:
            assert "hide/truth" not in path.read_text()
    code = (ROOT / stage).read_text().split('"""', 2)[2]
    assert "truth" not in code
