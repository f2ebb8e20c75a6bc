#!/usr/bin/env bash
# Make .venv/ ready: pinned packages, the Rust extension, gensim2 and gensim2-robot, a Vulkan driver for pictures.
#
# `scripts/setup.sh light` makes .venv-light/ instead: gensim2[mujoco], without ManiSkill, PyTorch and Vulkan.
#
# Every step leaves a stamp in .venv/ and is skipped while what it was made from is unchanged. An existing .venv/ is
# adopted; nothing in it is removed. Environment:
#   PYTHON                        interpreter for a new .venv/ (default: the newest of python3.11 and later found)
#   GENSIM2_NO_SYSTEM_PACKAGES=1  never install a system package
set -euo pipefail
cd "$(dirname "$0")/.."

minimum_minor=11
venv=$PWD/.venv
python=$venv/bin/python

say() { printf 'setup: %s\n' "$*" >&2; }
fail() {
    printf 'setup: %s\n' "$*" >&2
    exit 1
}

is_recent_python() { "$1" -c "import sys; sys.exit(sys.version_info < (3, $minimum_minor))" >/dev/null 2>&1; }

find_python() {
    local name
    for name in ${PYTHON:-} python3.13 python3.12 python3.11 python3.14 python3 python; do
        if command -v "$name" >/dev/null 2>&1 && is_recent_python "$name"; then
            command -v "$name"
            return
        fi
    done
    fail "needs Python 3.$minimum_minor or newer (Debian 12, Ubuntu 24.04: apt-get install python3; or set PYTHON=/path/to/python)"
}

require_toolchain() {
    command -v cargo >/dev/null 2>&1 || PATH=$HOME/.cargo/bin:$PATH
    command -v cargo >/dev/null 2>&1 ||
        fail "needs Rust: curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs | sh -s -- -y   (then run make again)"
    command -v cc >/dev/null 2>&1 || fail "needs a C toolchain (Debian, Ubuntu: apt-get install build-essential)"
    local wanted have
    wanted=$(sed -n 's/^rust-version *= *"\(.*\)"/\1/p' Cargo.toml | head -n 1)
    have=$(cargo --version | cut -d ' ' -f 2)
    if [ -n "$wanted" ] && [ "$(printf '%s\n%s\n' "$wanted" "$have" | sort -V | head -n 1)" != "$wanted" ]; then
        fail "needs Rust $wanted or newer and found $have: rustup update   (or get rustup from https://rustup.rs)"
    fi
    export PATH
}

# Sets the variable uv. Debian's pip refuses to touch the system's packages; --target leaves them alone.
find_uv() {
    local interpreter=$1
    for uv in "$(command -v uv || true)" "$HOME/.local/bin/uv" "$PWD/.tools/bin/uv"; do
        if [ -n "$uv" ] && "$uv" --version >/dev/null 2>&1; then return; fi
    done
    say "fetching uv with pip"
    "$interpreter" -m pip install --quiet --root-user-action ignore --disable-pip-version-check --upgrade --target .tools uv ||
        fail "could not fetch uv with pip (Debian, Ubuntu: apt-get install python3-pip; or install uv from https://docs.astral.sh/uv)"
    uv=$PWD/.tools/bin/uv
}

# changed STAMP HASH: true unless the stamp in .venv/ holds that hash.
changed() { [ "$(cat "$venv/.gensim2-$1" 2>/dev/null || true)" != "$2" ]; }
stamp() { printf '%s\n' "$2" >"$venv/.gensim2-$1"; }
digest() { sha256sum | cut -d ' ' -f 1; }

sources_of_the_extension() {
    find crates Cargo.toml Cargo.lock pyproject.toml -type f \( -name '*.rs' -o -name '*.toml' -o -name '*.lock' \) -print0 |
        LC_ALL=C sort -z | xargs -0 sha256sum
}

sources_of_the_package() { find python/gensim2 -type f ! -name '*.pyc' -print0 | LC_ALL=C sort -z | xargs -0 sha256sum; }

require_toolchain
if [ "${1:-}" = light ]; then
    venv=$PWD/.venv-light
    python=$venv/bin/python
fi
if [ ! -x "$python" ]; then
    interpreter=$(find_python)
    find_uv "$interpreter"
    say "making $(basename "$venv") with $("$interpreter" --version)"
    "$uv" venv --quiet --allow-existing --python "$interpreter" "$venv"
fi
is_recent_python "$python" || fail "$(basename "$venv") holds a Python older than 3.$minimum_minor: remove it and run make again"
place="$PWD $("$python" -V) $(cargo --version)"

if [ "${1:-}" = light ]; then
    light=$({ echo "$place" && cat requirements.lock && sources_of_the_extension && sources_of_the_package; } | digest)
    if changed light "$light"; then
        find_uv "$python"
        say "installing gensim2[mujoco]; the extension is built in release mode (1 to 3 minutes the first time)"
        CARGO_TERM_QUIET=true CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target} \
            "$uv" pip install --quiet --python "$python" --constraint requirements.lock --reinstall-package gensim2 ".[mujoco]" ||
            fail "gensim2 could not be installed"
        stamp light "$light"
    fi
    say "ready: .venv-light/bin/gensim2"
    exit
fi

packages=$({ echo "$place" && cat requirements.lock; } | digest)
if changed packages "$packages"; then
    find_uv "$python"
    say "installing the pinned packages (several GB the first time)"
    # The lock is complete: resolving again could only disagree with it.
    "$uv" pip install --quiet --no-deps --require-hashes --python "$python" -r requirements.lock
    stamp packages "$packages"
fi

extension=$({ echo "$place" && sources_of_the_extension; } | digest)
if changed extension "$extension" || [ ! -x "$venv/bin/gensim2" ] ||
    ! ls python/gensim2_kpam/_native*.so >/dev/null 2>&1; then
    find_uv "$python"
    say "building the extension in release mode (1 to 3 minutes the first time)"
    CARGO_TERM_QUIET=true VIRTUAL_ENV=$venv PATH=$(dirname "$uv"):$PATH "$venv/bin/maturin" develop --quiet --release --uv ||
        fail "the extension did not build"
    stamp extension "$extension"
fi

robot=$({ echo "$place" && cat python/pyproject.toml; } | digest)
if changed robot "$robot"; then
    find_uv "$python"
    # setuptools is pinned in requirements.lock, so that nothing is fetched.
    "$uv" pip install --quiet --no-deps --no-build-isolation --python "$python" --editable python
    stamp robot "$robot"
fi

if [ ! -e "$venv/.gensim2-vulkan" ]; then
    "$python" -m gensim2.doctor vulkan || scripts/system_packages.sh vulkan ||
        say "everything but pictures and videos works without a Vulkan driver"
    touch "$venv/.gensim2-vulkan"
fi
say "ready: .venv/bin/gensim2"
