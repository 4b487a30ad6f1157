# Every target works on a fresh machine: the environment is made first, once.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready
RUN := $(BIN)/python -m
budget ?= 2h
scale ?= reduced

.PHONY: help train test test-all test-extras test-slurm lint type arch simulate diagnose trial study detectability bench results tensorboard wheel clean

help:            ## list the targets
	@grep -E '^[a-z-]+: .*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 16

# pip's own settings decide between a CPU and a CUDA build of the pinned torch.
$(READY): pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	touch $@

train: $(READY)  ## make the environment, simulate a data set, train the LSTM on the rod's sensors
	$(RUN) clearance.train model=lstm sensors=rod

simulate: $(READY)  ## simulate 1000 runs with clearance in joint C
	$(RUN) clearance.simulate runs=1000 seed=1 joint=C

diagnose: $(READY)  ## demonstrate the diagnosis on a simulated machine with friction on its guide
	$(RUN) clearance.diagnose

trial: $(READY)  ## diagnose 12 machines whose truth is sealed, then reveal and score (about 30 minutes on two cores)
	$(RUN) clearance.trial

study: $(READY)  ## the paper's tables and figures, as far as budget=2h goes: docs/results/study/SCALE/RESULTS.md; again to go on; scale=paper is unreduced: months
	$(RUN) clearance.study budget=$(budget) scale=$(scale)

test: $(READY) lint type arch  ## everything that must pass before a change lands (13 to 26 minutes on two cores)
	OMP_NUM_THREADS=1 $(RUN) pytest -n 2 --dist loadfile -m 'not slow and not gpu and not slurm'

test-all: $(READY) lint type arch  ## the long checks too
	OMP_NUM_THREADS=1 $(RUN) pytest -n 2 --dist loadfile -m 'not slurm'

test-extras: $(READY)  ## the checks beside Exudyn, pysindy and sbi, which it installs
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev,baselines,exudyn]'
	OMP_NUM_THREADS=1 $(RUN) pytest tests/test_bench.py tests/trial/test_baselines.py tests/trial/test_exudyn_plant.py

test-slurm: $(READY)  ## run a simulation and a sweep through a Slurm of one node (apt-get install slurm-wlm munge)
	OMP_NUM_THREADS=1 $(RUN) pytest -m slurm tests/slurm

lint: $(READY)   ## style, imports, docstrings
	$(BIN)/ruff check clearance hydra_plugins tests
	$(BIN)/ruff format --check clearance hydra_plugins tests
type: $(READY)   ## static types
	$(RUN) mypy
arch: $(READY)   ## layers: nothing imports upward
	$(BIN)/lint-imports --no-cache

detectability: $(READY)  ## compute again which sizes of effects sensors can show (half an hour)
	$(BIN)/python -c 'from clearance.diagnosis.judging.nominal_map import write_nominal_map; write_nominal_map()'

bench: $(READY)  ## measure the simulator, beside Exudyn where it is installed (pip install '.[exudyn]')
	$(RUN) clearance.bench

results: bench   ## measure again what README shows (hours), from trainings and the benchmark
	$(RUN) clearance.train model=lstm sensors=rod
	$(RUN) clearance.train model=tcn sensors=rod
	$(RUN) clearance.train model=random_forest sensors=rod
	$(RUN) clearance.train experiment=best model=tcn sensors=rod
	$(RUN) clearance.evaluate fresh=300 results=docs/results readme=README.md \
	  picture=outputs/train/best/model=tcn,sensors=rod

tensorboard: $(READY)  ## look at the runs
	$(BIN)/tensorboard --logdir outputs

wheel: $(READY)  ## build clearance-*.whl, configurations included
	$(BIN)/python -m pip wheel --quiet --no-deps -w dist .

clean:           ## remove the environment and caches, keep outputs
	rm -rf .venv dist .pytest_cache .mypy_cache .ruff_cache
