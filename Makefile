# Everything from a fresh clone: `make test`, `make repro`. Needs Python 3.11, git and make.

VENV ?= .venv
PROFILE ?= quick
# Extra arguments, as in `make test PYTEST_ARGS="-x -k sphere"`; `-n 0` runs the tests one after the other.
PYTEST_ARGS ?=
# Overrides of conf/bench.yaml, as in `make bench BENCH_ARGS="output=reports/performance.md"`.
BENCH_ARGS ?=
# Overrides of conf/bench_arms.yaml, as in `make arms ARMS_ARGS="output=reports/performance.md"`.
ARMS_ARGS ?=
# Overrides of conf/soak.yaml, as in `make soak SOAK_ARGS="output=reports/soak.md"`.
SOAK_ARGS ?=
# The first command that is Python 3.11; another one: `make venv PYTHON=/path/to/python3.11`.
PYTHON ?= $(shell for name in python3.11 python3 python; do $(call is_python,$$name) && { echo $$name; break; }; done)

is_python = "$(1)" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' >/dev/null 2>&1
bin := $(abspath $(VENV))/bin
stamp := $(VENV)/.installed
pipeline_file = $(if $(filter quick,$(PROFILE)),dvc.yaml,profiles/$(PROFILE)/dvc.yaml)

# Stages are started by DVC as `python stages/<stage>.py`, tests start DVC: both must find those of the environment.
export PATH := $(bin):$(PATH)

.DEFAULT_GOAL := help
.PHONY: help venv test bench arms soak repro dag lint format types lock clean ci

help:  ## list the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## */  \1\t/' | expand -t 12

venv: $(stamp)  ## make the environment from requirements.lock (again only when the lock has changed)

# torch goes first and alone: nothing after it may resolve it again, hence --no-deps. pip's own settings decide which
# build of it is found. Without isolation nothing is downloaded that the lock does not name.
$(stamp): requirements.lock
	@if ! [ -x $(bin)/python ]; then \
	    [ -n "$(PYTHON)" ] && $(call is_python,$(PYTHON)) || { \
	        echo "Python 3.11 is needed and '$(or $(PYTHON),python3.11)' is not it: install it," \
	            "or say where it is with 'make venv PYTHON=/path/to/python3.11'." >&2; exit 1; }; \
	    "$(PYTHON)" -m venv $(VENV) || { rm -rf $(VENV); exit 1; }; \
	fi
	$(bin)/python -m pip install --quiet "$$(grep '^torch==' requirements.lock)"
	$(bin)/python -m pip install --quiet --no-deps "$$(grep '^setuptools==' requirements.lock)"
	$(bin)/python -m pip install --quiet --no-deps --no-build-isolation -r requirements.lock
	$(bin)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

test: venv  ## run the tests
	@$(bin)/python -m pytest --numprocesses=auto --maxprocesses=4 --dist=loadfile $(PYTEST_ARGS)

bench: venv arms  ## measure arms, then parts, planning on the sphere and scaling, in under two hours on 2 idle cores
	@$(bin)/python stages/bench.py $(BENCH_ARGS)

soak: venv  ## plan and verify 25 000 paths of all families, in some 40 minutes on 2 cores; resumable
	@$(bin)/python stages/soak.py $(SOAK_ARGS)

arms: venv  ## the first part of bench, resumable: against OMPL and, where installed, roboplan (pip install roboplan==0.7.0)
	@$(bin)/python stages/bench_arms.py $(ARMS_ARGS)

repro: venv  ## run the pipeline: PROFILE=quick (default), standard, paper
	@[ -f $(pipeline_file) ] || { echo "profile '$(PROFILE)' has no $(pipeline_file); there are:" \
	    $(if $(wildcard dvc.yaml),quick) $(notdir $(patsubst %/dvc.yaml,%,$(wildcard profiles/*/dvc.yaml))) >&2; exit 1; }
	$(bin)/dvc repro $(pipeline_file)

dag: venv  ## write dvc.yaml, for every profile, from what stages import and what Hydra composes
	@$(bin)/python stages/dag.py

lint: venv  ## check rules and format
	$(bin)/ruff check .
	$(bin)/ruff format --check .

format: venv  ## mend what ruff can mend
	$(bin)/ruff check --fix .
	$(bin)/ruff format .

types: venv  ## check types of pipeline/
	$(bin)/mypy

lock:  ## resolve pyproject.toml anew into requirements.lock (downloads everything)
	@$(call is_python,$(PYTHON)) || { echo "Python 3.11 is needed to make the lock" >&2; exit 1; }
	@set -e; work=$$(mktemp -d); trap 'rm -rf "$$work"' EXIT; pip="$$work/venv/bin/python -m pip"; \
	torch=$$(sed -nE 's/^ *"(torch==[^"]+)".*/\1/p' pyproject.toml); \
	"$(PYTHON)" -m venv "$$work/venv"; \
	$$pip install --quiet "$$torch"; \
	echo "$$torch" > "$$work/constraint"; \
	$$pip install --quiet --no-build-isolation --constraint "$$work/constraint" --editable '.[dev]'; \
	{ echo "# Every package of the environment, runtime and tools, pinned (Linux, Python 3.11)."; \
	  echo "# Do not edit: change pyproject.toml and run make lock. Installed by make venv, torch first."; \
	  $$pip freeze --all --exclude-editable --exclude pip | sed 's/+[^ ;]*$$//' | LC_ALL=C sort -f; \
	} > "$$work/lock"; \
	if grep -iE '^(nvidia|cuda|triton)|@' "$$work/lock"; then \
	    echo "the packages above do not belong into a lock: let pip find a CPU build of torch" >&2; exit 1; fi; \
	cp "$$work/lock" requirements.lock

clean:  ## remove the environment and caches; keep artifacts, reports and DVC's cache
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis *.egg-info
	find pipeline stages tests -name __pycache__ -prune -exec rm -rf {} +

ci:  ## run what CI runs, in a clean clone of HEAD
	.ci/run
