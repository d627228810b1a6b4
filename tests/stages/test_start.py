"""How a stage starts: what it imports before it knows whether a shard is missing."""

import subprocess
import sys

from pipeline.shards.code_hash import ROOT

WITHOUT_SHARDS = ("score", "score_views", "verify")
STAGES = sorted(path.stem for path in (ROOT / "stages").glob("[!_]*.py") if path.stem not in WITHOUT_SHARDS)
SLOW = ("torch", "transformers", "tokenizers", "accelerate", "peft", "matplotlib", "scipy.stats", "cma", "av")


def test_a_stage_whose_shards_are_all_in_the_store_imports_nothing_that_takes_a_second() -> None:
    imports = ", ".join(f"stages.{stage}" for stage in STAGES)
    code = f"import sys, {imports}; print([m for m in {SLOW} if m in sys.modules])"
    said = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert said.strip() == "[]"
