# setup: .venv with everything, from nothing.   demo: build, score and draw the generated scene.
# test: lint, types, tests.                     fix: format and mend what ruff can.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.ready
WARM := .venv/.warm
DEMO ?= demo-out
FRAMES ?= all

.PHONY: setup demo test lint types fix clean
.DELETE_ON_ERROR:

setup: $(STAMP) $(WARM)
	@$(BIN)/python -m compileall -q tcrdata

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	# trackeval asks for opencv-python, which needs libGL and overwrites the headless one: without it.
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --no-deps trackeval tabulate
	@touch $(STAMP)

# Where Python may write no bytecode, every command would compile its modules anew.
$(WARM): $(STAMP)
	$(BIN)/python -m compileall -q tcrdata
	$(BIN)/python -m tcrdata warm
	@touch $(WARM)

demo: setup
	$(BIN)/tcrdata build --dataset demo --preset tcrdata,tabletop --frames $(FRAMES) --store $(DEMO)/store
	$(BIN)/tcrdata evaluate --store $(DEMO)/store
	$(BIN)/tcrdata draw --store $(DEMO)/store --out $(DEMO)/pictures
	@echo "pictures: $(DEMO)/pictures   store: $(DEMO)/store"
	@echo "next: $(BIN)/tcrdata sql \"select source, count(*) from proposals group by all\" --store $(DEMO)/store"

# The kernels compile while the types are checked.
test: $(STAMP)
	$(MAKE) --jobs 2 lint types $(WARM)
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy

fix: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/nbstripout notebooks/*.ipynb

clean:
	rm -rf .venv demo-out .mypy_cache .ruff_cache .pytest_cache
