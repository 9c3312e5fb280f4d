# `make demo` and `make test` set up everything they need in .venv; see CONTRIBUTING.md for the rest.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := demo
.PHONY: env prerequisites demo quick test evidence nightly mutants short-test without-ros sanitize lint build docs figures lock aarch64 release-check version clean

PYTHON ?= python3
VENV ?= .venv
BIN := $(CURDIR)/$(VENV)/bin

# Whatever ROS or Python environment the caller has active shall not leak into ours. Without its
# bytecode, every process of ours would start half as fast.
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH \
	PYTHONDONTWRITEBYTECODE PYTHONHOME PYTHONPATH ROS_DISTRO VIRTUAL_ENV _ROS_WHEELS_BOOTSTRAP_COMPLETE

prerequisites:
	@$(PYTHON) -c 'import ensurepip, sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo 'Python 3.11 or newer with venv is needed (Debian: python3-venv); name it by PYTHON=' >&2; exit 1; }
	@echo '#include <Python.h>' | c++ -fsyntax-only -x c++ -I $$($(PYTHON) -c '$(PYTHON_HEADERS)') - \
		|| { echo 'a C++ compiler and the headers of Python are needed (Debian: g++ python3-dev)' >&2; exit 1; }

PYTHON_HEADERS := import sysconfig; print(sysconfig.get_path("include"))

# By uv, which needs a fraction of the time; by pip where uv, or its way to the index, cannot be had.
WITH_PIP := $(BIN)/python -m pip install --disable-pip-version-check --quiet --constraint constraints.txt
INSTALL := $$([ -x $(BIN)/uv ] && echo $(BIN)/uv pip install --quiet --python $(BIN)/python \
	--constraint constraints.txt || echo $(WITH_PIP))

# What core and messages are built with, and what the package and some of its extras need.
BUILD_REQUIRES := import sys, tomllib; \
	print(*tomllib.load(open(sys.argv[1], "rb"))["build-system"]["requires"], sep="\n")
REQUIRES := import sys, setuptools; from distutils.core import run_setup; \
	package = run_setup("setup.py", stop_after="init"); \
	print(*package.install_requires, *sum(map(package.extras_require.get, sys.argv[1:]), []), sep="\n")

# Contents decide what is made anew, not the times of files, which a checkout changes. Where one of
# these files is another, the requirements in it are looked at; another setup.py is installed again.
MESSAGES := $$(find msg_defs -type f | sort)
PYTHON_USED := $(shell $(PYTHON) -VV)
MADE_OF = { echo '$(PYTHON_USED)'; $(BIN)/python -c '$(BUILD_REQUIRES)' pyproject.toml; \
	$(BIN)/python -c '$(REQUIRES)' ros; cat constraints.txt $(MESSAGES); }
digest = $(shell echo '$(PYTHON_USED)' | cat - $(1) | sha256sum | head --bytes 16)
INSTALLED_FROM := setup.py package.xml benchmark/pyproject.toml
INSTALLED := $(VENV)/installed_$(call digest,$(INSTALLED_FROM))
LOOKED_AT := $(VENV)/looked_at_$(call digest,$(INSTALLED_FROM) pyproject.toml constraints.txt $(MESSAGES))

env: $(INSTALLED) $(VENV)/core

$(LOOKED_AT):
	@[ ! -f $(VENV)/complete ] || $(MADE_OF) > $(VENV)/made_of.new
	@mkdir -p $(VENV); cd $(VENV); touch -a made_of made_of.new; rm -f looked_at_*; \
		cmp --silent made_of.new made_of || mv made_of.new made_of; touch --reference=made_of $(@F)

$(VENV)/made_of: $(LOOKED_AT) ;

