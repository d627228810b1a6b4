"""The kind of machine that a report names."""

import platform

import pytest

from stages.graph.machine import machine_kind, model_name


def test_the_kind_of_machine_is_one_line_with_processor_system_and_python() -> None:
    processor, system, python = machine_kind().rsplit(", ", 2)
    assert processor
    assert system == f"{platform.system()} {platform.machine()}"
    assert python == "Python " + platform.python_version().rpartition(".")[0]
    assert "\n" not in machine_kind()


def test_the_kind_of_machine_does_not_name_the_host() -> None:
    assert platform.node() not in machine_kind()


@pytest.mark.parametrize(
    ("cpuinfo", "name"),
    [
        ("model\t\t: 17\nmodel name\t: AMD EPYC  9V74\n\nprocessor\t: 1\nmodel name\t: B\n", "AMD EPYC 9V74"),
        ("processor\t: 0\nCPU implementer\t: 0x41\n", ""),
        ("", ""),
    ],
)
def test_the_model_is_the_first_processor_s_where_it_is_named(cpuinfo: str, name: str) -> None:
    assert model_name(cpuinfo) == name
