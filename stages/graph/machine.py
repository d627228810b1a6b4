"""The kind of machine that a run was made on: results of searches differ in the third digit between processors."""

import os
import platform
from pathlib import Path


def machine_kind() -> str:
    """Processor, number of cores in use, and operating system, as `Intel(R) Xeon(R) CPU, 2 cores, Linux x86_64`."""
    return f"{_processor()}, {len(os.sched_getaffinity(0))} cores, {platform.system()} {platform.machine()}"


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
