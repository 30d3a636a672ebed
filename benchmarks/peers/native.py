"""The peers in C++: compiled here, against what the machine has."""

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
BUILD = HERE.parent.parent / "build" / "benchmarks"
G2O = HERE.parent.parent / "build" / "g2o"


@dataclass(frozen=True)
class Program:
    """One source file and what it needs: `header` says whether it is there, `install` how to get it."""

    source: str
    header: str
    flags: tuple[str, ...]
    install: str
    prefix: str = ""  # an environment variable that names where it is installed


PROGRAMS = {
    "ceres": Program(
        "ceres.cpp",
        "ceres/ceres.h",
        ("-lceres", "-lglog", "-lcholmod"),
        "apt-get install g++ libceres-dev libsuitesparse-dev libeigen3-dev",
    ),
    "g2o": Program(
        "g2o.cpp",
        "g2o/core/sparse_optimizer.h",
        (
            "-lg2o_solver_cholmod", "-lg2o_solver_eigen", "-lg2o_types_slam2d", "-lg2o_types_slam3d", "-lg2o_core",
            "-lg2o_stuff", "-lcholmod",
        ),
        "Debian has no package; python benchmarks/peers/build_g2o.py builds it, or name its folder in G2O_ROOT",
        "G2O_ROOT",
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Flat:
    """A problem as the programs read it, poses and landmarks numbered from 0; the first pose is held fixed.

    Steps (m,) are relative poses between any two poses, with sigmas [m], [rad]; sightings (s,) points in the body. The
    start is T (poses, d), R (poses, d, d), P (landmarks, d).
    """

    robots: int
    step_from: np.ndarray
    step_to: np.ndarray
    step_T: np.ndarray
    step_R: np.ndarray
    sigma_T: np.ndarray
    sigma_R: np.ndarray
    seen_from: np.ndarray
    seen: np.ndarray
    sightings: np.ndarray
    sigma_P: float
    T: np.ndarray
    R: np.ndarray
    P: np.ndarray

    def save(self, path: Path) -> None:
        """Write it as a plain row of numbers: six counts, then the arrays, int64 and double."""
        counts = [self.T.shape[1], self.robots, len(self.T), len(self.P), len(self.step_from), len(self.seen)]
        with path.open("wb") as file:
            for whole in (counts, self.step_from, self.step_to, self.seen_from, self.seen):
                np.asarray(whole, np.int64).tofile(file)
            for real in (self.step_T, self.step_R, self.sightings, self.T, self.R, self.P,
                         self.sigma_T, self.sigma_R, [self.sigma_P]):  # fmt: skip
                np.ascontiguousarray(real, float).tofile(file)


INCLUDES = ("/usr/include/eigen3", "/usr/include/suitesparse")


def missing(name: str) -> str:
    """Why a program cannot be compiled here, or nothing."""
    program = PROGRAMS[name]
    if shutil.which("g++") is None:
        return "no g++; apt-get install g++"
    roots = [_root(program), Path("/usr/local"), Path("/usr")]
    return "" if any(root and (root / "include" / program.header).exists() for root in roots) else program.install


def _root(program: Program) -> Path | None:
    """Where a program's library was installed by hand."""
    named = os.environ.get(program.prefix) if program.prefix else None
    return Path(named) if named else G2O if program.prefix and G2O.exists() else None


def compiled(name: str) -> Path:
    """The program, compiled where it is older than its source. Raises RuntimeError where it does not compile."""
    program, binary = PROGRAMS[name], BUILD / name
    sources = [HERE / program.source, HERE / "native.hpp"]
    if binary.exists() and binary.stat().st_mtime > max(s.stat().st_mtime for s in sources):
        return binary
    BUILD.mkdir(parents=True, exist_ok=True)
    root = _root(program)
    where = [f"-I{root}/include", f"-L{root}/lib", f"-Wl,-rpath,{root}/lib"] if root else []
    command = ["g++", "-std=c++17", "-O3", "-DNDEBUG", *where, *(f"-I{folder}" for folder in INCLUDES)]
    command += [str(HERE / program.source), "-o", str(binary), *(f for f in program.flags)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if "error" in line]
        raise RuntimeError(f"does not compile: {(errors or [done.stderr])[0]}")
    return binary
