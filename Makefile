# Each first sets up what it needs in VENV: the package, editable, with its extras.
# Where ROS 2 Jazzy is sourced they use its rclpy, elsewhere the wheels from PyPI.

VENV        ?= .venv
PYTHONS     ?= python3.12 python3.13 python3.11 python3.10 python3.14 python3
DURATION    ?= 20
MINUTES     ?= 10
QUICK       ?=
BAG         ?=
CONSTRAINTS ?=
DATA        ?=
NODES       := test/system test/launch  # tests of nodes

comma   := ,
ROS     := $(or $(ROS_DISTRO),pypi)
EXTRAS  := bags,fast,plot,parallel,cluster,i2c,serial,calibration,test,lint$(if $(ROS_DISTRO),,$(comma)jazzy)
CREATED := $(VENV)/.created-for-$(ROS)
READY   := $(VENV)/.ready-for-$(ROS)
PEERS   := $(VENV)/.ready-for-bench
RUN     := $(VENV)/bin/python
SHARE   := $(VENV)/share
INDEX   := $(SHARE)/ament_index/resource_index/packages
NAMES    = $(shell sed -n 's/.*"\([a-z_]*\) = stateful_ahrs\..*/\1/p' setup.py)

# `ros2 run` and `ros2 launch` look in a prefix; an editable install leaves these places empty,
# so $(READY) links them.
export BAG
export AMENT_PREFIX_PATH := $(abspath $(VENV))$(addprefix :,$(AMENT_PREFIX_PATH))

.PHONY: setup demo test test-nodes test-others test-ubuntu lint bench accuracy reproduce clean

setup: $(READY)

demo: $(READY)
	@$(RUN) -m stateful_ahrs.nodes.demo --duration $(DURATION) $(if $(BAG),--bag "$$BAG")

# Both at once: nodes wait most of their time. What the others say comes when they are through.
test: $(READY)
	@$(MAKE) --no-print-directory -j2 test-nodes test-others

test-nodes: $(READY)
	@$(RUN) -m pytest $(NODES)

test-others: $(READY)
	@nice -n 19 $(RUN) -m pytest $(NODES:%=--ignore=%) > $(VENV)/test.log 2>&1; \
	code=$$?; echo; cat $(VENV)/test.log; exit $$code

# The same tests with the libraries that Ubuntu 24.04, Jazzy's platform, ships.
test-ubuntu:
	@$(MAKE) test VENV=.venv-ubuntu CONSTRAINTS=test/constraints-ubuntu-24.04.txt \
	    PYTHONS='python3.12 python3.11 python3.10 python3'

# What everything costs, in nineteen minutes; QUICK=1: in five. On a machine that does nothing else.
bench: $(PEERS)
	@$(RUN) -m bench --json bench.json --minutes $(MINUTES) $(if $(QUICK),--quick)

# The tables of docs/accuracy.md, in a quarter of an hour; DATA is the folder of BROAD's .mat files.
accuracy: $(PEERS)
	@$(RUN) -m bench.accuracy "$(DATA)" --page

lint: $(READY)
	@$(RUN) -m ruff check
	@$(RUN) -m ruff format --check
	@$(RUN) -m mypy

# docs/reproduction.md: the papers' figures and tables; DATA is the folder of BROAD's .mat files.
reproduce: $(READY)
	@$(RUN) -m stateful_ahrs.evaluation.reproduction --data "$(DATA)"

clean:
	rm -rf .venv .venv-ubuntu build install log *.egg-info
	rm -rf .mypy_cache .pytest_cache .ruff_cache .hypothesis

define FITS
import sys
if sys.version_info < (3, 10):
    sys.exit("Python %d.%d is too old" % sys.version_info[:2])
try:
    import ensurepip, venv$(if $(ROS_DISTRO),$(comma) rclpy)
except ImportError as error:
    sys.exit(str(error))
endef
export FITS

$(CREATED):
ifneq ($(filter-out pypi jazzy,$(ROS)),)
	@echo "ROS_DISTRO is $(ROS), but stateful_ahrs is made for jazzy." \
	    "Source Jazzy, or run make in a shell without ROS to use the wheels from PyPI." >&2; exit 1
endif
ifeq ($(ROS),pypi)
	@[ "$$(uname -sm)" = "Linux x86_64" ] || { echo "ROS 2 is on PyPI for Linux on x86_64 only," \
	    "this is $$(uname -sm). Install ROS 2 Jazzy and source its setup.bash." >&2; exit 1; }
endif
	@for python in $(or $(PYTHON),$(PYTHONS)); do \
	    if found=$$($$python -c "$$FITS" 2>&1); then \
	        echo "Setting up $(VENV) with $$($$python --version), once: about a minute."; \
	        $$python -m venv --clear $(if $(ROS_DISTRO),--system-site-packages) $(VENV) && \
	            touch $@; exit; \
	    fi; \
	    tried="$$tried  $$python: $$(echo "$$found" | head -n 1)\n"; \
	done; \
	printf "%b" "No usable Python. Needed: 3.10 or newer, with venv (Debian, Ubuntu: apt install" \
	    " python3-venv)$(if $(ROS_DISTRO), and the rclpy of the sourced ROS 2 Jazzy)." \
	    " Name another with make PYTHON=... Tried:\n$$tried" >&2; exit 1

$(READY): $(CREATED) setup.py Makefile $(CONSTRAINTS)
	@$(RUN) -m pip install -qq --disable-pip-version-check -e '.[$(EXTRAS)]' $(CONSTRAINTS:%=-c %)
	@rm -rf $(SHARE)/stateful_ahrs  # real folders: `ros2 launch` looks into no linked one
	@mkdir -p $(VENV)/lib/stateful_ahrs $(SHARE)/stateful_ahrs/launch $(SHARE)/stateful_ahrs/config $(INDEX)
	@ln -sf $(NAMES:%=../../bin/%) $(VENV)/lib/stateful_ahrs
	@ln -sf '$(CURDIR)/package.xml' $(SHARE)/stateful_ahrs
	@ln -sf '$(CURDIR)'/launch/* $(SHARE)/stateful_ahrs/launch
	@ln -sf '$(CURDIR)'/config/* $(SHARE)/stateful_ahrs/config
	@ln -sf '$(CURDIR)/resource/stateful_ahrs' $(INDEX)
	@touch $@

$(PEERS): $(READY)
	@$(RUN) -m pip install -qq --disable-pip-version-check -e '.[bench]' $(CONSTRAINTS:%=-c %)
	@touch $@
