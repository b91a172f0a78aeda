# Everything a fresh machine needs: Python 3.11 to 3.13 and these targets. Another Python beside the default one, with an
# environment of its own: make test PYTHON=python3.13 VENV=.venv-3.13
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.installed

.PHONY: train paper test quick check docs tutorials bench fuzz trials judges models wheel clean mutants viewer
train: $(READY)
	$(BIN)/python -m spgf_torch.train +K=20

# Every rate and figure in docs/paper.md: Table 1 over five seeds, K and reach, each class by itself (half an hour on two
# cores).
paper: $(READY)
	$(BIN)/python -m spgf_torch.train -m +K=20 'seed=range(5)'
	$(BIN)/python -m spgf_torch.train +K=10 fold_models=true
	$(BIN)/python -m spgf_torch.train -m final_model=false +K=5,10,15,25 'seed=range(5)'
	$(BIN)/python -m spgf_torch.train -m final_model=false +K=1,5,10,20 affordance.reach=0.03,0.05 'seed=range(5)'
	$(BIN)/python -m spgf_torch.train -m final_model=false +K=1 'seed=range(5)'
	$(BIN)/python -m spgf_torch.train -m final_model=false +K=20 classwise=true 'seed=range(5)'
	$(BIN)/python -m spgf_torch.report

test: $(READY)
	$(BIN)/python -m pytest

# What needs no physics and no run of a command: seconds. CI calls it for another Python.
quick: $(READY)
	$(BIN)/python -m pytest tests/geometry tests/features tests/prototypes tests/test_imports.py

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

bench: $(READY)
	$(BIN)/python -m pip install --quiet --editable '.[peers]'
	for file in tests/benchmarks/*.py; do $(BIN)/python $$file || exit 1; done
	$(BIN)/python tests/benchmarks/shared/table.py

# Installed once; again only when the list of dependencies changes.
$(READY): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[dev]'  # with all extras but baselines
	touch $(READY)

# Every page of docs/tutorials, also those that train: minutes.
tutorials: $(READY)
	SPGF_TUTORIALS=all $(BIN)/python -m pytest -n 0 tests/docs

# Wheel and sdist: what they hold, and the wheel alone in a new environment (tests/packaging).
wheel: $(READY)
	$(BIN)/python tests/packaging/wheel.py

clean:
	rm -rf $(VENV)

# The committed trial table, from nothing (a quarter of an hour on two cores).
trials: $(READY)
	rm -f data/trials/SHA256SUMS
	$(BIN)/python -m spgf_torch.simulate out=data/trials

# The committed judges, each with the trials that it was learned from (half an hour on two cores); trials in data/judge, the
# judges themselves in data/models, beside the votes.
judges: $(READY)
	rm -rf data/judge
	$(BIN)/python -m spgf_torch.judge hand=panda +context=tabletop hydra.run.dir=data/judge/panda
	$(BIN)/python -m spgf_torch.judge hand=sdh2 trials=data/trials +context=tabletop hydra.run.dir=data/judge/sdh2
	for hand in panda sdh2; do cd data/judge/$$hand && mv judge.json judge.safetensors README.md ../../models/$$hand && rm -r hand && cd ../../..; done

# The shipped models: votes made small beside the committed judges (an hour or two on two cores); of hands without a judge of
# scenes, with one that train learns.
models: $(READY)
	$(BIN)/python -m spgf_torch.simulate hand=panda candidates=300 out=outputs/panda_trials
	$(BIN)/python -m spgf_torch.train +K=20 hydra.run.dir=outputs/models/sdh2
	$(BIN)/python -m spgf_torch.train +K=20 hand=panda trials=outputs/panda_trials hydra.run.dir=outputs/models/panda
	for hand in robotiq_2f so101; do $(BIN)/python -m spgf_torch.train +K=20 hand=$$hand judge=learn hydra.run.dir=outputs/models/$$hand; done
	for hand in robotiq_3f sdh2_fingers; do $(BIN)/python -m spgf_torch.train +K=20 hand=$$hand judge=learn +judging.candidates=25 hydra.run.dir=outputs/models/$$hand; done
	for hand in panda sdh2; do $(BIN)/python -m spgf_torch.pack model=outputs/models/$$hand judge=data/models/$$hand out=data/models/$$hand replace=true; done
	for hand in robotiq_2f robotiq_3f sdh2_fingers so101; do $(BIN)/python -m spgf_torch.pack model=outputs/models/$$hand out=data/models/$$hand replace=true; done

# Readers of files, with changed bytes, for so many seconds (tests/fuzz).
FUZZ_SECONDS ?= 300
fuzz: $(READY)
	$(BIN)/python -m pip install --quiet --editable '.[fuzz]'
	$(BIN)/python tests/fuzz/readers.py $(FUZZ_SECONDS)

# Places of the program, changed one at a time: do the nearest tests fail? Another SEED draws others (tests/mutants).
MUTANTS ?= 60
SEED ?= 0
mutants: $(READY)
	$(BIN)/python -m pip install --quiet --editable '.[mutants]'
	$(BIN)/python tests/mutants/run.py --count $(MUTANTS) --seed $(SEED)

# The documentation, in outputs/docs/index.html: no network is needed, warnings are errors.
docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --clean

# The parts of three.js that the grasp page carries, from pinned versions; node and npm are needed for this alone. Which
# parts: docs/tools/viewer/three_parts.js.
viewer:
	work=$$(mktemp -d) && cp docs/tools/viewer/* $$work && \
	(cd $$work && npm install --no-package-lock --no-audit --no-fund --silent && npm run --silent bundle) && \
	cp $$work/three.min.js $$work/three.LICENSE spgf_torch/drawing/viewer && rm -r $$work
