# Two commands, on a machine with python3 (3.11 or newer, with venv), make and a C++ compiler:
#
#     make demo     shows teamslam at work; figures in ./demo
#     make test     runs all tests
#
# Both set up what they need in .venv first; after that they start at once. Also: make check, make docs, make picture,
# make clean.

# Processes that tests start find compiled modules, also where somebody's environment says not to keep them.
unexport PYTHONDONTWRITEBYTECODE

PYTHON ?= python3
WORKERS ?= auto
VENV := .venv
BIN := $(VENV)/bin
SOURCES := pyproject.toml CMakeLists.txt $(wildcard cpp/*)

.PHONY: demo test check docs picture clean

demo: $(VENV)/.ready
	$(BIN)/teamslam demo

test: $(VENV)/.ready-for-tests
	$(BIN)/python -m pytest -n $(WORKERS)

check: $(VENV)/.ready-for-tests
	scripts/check

docs: $(VENV)/.ready-for-docs
	scripts/check docs

# The picture of the README, from the demo, in few enough colours to be small.
picture: demo
	$(BIN)/python -c "from PIL import Image; Image.open('demo/demo.png').convert('RGB').quantize(256, method=Image.Quantize.FASTOCTREE).save('docs/images/demo.png', optimize=True)"

clean:
	rm -rf $(VENV) build demo docs/_build .cache

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "teamslam needs Python 3.11 or newer; found $$($(PYTHON) --version 2>&1). Try: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
	  { echo "$(PYTHON) has no venv; on Debian and Ubuntu: sudo apt-get install python3-venv"; exit 1; }
	@command -v c++ >/dev/null || command -v g++ >/dev/null || command -v clang++ >/dev/null || \
	  { echo "no C++ compiler; on Debian and Ubuntu: sudo apt-get install g++"; exit 1; }
	$(PYTHON) -m venv $(VENV)

# The kernel is compiled on installing: a change of its sources installs again.
$(VENV)/.ready: $(SOURCES) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[tags]"
	@touch $@

$(VENV)/.ready-for-tests: $(SOURCES) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	@touch $(VENV)/.ready $@

$(VENV)/.ready-for-docs: $(VENV)/.ready-for-tests
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev,docs]"
	@touch $(VENV)/.ready $(VENV)/.ready-for-tests $@
