#!/usr/bin/env bash
# Make .venv/ ready, then everything that must hold, each check once, with one summary at the end. Ends with 1 if any
# check failed.
set -uo pipefail
cd "$(dirname "$0")/.."

PATH=$PWD/.venv/bin:$HOME/.cargo/bin:$PATH
export PATH
# The bindings find their interpreter here whatever else is on the path; maturin set the same one.
export PYO3_PYTHON=$PWD/.venv/bin/python

if [ -z "${GENSIM2_ASSETS:-}" ]; then
    echo "check: GENSIM2_ASSETS is not set: tests on real objects will be skipped" >&2
fi

# Two lanes side by side: compilers and downloads leave a core idle half of the time. What the Rust lane says is shown
# when it has ended.
work=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null; rm -rf "$work"' EXIT

# check LANE NAME COMMAND...: run it, and note its outcome and its seconds.
check() {
    local lane=$1 name=$2 started=$SECONDS outcome=passed
    shift 2
    printf '\n== %s\n' "$name"
    "$@" || outcome=FAILED
    printf '%-14s %-8s %s\n' "$name" "$outcome" $((SECONDS - started)) >>"$work/$lane.outcomes"
    [ "$outcome" = passed ]
}

rust_lane() {
    check rust "cargo fmt" cargo fmt --all --check
    check rust "cargo test" cargo test --quiet
    # What follows needs the interpreter that the other lane makes, and takes what cores the Python tests leave idle.
    while [ ! -e "$work/setup-ended" ]; do sleep 1; done
    check rust "clippy" cargo clippy --quiet --workspace --all-targets -- -D warnings
    check rust "cargo doc" env RUSTDOCFLAGS="-D warnings" cargo doc --quiet --no-deps
    check rust "mypy" mypy
    # Built with the tests; for the one package alone Cargo would build everything again, with fewer features.
    check rust "Rust example" "${CARGO_TARGET_DIR:-target}/debug/examples/reach" "$(python -c '
from gensim2.robots import robot
print(robot("panda").urdf)')"
}

python_lane() {
    local ready=0
    check python "setup" scripts/setup.sh || ready=1
    touch "$work/setup-ended"
    [ "$ready" = 0 ] || return 1
    check python "ruff" ruff check .
    check python "ruff format" ruff format --check .
    # One file is one process: fixtures of a module or a session are made once. tests/conftest.py orders the files.
    # One process more than there are cores, four at most: some tests wait for clocks and other processes.
    check python "pytest" python -m pytest -q -n "$(($(nproc) < 4 ? $(nproc) + 1 : 4))" --dist loadfile --no-loadscope-reorder --durations 10
}

rust_lane >"$work/rust.log" 2>&1 &
python_lane
wait
cat "$work/rust.log"
printf '\n%-14s %-8s %s\n' check outcome seconds
cat "$work/rust.outcomes" "$work/python.outcomes"
[ "$(cat "$work"/*.outcomes | wc -l)" = 10 ] && ! grep -q FAILED "$work"/*.outcomes
