#!/usr/bin/env bash
# Everything that must hold, each check once, with one summary at the end. Ends with 1 if any check failed.
set -uo pipefail
cd "$(dirname "$0")/.."

PATH=$PWD/.venv/bin:$HOME/.cargo/bin:$PATH
export PATH
# The bindings find their interpreter here whatever else is on the path; maturin set the same one.
export PYO3_PYTHON=$PWD/.venv/bin/python

if [ -z "${GENSIM2_ASSETS:-}" ]; then
    echo "check: GENSIM2_ASSETS is not set: tests on real objects will be skipped" >&2
fi

names=() outcomes=() seconds=() failed=0

check() {
    local name=$1 started=$SECONDS outcome=passed
    shift
    printf '\n== %s\n' "$name"
    "$@" || { outcome=FAILED failed=1; }
    names+=("$name") outcomes+=("$outcome") seconds+=($((SECONDS - started)))
}

check "cargo fmt" cargo fmt --all --check
check "clippy" cargo clippy --quiet --workspace --all-targets -- -D warnings
check "cargo test" cargo test --quiet
check "cargo doc" env RUSTDOCFLAGS="-D warnings" cargo doc --quiet --no-deps
check "Rust example" cargo run --quiet -p gensim2-kpam --example reach -- "$(python -c '
from gensim2.robots import robot
print(robot("panda").urdf)')"
check "ruff" ruff check .
check "ruff format" ruff format --check .
check "mypy" mypy
# One file is one process: fixtures of a module or a session are made once.
check "pytest" python -m pytest -q -n auto --maxprocesses 4 --dist loadfile --durations 10

printf '\n%-14s %-8s %s\n' check outcome seconds
for i in "${!names[@]}"; do
    printf '%-14s %-8s %s\n' "${names[$i]}" "${outcomes[$i]}" "${seconds[$i]}"
done
exit $failed
