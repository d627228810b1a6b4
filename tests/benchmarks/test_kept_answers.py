"""Long benchmarks keep their answers, can be continued, and are balanced when they are stopped."""

from collections import Counter
from pathlib import Path

import pytest

from benchmarks.discovery import FIRST_SEED, WEIGHTS, balanced, first_of_each, plan
from benchmarks.kept_answers import answers_of, kept_answers


def squared(job: int) -> dict[str, int]:
    return {"job": job, "square": job * job}


def test_answers_are_appended_one_by_one_and_a_stopped_run_keeps_them(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    assert kept_answers(path) == []
    assert len(list(answers_of(squared, [1, 2, 3, 4], path, 1, 1e-9))) == 1  # no time: one answer, and it is kept
    first = kept_answers(path)
    rest = [j for j in (1, 2, 3, 4) if j not in {a["job"] for a in first}]
    given = list(answers_of(squared, rest, path, 1, None))
    assert kept_answers(path) == first + given
    assert sorted(a["square"] for a in kept_answers(path)) == [1, 4, 9, 16]


@pytest.mark.parametrize("stop", [100, 250])
def test_a_stopped_blind_run_has_as_many_of_every_group_and_every_effect_once_before_any_twice(stop: int) -> None:
    jobs = [(str(i), *world) for i, world in enumerate(plan(1.0, FIRST_SEED))]
    order = balanced(jobs)
    assert sorted(order, key=lambda j: int(j[0])) == jobs
    groups = Counter(group for _, group, _, _ in order[:stop])
    usual = [n for group, n in groups.items() if group not in WEIGHTS]
    assert max(usual) - min(usual) <= 1
    assert WEIGHTS["none"] * (min(usual) - 1) <= groups["none"] <= WEIGHTS["none"] * max(usual)
    names = Counter(recipe.effects for _, group, recipe, _ in order[:stop] if group == "12 clips, 2 mm, strong")
    assert max(names.values()) == 1


def test_of_each_group_the_first_worlds_are_taken_in_their_order() -> None:
    jobs = [(str(i), *world) for i, world in enumerate(plan(0.25, FIRST_SEED))]
    taken = first_of_each(jobs, 2)
    counts = Counter(group for _, group, _, _ in taken)
    assert counts == {group: min(2, n) for group, n in Counter(group for _, group, _, _ in jobs).items()}
    assert taken == [job for job in jobs if job in taken] and first_of_each(jobs, None) == jobs
