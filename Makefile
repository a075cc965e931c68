# Everything a person or CI does here. Needs Python 3.11 or newer and make; no root, no display.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --no-input
# Two workers, a file each; a worker that dies ends the run and is not replaced: its test would hang the next one, too.
TWO := -n 2 --dist loadfile --max-worker-restart=0
# What the C of the planner is made of.
NATIVE := $(wildcard planner/native/*/*.[ch] planner/backends/casadi_nlp/*.py planner/backends/casadi_nlp/symbols/*.py)
# Steps of setting up, by what is asked for.
STEPS := $(if $(filter-out demo up web web-check sbom audit,$(or $(MAKECMDGOALS),setup)),3,$(if $(filter demo up,$(MAKECMDGOALS)),2,1))
SOURCES := fling planner store learning jobs api executor simulator verifier audit benchmarks

.PHONY: setup demo up test test-slow verify verify-ci wheels sbom audit soak fuzz test-kernels check web web-check bench bench-batches pictures docs lock clean

setup: $(VENV)/dev.stamp   ## .venv with everything pinned, and the C compiled

demo: $(VENV)/native.stamp      ## one throw from plan to landing on a simulated UR5e
	$(BIN)/fling demo

up: $(VENV)/native.stamp        ## simulator, executor, service and web page until Ctrl-C
	$(BIN)/fling up

test: $(VENV)/dev.stamp         ## all but slow tests
	$(BIN)/python -m pytest $(TWO) --ignore tests/system --ignore tests/verify -m "not slow"
	$(BIN)/python -m pytest tests/system -m "not slow"  # in real time: nothing beside it

test-slow: $(VENV)/dev.stamp    ## the other tests, but for those of `make verify`
	$(BIN)/python -m pytest $(TWO) --ignore tests/system --ignore tests/verify -m slow
	$(BIN)/python -m pytest tests/system -m slow

verify: $(VENV)/docs.stamp $(VENV)/verify.stamp $(VENV)/ray.stamp   ## what takes minutes: wheels, both databases, generated clients, notebooks, more of the fault matrix; LONG=1: an hour of soak, too
	$(if $(LONG),FLING_SOAK_MINUTES=60) $(BIN)/python -m pytest tests/verify

soak: $(VENV)/dev.stamp         ## MINUTES (10) of load, kills and hostile requests: nothing may grow, nothing be lost
	$(BIN)/python -m benchmarks.soak --minutes $(or $(MINUTES),10)

verify-ci: $(VENV)/verify.stamp   ## what of it continuous integration has time for
	$(BIN)/python -m pytest $(TWO) tests/verify -m "not slow"

wheels: $(VENV)/dev.stamp       ## dist/: one wheel for CPython 3.11 and later, and the source
	$(BIN)/python -m build --no-isolation --outdir dist

sbom: $(VENV)/run.stamp         ## dist/fling.cdx.json: what an installed Fling consists of (CycloneDX)
	mkdir -p dist
	$(BIN)/python requirements/sbom.py > dist/fling.cdx.json

# --strict: what cannot be asked about is a failure, not a silence.
audit: $(VENV)/audit.stamp      ## known vulnerabilities of what an installed Fling consists of; needs the internet
	$(BIN)/python -m pip_audit --strict --disable-pip --require-hashes -r requirements/run.txt

fuzz: $(VENV)/verify.stamp   ## 5,000 cases of schemathesis on both databases, with three seeds that nobody chose
	FLING_CASES=5000 $(BIN)/python -m pytest tests/verify/test_openapi.py

# What computes once more with older kernels of numpy, BLAS and libm, on one thread. About four minutes.
test-kernels: $(VENV)/dev.stamp
	NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4" GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F OPENBLAS_CORETYPE=Prescott \
		OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -W "ignore:During parsing:ImportWarning" \
		$(TWO) tests/planner tests/benchmarks

# What --verifytypes looks into is the Python on the path, whatever --pythonpath says.
check: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache
	$(BIN)/pyright --pythonpath $(BIN)/python
	@mkdir -p build
	PATH=$(CURDIR)/$(BIN):$$PATH pyright --verifytypes fling --ignoreexternal > build/types.txt || { cat build/types.txt; exit 1; }

web: $(VENV)/run.stamp web/node_modules/.package-lock.json   ## the page's bundle, api/web, from web/ (needs Node 20.19 or newer)
	mkdir -p web/build
	$(BIN)/python web/schema.py > web/build/openapi.json
	cd web && npm run --silent types && npm run --silent build

web-check: $(VENV)/run.stamp web/node_modules/.package-lock.json   ## tests of the page's modules; the bundle built again is the one in api/web
	mkdir -p web/build
	$(BIN)/python web/schema.py > web/build/openapi.json
	cd web && npx openapi-typescript build/openapi.json --output build/schema.d.ts --root-types --root-types-no-schema-prefix
	cmp web/build/schema.d.ts web/src/service/schema.d.ts || { echo "the service's schema has changed: make web"; exit 1; }
	cd web && npm run --silent test && FLING_WEB_OUT=build/bundle npm run --silent build
	diff -r web/build/bundle api/web || { echo "the bundle is not that of its source: make web"; exit 1; }

web/node_modules/.package-lock.json: web/package.json web/package-lock.json
	cd web && npm ci --silent
	touch $@

bench: $(VENV)/bench.stamp  ## writes build/benchmarks and ThrowBench's table, about ten minutes; SLOW=1 for hours
	$(BIN)/python -m benchmarks $(if $(SLOW),--slow)
	$(BIN)/python -m benchmarks.conditions --count $(if $(SLOW),100,5) --out build/benchmarks
	$(BIN)/python -m benchmarks.maps $(if $(SLOW),,--resolution 0.3 --sample 30) --out build/benchmarks
	$(BIN)/python -m benchmarks.arm_capsules.report --throws $(if $(SLOW),60,6)
	$(BIN)/python -m benchmarks.page
	$(BIN)/python -m benchmarks.throwbench --count $(if $(SLOW),20,4) --out docs/benchmarks/throwbench.md

bench-batches: $(VENV)/ray.stamp  ## batches through both engines, with kills: minutes; SLOW=1: 20,000 plans each, about two hours
	$(BIN)/python -m benchmarks.batches --count $(if $(SLOW),20000,400) --costs $(if $(SLOW),1000,200) --out build/benchmarks

pictures: $(VENV)/dev.stamp  ## the README's pictures and animation of a throw (needs chromium)
	$(BIN)/python -m benchmarks.page.pictures
	$(BIN)/fling map --cell ur5e-sim --extent -1.5 1.5 -1.5 1.5 --out docs/img/map-ur5e-sim.png

docs: $(VENV)/docs.stamp        ## writes build/docs: tutorial, course, reference; runs the course's notebooks
	$(BIN)/python -P -m sphinx -W --keep-going -q -d build/doctrees docs build/docs
	@echo "build/docs/index.html"

lock:                           ## pin requirements/*.in anew (needs uv)
	for name in run dev docs verify bench ray audit; do \
		uv pip compile --quiet --universal --python-version 3.11 --fork-strategy fewest --generate-hashes \
			--no-emit-index-url --no-header --no-annotate requirements/$$name.in -o requirements/$$name.txt || exit 1; \
	done

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find $(SOURCES) tests -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Fling needs Python 3.11 or newer; try: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/run.stamp: requirements/run.txt | $(VENV)/bin/python
	@echo 'setting up 1 of $(STEPS): Python packages, about half a minute …'
	@$(PIP) install --quiet --no-compile --require-hashes -r requirements/run.txt
	touch $@

$(VENV)/dev.stamp: requirements/dev.txt $(VENV)/native.stamp
	@echo 'setting up 3 of $(STEPS): tools of the tests and checks, about half a minute …'
	@$(PIP) install --quiet --no-compile --require-hashes -r requirements/dev.txt
	touch $@

# Compiles what is newer than its object, on all processors.
$(VENV)/native.stamp: $(VENV)/run.stamp pyproject.toml setup.py $(NATIVE)
	@echo 'setting up 2 of $(STEPS): compiling, half a minute on two fast cores, minutes on a slow machine …'
	@$(BIN)/python setup.py --quiet build_ext --inplace  # pip would keep its progress to itself
	@$(PIP) install --quiet --no-deps --no-build-isolation --editable .
	touch $@

$(VENV)/docs.stamp: requirements/docs.txt $(VENV)/dev.stamp
	$(PIP) install --quiet --require-hashes -r requirements/docs.txt
	touch $@

$(VENV)/verify.stamp: requirements/verify.txt $(VENV)/dev.stamp
	$(PIP) install --quiet --require-hashes -r requirements/verify.txt
	touch $@

$(VENV)/audit.stamp: requirements/audit.txt $(VENV)/run.stamp
	$(PIP) install --quiet --require-hashes -r requirements/audit.txt
	touch $@

$(VENV)/ray.stamp: requirements/ray.txt $(VENV)/dev.stamp
	$(PIP) install --quiet --require-hashes -r requirements/ray.txt
	touch $@

$(VENV)/bench.stamp: requirements/bench.txt $(VENV)/dev.stamp
	$(PIP) install --quiet --require-hashes -r requirements/bench.txt
	touch $@
