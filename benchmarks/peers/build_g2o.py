"""g2o in C++, for the benchmark: built from the sources that the package index has with g2opy (Debian has no package).

    python benchmarks/peers/build_g2o.py [FOLDER]

Installs into build/g2o, or FOLDER, where `run.py` finds it (there, or by the environment variable G2O_ROOT). Takes some
minutes. Needs g++, cmake, ninja, pip, and Debian's libeigen3-dev, libsuitesparse-dev and nlohmann-json3-dev.
"""

import argparse
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

import native

# What g2o would look for elsewhere: a parser for command lines, which only its programs use, and CHOLMOD, for which
# Debian ships no CMake file.
NO_PARSER = "add_library(CLI11 INTERFACE)\nadd_library(CLI11::CLI11 ALIAS CLI11)\n"
FIND_CHOLMOD = """\
add_library(SuiteSparse::CHOLMOD INTERFACE IMPORTED)
set_target_properties(SuiteSparse::CHOLMOD PROPERTIES INTERFACE_INCLUDE_DIRECTORIES /usr/include/suitesparse
  INTERFACE_LINK_LIBRARIES "cholmod;amd;camd;colamd;ccolamd")
set(CHOLMOD_FOUND TRUE)
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=native.G2O)
    target = parser.parse_args().folder.resolve()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        source, build = unpacked(work), work / "build"
        for name, file, text in (("parser", "CMakeLists.txt", NO_PARSER), ("find", "FindCHOLMOD.cmake", FIND_CHOLMOD)):
            (work / name).mkdir()
            (work / name / file).write_text(text)
        off = ("BUILD_APPS", "BUILD_EXAMPLES", "BUILD_PYTHON", "USE_OPENGL", "USE_LOGGING", "USE_CSPARSE")
        run(
            "cmake", "-S", source, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
            f"-DCMAKE_INSTALL_PREFIX={target}", f"-DCMAKE_MODULE_PATH={work / 'find'}",
            f"-DFETCHCONTENT_SOURCE_DIR_CLI11_PROJ={work / 'parser'}", *(f"-DG2O_{name}=OFF" for name in off),
            *(f"-DG2O_BUILD_{name}_TYPES=OFF" for name in ("DATA", "SCLAM2D", "SBA", "ICP", "SIM3")),
        )  # fmt: skip
        run("cmake", "--build", build)
        run("cmake", "--install", build)
    print(f"g2o is in {target}")


def unpacked(work: Path) -> Path:
    """The folder of the sources."""
    run(sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--no-binary", "g2opy", "-d", work, "g2opy")
    (archive,) = work.glob("g2opy-*.tar.gz")
    with tarfile.open(archive) as tar:
        tar.extractall(work, filter="data")
    (source,) = (p for p in work.glob("g2opy-*") if p.is_dir())
    return source


def run(*command: object) -> None:
    subprocess.run([str(part) for part in command], check=True)


if __name__ == "__main__":
    main()
