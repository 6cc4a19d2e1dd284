# Two commands for a fresh machine with Python >= 3.11: `make demo` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# The tests run side by side, one process a core; more BLAS threads would only get in their way.
# Each process takes neighbouring tests (worksteal), so that few kernels are compiled twice.
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
# Bytecode is kept: without it each process compiles all tests, with their rewritten assertions, anew.
unexport PYTHONDONTWRITEBYTECODE
EXAMPLES := $(addprefix run-,$(notdir $(wildcard examples/*.py)))

# Options of pytest, as a part of a lane and the seconds within which its tests begin: make test-slow PYTEST="--shard=0/12 --start-within=200"
PYTEST ?=

.PHONY: help demo test test-slow test-mpi test-processor test-oldest test-wheel lint doctest examples docs browser-check readme clean $(EXAMPLES)

help:
	@echo "make demo       install, solve the frictional contact block, write VTK and a picture to out/"
	@echo "make test       install what tests need, run all tests but the slow ones"
	@echo "make test-slow  the same with the slow lanes"
	@echo "make test-processor  the fast tests as another processor would run them, on two BLAS threads"
	@echo "make test-oldest     the fast tests with the oldest versions of what we depend on, on Python 3.11"
	@echo "make test-wheel      the fast tests with the wheel, installed apart from this tree: make test-wheel PYTHON=python3.13"
	@echo "make test-mpi   the tests on one, two and three processes, with petsc4py built for the PETSc that is there"
	@echo "make lint       ruff, mypy, and which rooms know which"
	@echo "make doctest    the examples in docstrings"
	@echo "make examples   every script in examples/, as a user would run it"
	@echo "make docs       out/docs/index.html: guide, tutorials, gallery (with the pictures of make examples), reference"
	@echo "make browser-check   look at the built site in Chromium, as a desktop and a phone show it"
	@echo "make readme     write the tables of docs/ from benchmarks/results"

$(VENV)/pyvenv.cfg:
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed; try make PYTHON=python3.12" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.demo: pyproject.toml | $(VENV)/pyvenv.cfg
	$(BIN)/python -m pip install --quiet --editable .
	@touch $@

$(VENV)/.test: pyproject.toml | $(VENV)/pyvenv.cfg
	$(BIN)/python -m pip install --quiet --editable '.[test]'
	@touch $(VENV)/.demo $@

$(VENV)/.docs: pyproject.toml | $(VENV)/pyvenv.cfg
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	@touch $(VENV)/.demo $@

demo: $(VENV)/.demo
	$(BIN)/python examples/contact_block.py

test: $(VENV)/.test
	$(ONE_THREAD) $(BIN)/python -m pytest -n auto --dist worksteal -m "not slow" $(PYTEST)

test-slow: $(VENV)/.test
	$(ONE_THREAD) HYPOTHESIS_PROFILE=slow $(BIN)/python -m pytest -n auto --dist worksteal $(PYTEST)

# TURN chooses the processor; without it the clock does.
test-processor: $(VENV)/.test
	@$(BIN)/python .ci/other_processor.py $(TURN) | tee $(VENV)/processor
	env $$(cat $(VENV)/processor) OMP_NUM_THREADS=2 OPENBLAS_NUM_THREADS=2 MKL_NUM_THREADS=2 \
		$(BIN)/python -m pytest -n auto --dist worksteal -m "not slow" $(PYTEST)

OLDEST := $(VENV)-oldest

$(OLDEST)/.test: pyproject.toml .ci/oldest_versions.py
	python3.11 -m venv $(OLDEST)
	$(OLDEST)/bin/python .ci/oldest_versions.py > $(OLDEST)/constraints.txt
	$(OLDEST)/bin/python -m pip install --quiet --editable '.[test,mkl,amg,io]' --constraint $(OLDEST)/constraints.txt
	@touch $@

test-oldest: $(OLDEST)/.test
	$(ONE_THREAD) $(OLDEST)/bin/python -m pytest -n auto --dist worksteal -m "not slow" $(PYTEST)

# Beside the packages of the first environment: petsc4py and its kin, or the reason why they cannot be had.
MPI := $(VENV)-mpi

$(MPI)/.test: .ci/petsc.sh pyproject.toml $(VENV)/.test
	.ci/petsc.sh $(VENV) $(MPI)
	@touch $@

test-mpi: $(MPI)/.test
	@if [ -e $(MPI)/skipped ]; then echo "skipped: $$(cat $(MPI)/skipped)"; \
	else $(ONE_THREAD) $(MPI)/bin/python -m pytest -n 0 -m mpi $(PYTEST) \
		$$(grep -rlE "mark.mpi|mpi_runs" tests --include='test_*.py'); fi

# A copy without the packages, so that only the installed ones can be found.
APART := $(VENV)-wheel

test-wheel: $(VENV)/.test
	rm -rf $(APART)
	$(BIN)/python -m build --outdir $(APART)/dist .
	$(BIN)/python .ci/check_distributions.py $(APART)/dist
	$(PYTHON) -m venv $(APART)/venv
	$(APART)/venv/bin/python -m pip install --quiet "$$(echo $(APART)/dist/*.whl)[test]"
	mkdir $(APART)/tree
	cp -r tests examples benchmarks docs pyproject.toml README.md CONTRIBUTING.md CHANGELOG.md $(APART)/tree
	rm $(APART)/tree/tests/test_house.py $(APART)/tree/tests/test_rooms.py $(APART)/tree/tests/test_release.py
	cd $(APART)/tree && $(ONE_THREAD) ../venv/bin/python -m pytest -n auto --dist worksteal -m "not slow" $(PYTEST)

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

doctest: $(VENV)/.test
	$(ONE_THREAD) $(BIN)/python -m pytest -q -n auto --doctest-modules --import-mode=append skfem_adini contact cip gpu

examples: $(VENV)/.test
	$(ONE_THREAD) $(MAKE) --no-print-directory --jobs 2 --output-sync=target $(EXAMPLES)

run-contact_part.py: run-bumper_mesh.py  # the part reads the mesh

$(EXAMPLES): run-%:
	@echo "== examples/$*" && $(BIN)/python examples/$*

docs: $(VENV)/.docs
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going docs out/docs
	@echo "written to out/docs/index.html"

$(VENV)/.browser: pyproject.toml | $(VENV)/pyvenv.cfg
	$(BIN)/python -m pip install --quiet --editable '.[browser]'
	@touch $@

browser-check:
	@if command -v chromium >/dev/null; then \
		$(MAKE) --no-print-directory $(VENV)/.browser && $(BIN)/python docs/browser_check.py; \
	else echo "skipped: no Chromium on the path (Debian: apt-get install chromium)"; fi

readme: $(VENV)/.demo
	$(BIN)/python benchmarks/performance_tables.py

clean:
	rm -rf $(VENV) $(OLDEST) $(APART) out build dist *.egg-info
