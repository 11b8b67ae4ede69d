# Three commands: `make benchmark` (the main job), `make test`, `make check`.
# Each makes a virtual environment when it is missing and needs nothing but Python (>= 3.11) and make.

PYTHON ?= python3
CORES ?= auto

# .venv belongs to the Python that made it; another Python gets a folder of its own, .venv-3.13 for example.
VERSION := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
VENV := $(shell test ! -e .venv/pyvenv.cfg || grep -Eq '^version(_info)? *= *$(VERSION)\.' .venv/pyvenv.cfg \
	&& echo .venv || echo .venv-$(VERSION))
BIN := $(VENV)/bin
INSTALLED := $(VENV)/installed

.PHONY: help benchmark test suite check format docs publish clean

help:  ## list the targets
	@grep -E '^[a-z]+:.*## ' Makefile | sed -E 's/^([a-z]+):.*## (.*)/make \1|\2/' | awk -F'|' '{printf "%-15s %s\n", $$1, $$2}'
	@echo "PYTHON=python3.13 before or after any of them chooses another Python; CORES=1 limits the tests."

$(INSTALLED): pyproject.toml constraints.txt
	@$(if $(VERSION),,$(error $(PYTHON) does not run: name a Python of version 3.11 or newer, as in make test PYTHON=python3.13))
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and \
	"FlatQuad needs Python 3.11 or newer, and $(PYTHON) is $(VERSION): name a newer one, as in make test PYTHON=python3.13")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[all,dev]'
	@touch $@

benchmark: $(INSTALLED)  ## solve, demonstrate, train and score; under 6 minutes
	$(BIN)/flatquad benchmark

# `suite` notes the exit status instead of failing, so that the reason for a missing browser is the last line.
test: suite  ## the whole test suite; installs a browser for it where none is found
	@$(if $(shell cat $(VENV)/no-browser 2>/dev/null),$(error $(shell cat $(VENV)/no-browser)))exit $$(cat $(VENV)/status)

suite: $(INSTALLED)
	@$(BIN)/python tests/browser.py $(VENV)/no-browser || true
	@$(BIN)/python -m pytest -n $(CORES) --dist worksteal; echo $$? > $(VENV)/status

check: $(INSTALLED)  ## lint, format, types and import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(INSTALLED)  ## apply the formatter and the safe fixes
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(INSTALLED)  ## the documentation as a site that needs no network, in build/docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo "open build/docs/index.html"

publish: $(INSTALLED)  ## publish your latest results in README, docs and pictures
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[figures]'
	BROWSER_PATH="$$($(BIN)/python tests/browser.py)" $(BIN)/flatquad publish

clean:  ## remove the virtual environments and everything built
	rm -rf .venv .venv-* build dist *.egg-info
