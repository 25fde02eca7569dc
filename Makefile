# Every target sets up what it needs; a second run starts at once.
PYTHON ?= python3
RUN := .venv/bin/python

.PHONY: help setup demo test test-all test-intel test-arm test-devices fuzz check audit bench gpu gallery docs wheel clean

help:  ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 10

.venv/.demo .venv/.ready: pyproject.toml tools/setup.py
	@$(PYTHON) tools/setup.py $(if $(findstring demo,$@),--demo)

.venv/.docs .venv/.bench .venv/.cpu: .venv/.%: .venv/.ready
	@$(RUN) -m pip install -q -e '.[$*]' && touch $@

setup: .venv/.ready  ## system libraries, .venv and the Python packages, including the tests' packages

demo: .venv/.demo  ## new views of a terrain: build/demo.png
	@$(RUN) docs/gallery/demo.py

# PoCL compiles each kernel once, not a second time for its work-groups' size. This takes a third of the time; a test
# checks that pictures are the same.
test test-all test-intel fuzz: export POCL_WORK_GROUP_SPECIALIZATION ?= 0
# Tests start dozens of processes, and each would compile what it imports.
test test-all test-intel fuzz: export PYTHONDONTWRITEBYTECODE :=
# A test on Intel's runtime needs .venv/.cpu.
test test-all: .venv/.ready $(if $(findstring intel,$(PYIBR_DEVICE)),.venv/.cpu)
# Each core starts with its own files, and takes over files of another core when it is done.
TESTS := $(RUN) -m pytest -q -n logical --dist worksteal

test:  ## the tests, except long ones (ARGS="-k warp" for some of them)
	@$(TESTS) -m "not thorough" $(ARGS)

test-all:  ## all tests, including random calls, fenced kernels, browsers and recordings
	@$(TESTS) -m "not product" $(ARGS)

test-intel: .venv/.cpu  ## some pictures by Intel's CPU runtime, which pip installs, compared with PoCL's
	@PYIBR_DEVICE=intel $(RUN) -m pytest -q -m "not product" -k intel tests/opencl

# Every day has other calls.
FUZZ_FIRST ?= $(shell date +%Y%m%d)00000
fuzz: .venv/.ready  ## tests that test-all leaves out, 37,000 random calls, and 5,000 warps against rays (FUZZ_FIRST=1)
	@$(TESTS) -m product
	@echo "seeds from $(FUZZ_FIRST) on"
	@$(RUN) -m tests.attack rays --first $(FUZZ_FIRST) --count 5000
	@$(RUN) -m tests.attack warp --first $(FUZZ_FIRST) --count 20000
	@$(RUN) -m tests.attack render --first $(FUZZ_FIRST) --count 10000
	@$(RUN) -m tests.attack register --first $(FUZZ_FIRST) --count 5000
	@$(RUN) -m tests.attack clean --first $(FUZZ_FIRST) --count 2000

test-arm: .venv/.ready  ## the wheel on an emulated Debian for ARM, with pictures compared with this machine's (as root)
	@$(RUN) -m tools.arm $(ARGS)

test-devices: .venv/.cpu  ## every kernel by compilers of GPUs that are not here, and by PoCL, Intel's runtime and rusticl
	@$(RUN) -m tools.device_compile
	@$(RUN) -m tools.devices $(ARGS)

check: .venv/.ready  ## lint, format, types and import rules
	@$(RUN) -m ruff check .
	@$(RUN) -m ruff format --check .
	@$(RUN) -m pyright
	@.venv/bin/lint-imports --no-cache

audit: .venv/.ready  ## known vulnerabilities of installed packages
	@$(RUN) -m pip_audit --local --skip-editable

bench: .venv/.bench  ## times compared with the peers and the paper
	@$(RUN) -m benchmarks $(ARGS)

gpu: .venv/.bench  ## first checks of a GPU: doctor, the kernels' tests, pictures compared with a CPU's, times
	@.venv/bin/pyibr doctor
	@$(RUN) -m benchmarks card $(ARGS)

gallery: .venv/.bench  ## every picture of the manual, made anew: docs/images
	@$(RUN) docs/gallery/pictures.py
	@$(RUN) docs/gallery/pages.py
	@sha256sum docs/gallery/*.py > docs/images/scripts.sha256

docs: .venv/.docs  ## the manual: build/docs/index.html
	@sha256sum docs/gallery/*.py | grep -vxFf docs/images/scripts.sha256 | sed 's/.* /pictures are older than their script (make gallery): /'
	@$(RUN) -m sphinx -q -W docs build/docs

wheel: .venv/.ready  ## the wheel from the source package, installed alone and next to another OpenCV
	@rm -rf dist && $(RUN) -m build --outdir dist . >/dev/null
	@$(RUN) -m twine check --strict dist/* >/dev/null
	@$(PYTHON) .ci/installs.py dist/*.whl bare beside

clean:  ## remove .venv and everything that was built
	rm -rf .venv build dist .pytest_cache .ruff_cache
