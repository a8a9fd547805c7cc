# Two commands on a fresh machine: `make demo` and `make test`. Needs Python >= 3.10 with venv, nothing else.
# With ROS 2 Jazzy or Kilted sourced it is used; without, the wheels of one from PyPI are: Jazzy's in .venv, with
# ROS=kilted Kilted's in .venv-kilted.
SHELL := bash
.SHELLFLAGS := -eo pipefail -c
.ONESHELL:
.DEFAULT_GOAL := help
# of Debian and Ubuntu, for export-test
TOOLCHAINS := gcc clang gcc-arm-none-eabi libnewlib-arm-none-eabi gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user qemu-system-arm cppcheck
.PHONY: help demo paper test test-paper test-realtime export-test mutants soak bench docs lint build clean distclean

PYTHON ?= python3
ARGS ?=
BENCHES := step simulate batch ros_latency axes start_up robustness identify path wiring reference commission
MIN_TESTS := 6009# `make test` fails when fewer are collected, without test/ros; when there are more it says what to write here

ifneq ($(words x$(CURDIR)x)$(findstring :,$(CURDIR)),1)
$(error the path of this folder has a blank or a colon, and the set-up scripts of colcon take none: move it out of '$(CURDIR)')
endif

SOURCED := $(if $(AMENT_PREFIX_PATH),$(ROS_DISTRO))
ROS := $(or $(ROS),$(SOURCED),jazzy)
ifeq ($(filter jazzy kilted,$(ROS)),)
$(error this package is for ROS 2 Jazzy and Kilted, not for '$(ROS)': source one of these, or use a shell without ROS)
endif
ifneq ($(filter-out $(ROS),$(SOURCED)),)
$(error ROS 2 '$(SOURCED)' is sourced and '$(ROS)' asked for: leave ROS=$(ROS) out, or use a shell without ROS)
endif
WHEELS := $(if $(SOURCED),,$(ROS))
KIND := $(if $(WHEELS),wheels,sourced)
VENV := .venv$(patsubst %,-%,$(filter-out jazzy,$(ROS)))
PY := $(VENV)/bin/python

# Nothing started here meets another robot's ROS graph; `make demo ROS_DOMAIN_ID=7` chooses the domain.
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
export ROS_DOMAIN_ID := $(shell echo $$((RANDOM % 100 + 1)))
unexport ROS_LOCALHOST_ONLY ROS_STATIC_PEERS ROS_DISCOVERY_SERVER _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport PYTHONDONTWRITEBYTECODE # every process would compile rclpy and NumPy anew, which takes seconds
unexport PYTHONUNBUFFERED # users have it buffered: a full disk behind the output is another error then

help: ## print this list
	@sed -nE 's/^([a-z-]+):.*## (.*)/  make \1\t\2/p' Makefile | expand -t 20

demo: build ## run the nested controller against the plant on a live ROS graph (ARGS='--duration 4')
	@$(ACTIVATE)
	$(VENV)/bin/nadrc demo $(ARGS)

paper: build $(VENV)/dev ## measure every claim of the paper, write the article to out/paper (ARGS='--quick')
	@$(ACTIVATE)
	python -m paper $(ARGS)

test: build $(VENV)/dev ## run all tests but the two kinds below (ARGS='-k observer' selects, ROS=kilted on Kilted)
	@$(ACTIVATE)
	[ -z '$(ARGS)' ] || exec python -m pytest $(ARGS)
	python -m pytest -rs -n 3 --dist worksteal test --ignore=test/ros --junitxml=build/tests.xml
	n=$$(sed -nE '0,/ tests="/s/.* tests="([0-9]+)".*/\1/p' build/tests.xml)
	[ "$${n:-0}" -ge $(MIN_TESTS) ] || $(call fail,$$n tests were collected; at least $(MIN_TESTS) must be)
	[ "$$n" -le $(MIN_TESTS) ] || echo "make: there are $$n tests by now: let the Makefile say MIN_TESTS := $$n"
	# on their own, as they use clocks; they wait most of the time; a test whose process died is run
	# once more (not one that failed), and what ended the process is printed
	python -m pytest -n 4 --dist worksteal --reruns 1 --only-rerun 'crashed while running' \
		-m 'not realtime' test/ros examples

