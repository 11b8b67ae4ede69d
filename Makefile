# Three commands: `make benchmark` (the main job), `make test`, `make check`.
# Each makes .venv when it is missing and needs nothing but Python (>= 3.11) and make.

PYTHON ?= python3
BIN := .venv/bin
CORES ?= auto

.PHONY: help benchmark test check format readme docs clean

help:
	@echo "make benchmark   solve, demonstrate, train and score; under 6 minutes"
	@echo "make test        the whole test suite"
	@echo "make check       lint, format, types and import contracts"
	@echo "make format      apply the formatter and the safe fixes"
	@echo "make readme      publish your latest results in README (needs a Chromium for the picture)"
	@echo "make docs        the API reference from the docstrings, in build/docs"

.venv/installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[all,dev]'
	@touch $@

benchmark: .venv/installed
	$(BIN)/flatquad benchmark

test: .venv/installed
	$(BIN)/python -m pytest -n $(CORES)

check: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: .venv/installed
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

readme: .venv/installed
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[figures]'
	$(BIN)/python -m experiments.readme

docs: .venv/installed
	$(BIN)/python docs/build.py build/docs

clean:
	rm -rf .venv build dist *.egg-info