# Made anew from nothing, and marked complete as the last step: an interrupted run leaves no mark.
# The core is compiled while packages are downloaded; the last installation finds it in place. Boost
# comes with Pinocchio: nothing here is compiled with its 185 MB of headers.
$(VENV)/complete: $(VENV)/made_of
	@$(MAKE) --no-print-directory prerequisites
	@echo 'Setting up $(VENV) with ROS 2, Pinocchio and the compiled core: usually 1 to 3 minutes.'
	@rm -rf $(VENV) ff_planner_ros.egg-info
	@$(PYTHON) -m venv $(VENV)
	@touch $(VENV)/COLCON_IGNORE
	@$(BIN)/python -c '$(BUILD_REQUIRES)' pyproject.toml > $(VENV)/core_requires.txt
	@{ $(WITH_PIP) uv && $(INSTALL) --requirement $(VENV)/core_requires.txt; } \
		|| { echo 'uv cannot install here; pip does, which takes some minutes more.'; \
			rm -f $(BIN)/uv; $(WITH_PIP) --upgrade pip; \
			$(INSTALL) --requirement $(VENV)/core_requires.txt; }
	@$(BIN)/python -c '$(REQUIRES)' ros > $(VENV)/requires.txt
	@$(BIN)/python setup.py --quiet build_ext --inplace & core=$$!; \
		$(INSTALL) --build-constraint constraints.txt ./msg_defs --requirement $(VENV)/requires.txt; \
		wait $$core
	@rm -rf $(VENV)/lib/python*/site-packages/cmeel.prefix/include/boost
	@$(MADE_OF) > $(VENV)/made_of
	@touch --reference=$(VENV)/made_of $(LOOKED_AT); touch $(VENV)/core $@

$(INSTALLED): $(VENV)/complete
	@$(INSTALL) --no-build-isolation --no-deps --editable .
	@rm -f $(VENV)/installed_*; touch $@

# A change of the core's sources builds it anew in its place.
CORE := $(shell find ff_planner_ros/core -name '*.[ch]pp')

$(VENV)/core: $(CORE) | $(VENV)/complete
	@echo 'Compiling the core: usually 1 to 2 minutes.'
	@$(BIN)/python setup.py --quiet build_ext --inplace
	@touch $@

# What the tests need beside that, every day and in the longer tiers, and what colcon builds with.
EXTRAS_everyday := test
EXTRAS_ci := test robots browser ccsds
EXTRAS_nightly := $(EXTRAS_ci)
# Experiments, a distribution of its own for those who want it.
BENCHMARK_everyday := ./benchmark
BENCHMARK_ci := ./benchmark[ompl,drake]
BENCHMARK_nightly := $(BENCHMARK_ci)

$(VENV)/extras_%: $(INSTALLED)
	@echo 'Adding what the tests need to $(VENV): usually half a minute.'
	@$(BIN)/python -c '$(REQUIRES)' $(EXTRAS_$*) > $@.txt
	@$(INSTALL) --no-build-isolation --requirement $@.txt --editable '$(BENCHMARK_$*)'
	@touch $@

$(VENV)/docs: $(INSTALLED)
	@$(BIN)/python -c '$(REQUIRES)' docs > $@.txt
	@$(INSTALL) --requirement $@.txt
	@touch $@

$(VENV)/colcon: $(INSTALLED)
	@$(BIN)/python -c '$(REQUIRES)' colcon > $@.txt
	@$(BIN)/python -c '$(BUILD_REQUIRES)' msg_defs/pyproject.toml >> $@.txt
	@$(INSTALL) --requirement $@.txt
	@touch $@

demo: env
	$(BIN)/ff-planner demo

# The tests that a change needs, cut after half a minute: of MODULES, or of what differs from main.
quick: BEGUN := $(shell date +%s)
quick: env $(VENV)/extras_everyday
	@$(BIN)/python tools/quick.py --begun $(BEGUN) $(MODULES)

# The tests of a tier: `everyday`; `ci`, with coverage and with what the benchmark and the robots of
# others need; `nightly`. One worker more than the two cores it is measured on: flights in real time
# mostly wait.
TIER ?= everyday
WORKERS ?= 3
COVERAGE_ci := --cov --cov-report=term

