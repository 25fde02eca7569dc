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

setup: .venv/.ready  ## system libraries, .venv and the Python packages, those of the tests, too

demo: .venv/.demo  ## new views of a terrain: build/demo.png
	@$(RUN) docs/gallery/demo.py

# PoCL compiles each kernel once, not a second time for its work-groups' size: a third of the time, and a test holds that
# pictures are the same.
test test-all test-intel fuzz: export POCL_WORK_GROUP_SPECIALIZATION ?= 0
# Tests start dozens of processes, and each would compile what it imports.
test test-all test-intel fuzz: export PYTHONDONTWRITEBYTECODE :=
# A test on Intel's runtime wants it.
test test-all: .venv/.ready $(if $(findstring intel,$(PYIBR_DEVICE)),.venv/.cpu)
# Each core begins with a run of files of its own, and takes some of another's when it has done them.
TESTS := $(RUN) -m pytest -q -n logical --dist worksteal

test:  ## the tests, but for those that take long (ARGS="-k warp" for some of them)
	@$(TESTS) -m "not thorough" $(ARGS)

test-all:  ## all tests: random calls, kernels within fences, browsers and recordings, too
	@$(TESTS) -m "not product" $(ARGS)

test-intel: .venv/.cpu  ## some pictures by Intel's CPU runtime, which pip installs, beside PoCL's
	@PYIBR_DEVICE=intel $(RUN) -m pytest -q -m "not product" -k intel tests/opencl

# Each day's calls are others.
FUZZ_FIRST ?= $(shell date +%Y%m%d)00000
fuzz: .venv/.ready  ## what test-all leaves out, 37,000 random calls, and 5,000 warps against rays (FUZZ_FIRST=1)
	@$(TESTS) -m product
	@echo "seeds from $(FUZZ_FIRST) on"
	@$(RUN) -m tests.attack rays --first $(FUZZ_FIRST) --count 5000
	@$(RUN) -m tests.attack warp --first $(FUZZ_FIRST) --count 20000
	@$(RUN) -m tests.attack render --first $(FUZZ_FIRST) --count 10000
	@$(RUN) -m tests.attack register --first $(FUZZ_FIRST) --count 5000
	@$(RUN) -m tests.attack clean --first $(FUZZ_FIRST) --count 2000

test-arm: .venv/.ready  ## the wheel on a Debian for ARM, emulated, and its pictures beside this machine's (as root)
	@$(RUN) -m tools.arm $(ARGS)

test-devices: .venv/.cpu  ## every kernel by the compilers of GPUs that are not here, and by PoCL, Intel's runtime and rusticl
	@$(RUN) -m tools.device_compile
	@$(RUN) -m tools.devices $(ARGS)

check: .venv/.ready  ## lint, format, types and who imports whom
	@$(RUN) -m ruff check .
	@$(RUN) -m ruff format --check .
	@$(RUN) -m pyright
	@.venv/bin/lint-imports --no-cache

audit: .venv/.ready  ## known vulnerabilities in what is installed
	@$(RUN) -m pip_audit --local --skip-editable

bench: .venv/.bench  ## time against the peers and the paper
	@$(RUN) -m benchmarks $(ARGS)

gpu: .venv/.bench  ## what a GPU is asked first: doctor, the kernels' tests, pictures beside a CPU's, times
	@.venv/bin/pyibr doctor
	@$(RUN) -m benchmarks card $(ARGS)

gallery: .venv/.bench  ## every picture of the manual, from nothing: docs/images
	@$(RUN) docs/gallery/pictures.py
	@$(RUN) docs/gallery/pages.py
	@sha256sum docs/gallery/*.py > docs/images/scripts.sha256

docs: .venv/.docs  ## the manual: build/docs/index.html
	@sha256sum docs/gallery/*.py | grep -vxFf docs/images/scripts.sha256 | sed 's/.* /pictures are older than their script (make gallery): /'
	@$(RUN) -m sphinx -q -W docs build/docs

wheel: .venv/.ready  ## the wheel from the source package, installed alone and beside another's OpenCV
	@rm -rf dist && $(RUN) -m build --outdir dist . >/dev/null
	@$(RUN) -m twine check --strict dist/* >/dev/null
	@$(PYTHON) .ci/installs.py dist/*.whl bare beside

clean:  ## remove .venv and all that was built
	rm -rf .venv build dist .pytest_cache .ruff_cache
