"""Choice of the renderer of RGB pictures: MuJoCo's through EGL or OSMesa, or the ray caster.

OpenGL may fail by killing its process. So each platform is tried once, in a separate process.
"""

from __future__ import annotations

import functools
import os
import subprocess
import sys

from pipeline.errors import ParamsError

GL_PLATFORMS = ("egl", "osmesa")
CHOICES = ("auto", "mujoco", "raycast")

_PROBE = """
import mujoco
model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><light pos="0 0 3"/><geom size=".1"/></worldbody></mujoco>')
renderer, data = mujoco.Renderer(model, 16, 16), mujoco.MjData(model)
mujoco.mj_forward(model, data)
renderer.update_scene(data)
assert renderer.render().max() > 0, "the picture is black"
renderer.close()
print("rendered")
"""


def choose_backend(choice: str) -> tuple[str, str]:
    """The backend, "mujoco" or "raycast", and the reason in words. choice: one of `CHOICES`.

    If "mujoco" is chosen, MUJOCO_GL is set for this process and its children. If MUJOCO_GL is already one of
    `GL_PLATFORMS`, only that platform is tried. Raises ParamsError where `choice` is "mujoco" and no platform works.
    """
    if choice not in CHOICES:
        raise ParamsError(f"render backend {choice!r}: valid are {', '.join(CHOICES)}")
    if choice == "raycast":
        return "raycast", "the ray caster, as requested"
    wanted = os.environ.get("MUJOCO_GL", "").strip().lower()
    problems = []
    for platform in (wanted,) if wanted in GL_PLATFORMS else GL_PLATFORMS:
        problem = gl_problem(platform)
        if problem is None:
            os.environ["MUJOCO_GL"] = platform
            return "mujoco", f"MuJoCo's renderer through {platform}"
        problems.append(f"{platform}: {problem}")
    if choice == "mujoco":
        raise ParamsError(f"MuJoCo's renderer was requested, but no OpenGL platform works ({'; '.join(problems)})")
    return "raycast", f"the ray caster, because no OpenGL platform works ({'; '.join(problems)})"


@functools.cache
def gl_problem(platform: str, timeout_s: float = 60.0) -> str | None:
    """The error message when MuJoCo renders through a platform of `GL_PLATFORMS`; None where it works."""
    environment = {**os.environ, "MUJOCO_GL": platform, "PYOPENGL_PLATFORM": platform}
    try:
        done = subprocess.run(
            [sys.executable, "-c", _PROBE], env=environment, capture_output=True, text=True, timeout=timeout_s
        )
    except subprocess.TimeoutExpired:
        return f"no picture within {timeout_s:.0f} s"
    if "rendered" in done.stdout:
        return None
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines else f"the process exited with code {done.returncode}"


def gl_platform() -> str:
    """The OpenGL platform: MUJOCO_GL where it is one of `GL_PLATFORMS`, else the first that works.

    Also sets PYOPENGL_PLATFORM, which PyOpenGL reads when it is imported. Raises ParamsError where none works.
    """
    if os.environ.get("MUJOCO_GL", "").strip().lower() not in GL_PLATFORMS:
        choose_backend("mujoco")
    platform = os.environ["MUJOCO_GL"].strip().lower()
    os.environ["PYOPENGL_PLATFORM"] = platform
    return platform