test-paper: build $(VENV)/dev ## run the tests of the reproduction of the paper
	@$(ACTIVATE)
	python -m pytest -n 2 --dist loadfile paper/test $(ARGS)

export-test: build $(VENV)/dev ## exported C with other compilers, on aarch64 and a Cortex-M4 of qemu, by MISRA's rules (as root it installs these)
	@$(ACTIVATE)
	[ "$$(id -u)" != 0 ] || apt-get install -y --no-install-recommends $(TOOLCHAINS) > build/apt.log 2>&1 \
		|| echo 'make: apt-get could not install all of that, see build/apt.log'
	python test/export_machines.py

test-realtime: build $(VENV)/dev ## run the tests that only a machine can pass that keeps time: let nothing else run
	@$(ACTIVATE)
	python -m pytest -m realtime --basetemp=build/realtime test/ros $(ARGS) \
		|| $(call fail,what was recorded is in build/realtime)

mutants: build $(VENV)/dev $(VENV)/mutants ## change the code at 300 random places: do the tests notice? (N=30 SEED=7 ARGS=theory)
	@$(ACTIVATE)
	python -m bench.mutants $(or $(N),300) $(or $(SEED),1) $(ARGS)

soak: build $(VENV)/dev ## let random faults happen for 20 minutes (SEED=7 repeats those of that run)
	@$(ACTIVATE)
	seed=$(or $(SEED),$$RANDOM)
	echo "make: these are the faults of: make soak SEED=$$seed"
	python -m pytest -s --soak --seed $$seed test/ros/test_graph_soak.py
	python -m pytest -s --soak --seed $$seed -k 'any_moment or cut_network or from_nothing' \
		test/ros/test_commission_command.py test/ros/test_commission_network.py test/ros/test_mujoco.py
	python -m pytest -n 2 --dist worksteal --hypothesis-profile=soak --hypothesis-seed=$$seed --soak \
		--seed $$seed -k 'p01 or p02 or p03 or p20' test/test_law.py test/test_controller.py test/test_soak.py

bench: build $(VENV)/bench ## compare with other controllers, write out/bench (ARGS=robustness selects)
	@$(ACTIVATE)
	for part in $(or $(ARGS),$(BENCHES)); do python -m bench.$$part; done

docs: $(VENV)/docs ## build the documentation as a site in out/docs/html
	@source $(VENV)/bin/activate
	sphinx-build -q -W -n -c docs -d out/docs/doctrees . out/docs/html
	python docs/check.py out/docs/html
	echo 'open out/docs/html/index.html'

lint: $(VENV)/lint ## check style and types
	@source $(VENV)/bin/activate
	set -x
	ruff check .
	ruff format --check .
	mypy --strict nadrc_ros paper test examples
	python -m ament_flake8.main --config setup.cfg nadrc_ros paper test examples setup.py
	python -m ament_pep257.main nadrc_ros
	$(foreach each,$(INTERPRETERS),$(each) test/interpreters.py;)

clean: ## remove what was built (.venv stays; `make distclean` removes that too)
	@rm -rf build install log $(VENV)/bin/nadrc .pytest_cache .mypy_cache .ruff_cache .hypothesis *.egg-info
	find nadrc_ros test -name __pycache__ -prune -exec rm -rf {} +

distclean: clean
	@rm -rf $(VENV) .venv .venv-kilted

# ---- from here on: how the above is made ready ---------------------------------------------------------

# Each Python that is supported, where there is one.
INTERPRETERS := $(foreach version,3.10 3.11 3.12 3.13,$(firstword $(wildcard \
	$(HOME)/.pyenv/versions/$(version).*/bin/python /usr/local/bin/python$(version) /usr/bin/python$(version))))

fail = { echo "make: $(1)" >&2; exit 1; }

define ACTIVATE
source $(VENV)/bin/activate
$(if $(WHEELS),export AMENT_PREFIX_PATH=$$VIRTUAL_ENV)
source install/local_setup.bash
endef

# The build is repeated when a file changed, and when one came or went or the environment is another: their names are in the stamp's name.
FILES := $(sort $(shell find $(wildcard nadrc_ros config resource) -type f -not -path '*/__pycache__/*'))
BUILT := install/.built-$(firstword $(shell echo $(VENV) $(FILES) | cksum))
build: $(BUILT)

