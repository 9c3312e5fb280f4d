"""The caller's side of the process that reads mesh files."""

from __future__ import annotations

import base64
import json
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.process_environment import ONE_THREAD
from ff_planner_ros.robot.urdf import mesh_reader
from ff_planner_ros.robot.urdf.convex_hull import NoSolid

if TYPE_CHECKING:
    import subprocess

_PROGRAM = [sys.executable, "-P", "-m", mesh_reader.__name__]
_LONGEST = 1_000_000  # [characters] of an answer: a thousand corners are 16,000
# Causes by the signal that ended the process.
_ENDS: dict[int, str] = {
    signal.SIGXCPU: f"to read it takes more than {mesh_reader.MAX_SECONDS} s of a processor",
    signal.SIGALRM: f"to read it takes more than {mesh_reader.MAX_WAIT} s",
    signal.SIGKILL: "the process that reads it was killed: there may be too little memory",
}
_CRASHED = "it crashes what reads it: its nodes may hold each other, or be nested too deep"


class Hull(NamedTuple):
    """The convex hull of a file's mesh."""

    corners: Array  # before `scale`; shape (corners, 3) [m]
    growth: float  # by simplification, relative to its width
    vertices: int  # number of the mesh's vertices
    unit: float  # of the file's lengths [m]


class MeshProcess:
    """Reads mesh files in a process, which starts with the first file, and again after a crash."""

    def __init__(self) -> None:
        """Start no process yet."""
        self._process: subprocess.Popen[str] | None = None

    def read(self, path: Path, scale: Sequence[float]) -> Hull:
        """Return the convex hull of the mesh in a file.

        Args:
            scale: Factor along each axis, with which the hull is simplified.

        Raises:
            ValueError: A `NoSolid`: the mesh has no hull, or the file cannot be read within the
                limits of `mesh_reader`.
            OSError: No process can be started.
        """
        asked = json.dumps({"path": str(path), "scale": list(scale)})
        answer = self._answer(asked)
        try:
            said = json.loads(answer)
        except ValueError:
            raise NoSolid(self._how_it_ended()) from None
        if "fault" in said:
            raise NoSolid(said["fault"])
        corners = np.frombuffer(base64.b64decode(said["corners"]), "<f4").reshape(-1, 3)
        return Hull(corners.astype(float), said["growth"], said["vertices"], said["unit"])

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            with suppress(BrokenPipeError):  # a request may still be buffered
                self._process.communicate()
            self._process = None

    def _answer(self, asked: str) -> str:
        """Return a line of the process; cut off or empty if the process ended instead."""
        if self._process is None:
            import subprocess  # no robot without meshes comes here

            self._process = subprocess.Popen(
                _PROGRAM,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=os.environ | ONE_THREAD,
                text=True,
                start_new_session=True,  # Ctrl-C is for the command, which ends this one
            )
        questions, answers = self._process.stdin, self._process.stdout
        with suppress(BrokenPipeError):
            if questions is not None and answers is not None:
                print(asked, file=questions, flush=True)
                return answers.readline(_LONGEST)
        return ""

    def _how_it_ended(self) -> str:
        """Return why there was no answer, and close the process: the next file starts another."""
        code = 0 if self._process is None else self._process.wait()
        self.close()
        return _ENDS.get(-code, _CRASHED) if code < 0 else "it cannot be read"
