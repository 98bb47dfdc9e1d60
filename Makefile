# Everything is set up inside the checkout, by the target that needs it.
# `make test ROS_DISTRO=kilted` runs the tests with another ROS 2 than Jazzy.

SHELL := bash
ROS_DISTRO := jazzy
PYTEST_ARGS :=
DEMO_ARGS :=

ROS := source scripts/activate.sh $(ROS_DISTRO)

.PHONY: help demo level speed paper docs test test-ros lint env clean
.NOTPARALLEL:

help:
	@echo "make demo     calibrate four real cameras, and a film, with reports and pictures (no ROS needed)"
	@echo "make level    print the accuracy on simulated scenes and real recordings"
	@echo "make speed    print CPU seconds, memory and how they grow, beside their targets"
	@echo "make paper    the paper's experiments, reduced, against the accuracy they had before"
	@echo "make docs     build the pages of docs/ into out/docs"
	@echo "make test     lint and test everything, with real ROS 2 (ROS_DISTRO=jazzy or kilted)"
	@echo "make lint     ruff and mypy"
	@echo "make env      set up ROS 2 and build the package; then 'source scripts/activate.sh' gives"
	@echo "              a shell with the commands stcalib and ros2 run"
	@echo "make clean    remove everything that the other targets made"

demo:
	@scripts/setup.sh core
	@OMP_NUM_THREADS=$${OMP_NUM_THREADS:-1} MPLCONFIGDIR=$(CURDIR)/.venv/matplotlib \
		.venv/bin/python -m stcalib_ros.demo --film examples/film $(DEMO_ARGS)

level:
	@scripts/setup.sh core
	@.venv/bin/python -m benchmarks.accuracy.level --real

speed:
	@scripts/setup.sh core
	@.venv/bin/python -m benchmarks.cost.speed

paper:
	@scripts/setup.sh core
	@.venv/bin/python -m benchmarks.paper all --reduced

docs:
	@scripts/setup.sh docs
	@NO_MKDOCS_2_WARNING=1 .venv-docs/bin/python -m mkdocs build --quiet
	@echo "out/docs/index.html"

test: lint env
	@$(ROS) && python -m pytest -n 2 --dist loadgroup $(PYTEST_ARGS)

# Only what depends on the ROS distribution.
test-ros: env
	@$(ROS) && python -m pytest test/ros test/packaging $(PYTEST_ARGS)

lint:
	@scripts/setup.sh $(ROS_DISTRO)
	@$(ROS) && ruff check . && ruff format --check . && mypy

env:
	@scripts/setup.sh $(ROS_DISTRO)
	@scripts/build.sh $(ROS_DISTRO) .ros/$(ROS_DISTRO) --symlink-install
	@echo "ready: source scripts/activate.sh $(ROS_DISTRO)  # then stcalib --help, ros2 run stcalib_ros calibrator"

clean:
	rm -rf .venv .venv-* .ros build dist out *.egg-info
	rm -rf .pytest_cache .hypothesis .mypy_cache .ruff_cache
	find . -name __pycache__ -prune -exec rm -rf {} +