$(BUILT): $(FILES) setup.py setup.cfg package.xml $(VENV)/on-$(KIND) | $(VENV)/run
	@source $(VENV)/bin/activate
	rm -rf build install # of a file that went, or became a folder, colcon leaves the old one
	python -c 'import sys; from colcon_core.command import main; sys.exit(main())' --log-base log \
		build --paths . --event-handlers desktop_notification- status- summary- console_start_end- \
		|| $(call fail,colcon could not build the package; its log is in log/latest_build)
	printf '%s\n' '#!/usr/bin/env bash' '# nadrc of this workspace, whatever is sourced; written by make' \
		'source $(CURDIR)/$(VENV)/bin/activate' $(if $(WHEELS),'export AMENT_PREFIX_PATH=$$VIRTUAL_ENV') \
		'source $(CURDIR)/install/local_setup.bash' \
		'NADRC=$$0 exec $(CURDIR)/install/nadrc_ros/lib/nadrc_ros/nadrc "$$@"' > $(VENV)/bin/nadrc
	chmod +x $(VENV)/bin/nadrc
	touch $@

# $(VENV)/run holds what the package needs, dev also what its tests need, lint what checks it, bench its rivals, docs Sphinx.
$(VENV)/run: GROUPS := report $(WHEELS)
$(VENV)/dev: GROUPS := test speed
$(VENV)/lint: GROUPS := lint
$(VENV)/lint: $(VENV)/dev
$(VENV)/bench: GROUPS := bench speed
$(VENV)/mutants: GROUPS := mutants
$(VENV)/docs: GROUPS := docs
$(VENV)/dev $(VENV)/bench $(VENV)/mutants $(VENV)/docs: $(VENV)/run
TOOLS := 'setuptools<80' colcon-common-extensions colcon-ros

$(VENV)/run $(VENV)/dev $(VENV)/lint $(VENV)/bench $(VENV)/mutants $(VENV)/docs: setup.py Makefile | $(VENV)/on-$(KIND)
	@install() {
		echo "make: installing $$1 ..."
		shift
		$(PY) -m pip install --no-compile --no-input --disable-pip-version-check "$$@" > $(VENV)/pip.log 2>&1 && return
		tail -n 4 $(VENV)/pip.log >&2
		$(call fail,pip could not install all of: $$(cat $(VENV)/wanted.txt | tr '\n' ' ')(see $(VENV)/pip.log))
	}
	printf '%s\n' $(TOOLS) > $(VENV)/wanted.txt
	[ $(@F) != run ] || install 'the build tools' -r $(VENV)/wanted.txt
	$(PY) - $(GROUPS) > $(VENV)/wanted.txt <<-'EOF'
		import sys, setuptools, distutils.core
		about = distutils.core.run_setup('setup.py', stop_after='init')
		print(*about.install_requires, *sum((about.extras_require[g] for g in sys.argv[1:]), []), sep='\n')
	EOF
	install 'what setup.py asks for$(if $(GROUPS), (with: $(GROUPS)))' -r $(VENV)/wanted.txt
	touch $@

$(VENV)/on-$(KIND): # an environment of the other kind is replaced
	@command -v $(PYTHON) > /dev/null || $(call fail,there is no '$(PYTHON)'; install Python 3.10 or later or name it: make PYTHON=...)
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
		|| $(call fail,$$($(PYTHON) -V) is too old: Python 3.10 or later is needed; name one: make PYTHON=python3.12)
	$(PYTHON) -c 'import venv, ensurepip' 2> /dev/null \
		|| $(call fail,this Python has no venv module; on Debian and Ubuntu: sudo apt install python3-venv)
	[ -z '$(WHEELS)' ] || [ "$$(uname -sm)" = 'Linux x86_64' ] \
		|| $(call fail,ROS 2 wheels exist for Linux on x86-64 only and this is $$(uname -sm): install ROS 2 and source it first)
	grep -qs 'system-site-packages = $(if $(WHEELS),false,true)' $(VENV)/pyvenv.cfg \
		&& $(PY) -m pip --version > /dev/null 2>&1 \
		|| $(PYTHON) -m venv --clear $(if $(WHEELS),,--system-site-packages) $(VENV) \
		|| $(call fail,'$(PYTHON) -m venv $(VENV)' failed)
	rm -rf build install $(VENV)/on-* $(addprefix $(VENV)/,run dev lint bench mutants docs)
	touch $@