test: env $(VENV)/extras_$(TIER)
	$(BIN)/python -m pytest --numprocesses $(WORKERS) --tier $(TIER) $(COVERAGE_$(TIER)) --junitxml build/tests_$(TIER).xml

# Runs the tests that provoke a law (test/laws.yaml), and writes their results into
# docs/reference/evidence.md. Of a run of all tests it is `tools/evidence.py ci build/tests_ci.xml`.
evidence: TIER := ci
evidence: env $(VENV)/extras_ci
	rm -f build/evidence.xml
	$(BIN)/python -m pytest --numprocesses $(WORKERS) --tier $(TIER) -m law --junitxml build/evidence.xml || true
	$(BIN)/python tools/evidence.py $(TIER) build/evidence.xml

# Jazzy's own Python, where the machine has it: the other steps run on the machine's default.
PYTHON_OF_JAZZY = $(firstword $(shell for python in python3.12 ~/.pyenv/versions/3.12.*/bin/python3.12; do \
	$$python -c 'import ensurepip' 2> /dev/null && echo $$python; done))

# Every step runs, whatever became of those before it.
nightly:
	@failed=; run() { $(MAKE) "$$@" || failed="$$failed, make $$*"; }; \
	run test TIER=nightly; \
	run sanitize SANITIZED_TESTS=core; \
	run mutants FAULTS=--today; \
	$(if $(PYTHON_OF_JAZZY),run short-test PYTHON=$(PYTHON_OF_JAZZY) VENV=.venv_python3.12, \
		echo 'There is no Python 3.12 with venv here: nothing was run on it.'); \
	[ -z "$$failed" ] || { echo "failed:$${failed#,}" >&2; exit 1; }

# Faults that a reviewer would call real, put into the code one at a time: do the tests notice?
# `make mutants FAULTS=AREA` tries some, `FAULTS=--today` a seventh of all: another one each night.
FAULTS ?=
mutants: env $(VENV)/extras_everyday
	$(BIN)/python tools/faults.py $(FAULTS)

# A part of the tests in a minute: one plan after the other, a recorded bag, one node. For
# another Python: `make short-test PYTHON=python3.12 VENV=.venv_python3.12`.
short-test: env $(VENV)/extras_everyday
	$(BIN)/python -m pytest --numprocesses 2 $(addprefix test/test_,$(addsuffix .py,$(SHORT_TEST)))

SHORT_TEST := bag_golden cli dynamics golden_replay node package planner polynomial scenario \
	velocity_map verification

# What the package does where no ROS is installed: the commands that a user would try first, on an
# installation of the base package alone. `verify` and `campaign` must say what they lack, and
# `verify` run with it. Then the experiments, of their wheel.
WITHOUT_ROS := $(CURDIR)/.venv_without_ros
CAPTURE := $(CURDIR)/config/scenarios/lemur_capture.yaml
STUDY := $(CURDIR)/config/studies/lemur_masses.yaml

