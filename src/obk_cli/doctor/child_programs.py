"""Programs that checks of `obk doctor` run as children, because a library may crash or hang.

Run as `python -P -m obk_cli.doctor.child_programs PROGRAM ARGUMENTS...`. Each prints JSON objects.
`interfaces PACKAGE...` loads the compiled part of message packages. `draw` steps and draws a tiny
scene with the back end in MUJOCO_GL. `call PARENT` publishes until it gets an answer, and measures
round trips. `answer PARENT` answers until SIGTERM. The last two exit when the process PARENT, which
started them, has exited.
"""

import importlib
import json
import os
import signal
import statistics
import sys
import time
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from rclpy.node import Node

__all__ = ["load_error", "main"]

DRAW_S: Final = 15
DISCOVER_S: Final = 25
REPEAT_S: Final = 0.05
ROUNDS: Final = 10
SCENE: Final = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="1 1 .1" rgba="1 1 1 1"/>
    <body pos="0 0 .5"><freejoint/><geom size=".2" rgba="1 0 0 1"/></body>
  </worldbody>
</mujoco>
"""


def load_error(package: str) -> str:
    """Why a package's messages cannot be used; empty if they can."""
    try:
        importlib.import_module(f"{package}.{package}_s__rosidl_typesupport_c")
    except ImportError as error:
        return str(error)
    return ""


def _draw() -> None:
    """Print one object per step, so that the first is reported even if OpenGL kills the process."""
    import mujoco

    signal.alarm(DRAW_S)
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 10)
    print(json.dumps({"stepped": data.time > 0}), flush=True)
    with mujoco.Renderer(model, 48, 64) as renderer:
        renderer.update_scene(data)
        picture = renderer.render()
        drawn = int(picture.min()) < int(picture.max())
        print(json.dumps({"drawn": drawn, "renderer": _renderer_name()}), flush=True)


def _renderer_name() -> str:
    """OpenGL's name for the renderer; empty without PyOpenGL."""
    try:
        gl = importlib.import_module("OpenGL.GL")
    except ImportError:
        return ""
    name = gl.glGetString(gl.GL_RENDERER)
    return name.decode() if name else ""


def _discover(role: str, parent: int) -> None:
    import rclpy
    from rclpy.executors import ExternalShutdownException

    signal.alarm(DISCOVER_S)
    rclpy.init()
    node = rclpy.create_node(f"obk_doctor_{role}")
    try:
        if role == "answer":
            _answer(node, parent)
        else:
            print(json.dumps(_call(node, parent)), flush=True)
    except ExternalShutdownException:
        pass
    finally:
        node.destroy_node()  # type: ignore[no-untyped-call]
        rclpy.try_shutdown()


def _call(node: "Node", parent: int) -> dict[str, Any]:
    """Call until answered, then measure round trips; empty if the parent has exited."""
    import rclpy
    from std_msgs.msg import Int64

    received: list[int] = []

    def receive(message: Any) -> None:
        received.append(message.data)

    calling = node.create_publisher(Int64, "doctor_call", 10)
    node.create_subscription(Int64, "doctor_answer", receive, 10)
    start = time.monotonic()
    number = 0
    while not received:
        if os.getppid() != parent:
            return {}
        number += 1
        calling.publish(Int64(data=number))
        rclpy.spin_once(node, timeout_sec=REPEAT_S)
    first_s = time.monotonic() - start
    trips = []
    for _ in range(ROUNDS):
        number += 1
        sent = time.monotonic()
        calling.publish(Int64(data=number))
        while number not in received:
            rclpy.spin_once(node, timeout_sec=REPEAT_S)
        trips.append(time.monotonic() - sent)
    return {
        "rmw": rclpy.get_rmw_implementation_identifier(),
        "first_answer_s": round(first_s, 3),
        "round_trip_ms": round(1e3 * statistics.median(trips), 3),
    }


def _answer(node: "Node", parent: int) -> None:
    """Answer every call for as long as the parent process is running."""
    import rclpy
    from std_msgs.msg import Int64

    answering = node.create_publisher(Int64, "doctor_answer", 10)
    node.create_subscription(Int64, "doctor_call", answering.publish, 10)
    while os.getppid() == parent:
        rclpy.spin_once(node, timeout_sec=REPEAT_S)


def main(program: str, *arguments: str) -> None:
    """Run one of the programs."""
    if program == "interfaces":
        print(json.dumps({package: load_error(package) for package in arguments}))
    elif program == "draw":
        _draw()
    else:
        _discover(program, int(arguments[0]))


if __name__ == "__main__":
    main(*sys.argv[1:])
