# `make demo` and `make test` set up everything they need in .venv; see CONTRIBUTING.md for the rest.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := demo
.PHONY: env prerequisites demo test nightly short-test without-ros sanitize lint build lock clean

PYTHON ?= python3
VENV ?= .venv
BIN := $(CURDIR)/$(VENV)/bin
STAMP := $(VENV)/complete

# Whatever ROS or Python environment the caller has active shall not leak into ours.
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONHOME \
	PYTHONPATH ROS_DISTRO VIRTUAL_ENV _ROS_WHEELS_BOOTSTRAP_COMPLETE

prerequisites:
	@$(PYTHON) -c 'import ensurepip, sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo 'Python 3.11 or newer with venv is needed (Debian: python3-venv); name it by PYTHON=' >&2; exit 1; }
	@echo '#include <Python.h>' | c++ -fsyntax-only -x c++ -I $$($(PYTHON) -c '$(PYTHON_HEADERS)') - \
		|| { echo 'a C++ compiler and the headers of Python are needed (Debian: g++ python3-dev)' >&2; exit 1; }

PYTHON_HEADERS := import sysconfig; print(sysconfig.get_path("include"))

env: $(STAMP) $(VENV)/core

# What messages and core need to be built, read from the lists there are.
BUILD_REQUIRES := import tomllib; \
	[print(*tomllib.load(open(file, "rb"))["build-system"]["requires"], sep="\n") \
	for file in ("msg_defs/pyproject.toml", "pyproject.toml")]

# Made anew from nothing, and marked complete as the last step: an interrupted run leaves no mark.
# What is ignored is the advice against editable installations.
INSTALL := $(BIN)/python -m pip install --disable-pip-version-check --quiet --constraint constraints.txt

$(STAMP): setup.py pyproject.toml package.xml constraints.txt $(shell find msg_defs -type f)
	@$(MAKE) --no-print-directory prerequisites
	@echo 'Setting up $(VENV); this takes a minute or two.'
	@rm -rf $(VENV)
	@$(PYTHON) -m venv $(VENV)
	@touch $(VENV)/COLCON_IGNORE
	@$(INSTALL) --upgrade pip
	@$(INSTALL) --requirement <($(BIN)/python -c '$(BUILD_REQUIRES)')
	@PYTHONWARNINGS=ignore $(INSTALL) --no-build-isolation ./msg_defs --editable '.[test,robots,benchmark]'
	@touch $(VENV)/core $@

# The editable installation has built the core; a change of its sources builds it anew in its place.
$(VENV)/core: $(wildcard ff_planner_ros/core/*.[ch]pp) | $(STAMP)
	@$(BIN)/python setup.py --quiet build_ext --inplace
	@touch $@

demo: env
	$(BIN)/ff-planner demo

# One worker more than the two cores it is measured on: flights in real time mostly wait.
test: env
	$(BIN)/python -m pytest --numprocesses 3 --cov --cov-report=term

# The same tests with every law tried more often: longer.
nightly: env
	$(BIN)/python -m pytest --numprocesses 3 --nightly
	$(MAKE) sanitize SANITIZED_TESTS=core

# A part of the tests in a minute: one plan after the other, bags of earlier versions, one node. For
# another Python: `make short-test PYTHON=python3.12 VENV=.venv_python3.12`.
short-test: env
	$(BIN)/python -m pytest --numprocesses 2 $(addprefix test/test_,$(addsuffix .py,$(SHORT_TEST)))

SHORT_TEST := bag_golden cli dynamics golden_replay node package planner polynomial scenario \
	velocity_map verification

# What the package does where no ROS is installed: the commands that a user would try first, on an
# installation of the base package alone. `verify` and `campaign` must say what they lack, and
# `verify` run with it.
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
	ff-planner bench --quick --scenarios 1; \
	python $(CURDIR)/examples/plan_in_python.py; \
	said=$$(ff-planner verify answer.json 2>&1) && exit 1; grep 'ff_planner_ros\[simulation\]' <<< "$$said"; \
	said=$$(ff-planner campaign $(STUDY) --out tables 2>&1) && exit 1; \
	grep 'ff_planner_ros\[campaign\]' <<< "$$said"; \
	python -m pip install --disable-pip-version-check --quiet --constraint $(CURDIR)/constraints.txt \
		'ff_planner_ros[simulation]'; \
	ff-planner verify answer.json
	rm -rf $(WITHOUT_ROS)

# The core's tests on a build that stops at every access out of bounds and all undefined behaviour:
# of the chains of 1 to 14 joints and of the scales of numbers a part, all of them at night.
SANITIZED := $(CURDIR)/build/sanitized
SANITIZED_TESTS ?= not (free2 or free3 or free4 or free5 or free8 or free9 or free10 or free11 \
	or free12 or free13 or planar2 or planar7 or 1e+30 or 1e+160 or 1e+308 \
	or (1e+200 and certified))

sanitize: env
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

lint: env
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy

# What a ROS machine does with `colcon build`, here with the ROS that pip installed. Then the
# installed messages must load, and the installed node must start and find its configuration:
# so far it has come when it refuses a robot that does not exist.
build: env
	PATH=$(BIN):$$PATH colcon build --cmake-args -DBUILD_TESTING=OFF \
		-DCMAKE_PROJECT_INCLUDE=$(CURDIR)/msg_defs/ros_wheels.cmake -DPython3_EXECUTABLE=$(BIN)/python
	set +u; source install/setup.sh; cd install; \
	$(BIN)/python -c '$(MESSAGES_LOAD)'; \
	said=$$(ff_planner_ros/lib/ff_planner_ros/planner_node --ros-args -p robot.urdf:=none.urdf 2>&1) || true; \
	echo "$$said"; grep --quiet 'robot.urdf is none.urdf' <<< "$$said"

MESSAGES_LOAD := import os, ff_planner_msgs.srv as srv; \
	from rclpy.type_support import check_for_type_support; \
	check_for_type_support(srv.PlanTrajectory); \
	assert srv.__file__.startswith(os.getcwd()), srv.__file__

# Remakes constraints.txt with the newest versions that setup.py and both pyproject.toml allow.
lock:
	: > constraints.txt
	$(MAKE) env
	$(BIN)/python -c '$(INSTALLED_BY_PIP)' > constraints.txt
	touch $(STAMP)

INSTALLED_BY_PIP := import importlib.metadata as metadata; \
	print(*sorted(f"{d.name}=={d.version}" for d in metadata.distributions() \
	if d.read_text("INSTALLER") and not d.read_text("direct_url.json")), sep="\n")

clean:
	rm -rf .venv .venv_* build install log ff_planner_ros/core/*.so .coverage* .mypy_cache .pytest_cache .ruff_cache