without-ros:
	rm -rf $(WITHOUT_ROS)
	$(PYTHON) -m venv $(WITHOUT_ROS)
	touch $(WITHOUT_ROS)/COLCON_IGNORE
	$(WITHOUT_ROS)/bin/python -m pip wheel --disable-pip-version-check --quiet --no-deps --wheel-dir $(WITHOUT_ROS) .
	$(WITHOUT_ROS)/bin/python -m pip install --disable-pip-version-check --quiet --constraint constraints.txt $(WITHOUT_ROS)/*.whl
	! $(WITHOUT_ROS)/bin/python -m pip list | grep --ignore-case 'ros-\|rclpy\|_msgs\|mujoco'
	mkdir $(WITHOUT_ROS)/run
	cd $(WITHOUT_ROS)/run; PATH=$(WITHOUT_ROS)/bin:$$PATH; \
	ff-planner plan $(CAPTURE) --json answer.json; \
	ff-planner robot $(CURDIR)/config/robots/lemur/lemur.urdf; \
	ff-planner report answer.json; \
	ff-planner compare $(CAPTURE); \
	python $(CURDIR)/examples/plan_in_python.py; \
	said=$$(ff-planner verify answer.json 2>&1) && exit 1; grep 'ff_planner_ros\[simulation\]' <<< "$$said"; \
	said=$$(ff-planner campaign $(STUDY) --out tables 2>&1) && exit 1; \
	grep 'ff_planner_ros\[campaign\]' <<< "$$said"; \
	python -m pip install --disable-pip-version-check --quiet --constraint $(CURDIR)/constraints.txt \
		'ff_planner_ros[simulation]'; \
	ff-planner verify answer.json; \
	python -m pip install --disable-pip-version-check --quiet --constraint $(CURDIR)/constraints.txt $(CURDIR)/benchmark; \
	ff-planner-benchmark dataset data_set --scenarios 1; \
	ff-planner-benchmark contest data_set --scenarios 1 --method ours; \
	ff-planner-benchmark bench --quick --scenarios 1
	rm -rf $(WITHOUT_ROS)

# The core's tests on a build that stops at every access out of bounds and all undefined behaviour:
# of the chains of 1 to 14 joints and of the scales of numbers a part, all of them at night.
SANITIZED := $(CURDIR)/build/sanitized
SANITIZED_TESTS ?= not (free2 or free3 or free4 or free5 or free8 or free9 or free10 or free11 \
	or free12 or free13 or planar2 or planar7 or 1e+30 or 1e+160 or 1e+308 \
	or (1e+200 and certified))

sanitize: env $(VENV)/extras_everyday
	$(BIN)/python setup.py --quiet build_py --build-lib $(SANITIZED) \
		build_ext --sanitize --build-lib $(SANITIZED) --build-temp build/sanitized_objects \
		install_data --install-dir $(SANITIZED)
	export LD_PRELOAD="$$(c++ -print-file-name=libasan.so) $$(c++ -print-file-name=libstdc++.so)" \
		ASAN_OPTIONS=detect_leaks=0 PYTHONPATH=$(SANITIZED) AMENT_PREFIX_PATH=$(SANITIZED); \
	$(BIN)/python -P -c '$(IS_SANITIZED)'; \
	$(BIN)/python -P -m pytest -p no:cacheprovider -k '$(SANITIZED_TESTS)' $(wildcard test/test_core*.py)

# Without -P this directory comes first, and with it the core that nothing watches.
IS_SANITIZED := from ff_planner_ros.core import compiled; \
	assert compiled.__file__.startswith("$(SANITIZED)"), compiled.__file__

lint: env $(VENV)/extras_everyday
	$(BIN)/ruff format --check
	$(BIN)/clang-format --dry-run --Werror $(CORE)
	$(BIN)/ruff check
	$(BIN)/mypy

# What a ROS machine does with `colcon build`, here with the ROS that pip installed. Then the
# installed messages must load, and the installed node must start and find its configuration:
# so far it has come when it refuses a robot that does not exist.
build: env $(VENV)/colcon
	PATH=$(BIN):$$PATH colcon build --cmake-args -DBUILD_TESTING=OFF \
		-DCMAKE_PROJECT_INCLUDE=$(CURDIR)/msg_defs/ros_wheels.cmake -DPython3_EXECUTABLE=$(BIN)/python
	set +u; source install/setup.sh; cd install; \
	$(BIN)/python -c '$(MESSAGES_LOAD)'; \
	said=$$(ff_planner_ros/lib/ff_planner_ros/planner_node --ros-args -p robot.urdf:=none.urdf 2>&1) || true; \
	echo "$$said"; grep --quiet 'robot.urdf is none.urdf' <<< "$$said"

MESSAGES_LOAD := import os, ff_planner_msgs.srv as srv; \
	from rclpy.type_support import check_for_type_support; \
	check_for_type_support(srv.PlanTrajectory); \
	assert srv.__file__.startswith(os.getcwd()), srv.__file__; \
	from ff_planner_ros.ros.messages.foreign import FollowJointTrajectory, TFMessage; \
	check_for_type_support(TFMessage); check_for_type_support(FollowJointTrajectory)

# The site, of the pages in docs/, without the network; a warning or a link that leads nowhere fails.
# With DOCS_ONLINE=1, names of Python and numpy lead to their own sites.
docs: env $(VENV)/docs
	$(BIN)/python -m sphinx --builder html --fail-on-warning --keep-going --quiet --jobs auto docs build/site
	@echo 'build/site/index.html is the site.'

# Measures the benchmark anew, and writes its tables and the sentences with its figures. It takes
# 40 minutes, on a machine that does nothing else.
figures: env $(VENV)/extras_everyday
	$(BIN)/ff-planner-benchmark bench --json docs/benchmark.json
	@$(MAKE) --no-print-directory installation-figures

# Those of a default installation alone, in two minutes: the command, and the service of a node.
installation-figures: env $(VENV)/extras_everyday
	PYTHONPATH=test $(BIN)/python tools/installation_figures.py
	$(BIN)/python tools/doc_tables.py

# Remakes constraints.txt with the newest versions that setup.py and all pyproject.toml allow, also
# for the first Python that is supported. None of our own is a package of an index.
lock: env
	{ $(BIN)/python -c '$(REQUIRES)' ros test robots browser ccsds docs colcon; printf 'pip\nuv\n'; \
		$(BIN)/python -c '$(REQUIRES_OF_BENCHMARK)'; \
		for built in . msg_defs benchmark; do \
			$(BIN)/python -c '$(BUILD_REQUIRES)' $$built/pyproject.toml; done; } | grep -v ^ff_planner_ \
		| $(BIN)/uv pip compile --quiet --no-header --no-annotate --upgrade --python-version 3.11 \
			--output-file constraints.txt -

REQUIRES_OF_BENCHMARK := import tomllib; \
	project = tomllib.load(open("benchmark/pyproject.toml", "rb"))["project"]; \
	print(*project["dependencies"], *sum(project["optional-dependencies"].values(), []), sep="\n")

# The core for aarch64 under an emulator: its tests, and its numbers beside this machine's.
aarch64: env
	tools/aarch64/run.sh

# Before a release: sdists and wheels, each tried in an environment of its own, metadata, colcon,
# licences. `make release-check PYTHONS="python3.11 python3.12"` tries the wheel on each, with RELEASED
# as the extras: ROS has no wheels for some interpreters.
PYTHONS ?= $(BIN)/python
RELEASED ?= simulation,campaign,console,ros

release-check: env $(VENV)/extras_everyday $(VENV)/colcon
	$(BIN)/python tools/release_check.py $(addprefix --python=,$(PYTHONS)) --extras=$(RELEASED)

# The version is that of package.xml; `make version VERSION=1.2.3` writes it to the other places that tools
# read, with today as the day of the release. The heading in CHANGELOG.md is written by hand.
VERSION ?= $(shell sed -n 's|.*<version>\(.*\)</version>.*|\1|p' package.xml)

version:
	sed -i 's|<version>.*</version>|<version>$(VERSION)</version>|' package.xml msg_defs/package.xml
	sed -i 's/^version = .*/version = "$(VERSION)"/; s/ff_planner_ros==[0-9.]*/ff_planner_ros==$(VERSION)/' \
		benchmark/pyproject.toml
	sed -i "s/^version: .*/version: $(VERSION)/; s/^date-released: .*/date-released: $$(date --iso-8601)/" CITATION.cff

clean:
	rm -rf .venv .venv_* build dist benchmark/build install log ff_planner_ros/core/*.so .coverage* .mypy_cache .pytest_cache .ruff_cache
