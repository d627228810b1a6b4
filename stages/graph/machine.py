"""The kind of machine that made a report: another kind gives other last digits, and searches end a little elsewhere."""

import platform
import subprocess
from pathlib import Path


def machine_kind() -> str:
    """Processor, operating system and Python, as `AMD EPYC 9V74, Linux x86_64, Python 3.11`; no name of the host."""
    python = ".".join(platform.python_version_tuple()[:2])
    return f"{_processor()}, {platform.system()} {platform.machine()}, Python {python}"


def _processor() -> str:
    if platform.system() == "Darwin":
        command = ["sysctl", "-n", "machdep.cpu.brand_string"]
        return subprocess.run(command, capture_output=True, text=True).stdout.strip() or "unknown processor"
    cpuinfo = Path("/proc/cpuinfo")
    model = model_name(cpuinfo.read_text()) if cpuinfo.is_file() else ""
    return model or platform.processor() or "unknown processor"


def model_name(cpuinfo: str) -> str:
    """The processor's model in the text of /proc/cpuinfo; empty where it is not named (on ARM)."""
    lines = (line.partition(":") for line in cpuinfo.splitlines())
    names = (value.strip() for key, _, value in lines if key.strip() == "model name")
    return " ".join(next(names, "").split())
