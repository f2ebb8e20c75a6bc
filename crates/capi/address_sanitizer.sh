#!/bin/sh
# Runs the tests of the C interface, and its C programs, under AddressSanitizer, which also reports leaked memory. Needs a
# nightly toolchain and a C compiler with that sanitizer; takes some minutes, and builds into a folder of its own.
set -eu
cd "$(dirname "$0")/../.."
target=x86_64-unknown-linux-gnu
folder="${CARGO_TARGET_DIR:-target}/asan"
export RUSTFLAGS="-Zsanitizer=address" CARGO_TARGET_DIR="$folder"
cargo +nightly test -p gensim2-capi --target "$target" --test attack
cargo +nightly build -p gensim2-capi --target "$target"
built="$folder/$target/debug"
printf 'v 0 0 0\nv 100 0 0\nv 0 50 0\nv 0 0 100\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n' > "$built/tetrahedron.obj"
run() {
    program="$built/$(basename "$1" .c)"
    "${CC:-cc}" -fsanitize=address -g -Icrates/capi/include "crates/capi/$1" "$built/libgensim2_capi.a" \
        -lm -lpthread -ldl -o "$program"
    shift
    "$program" examples/robots/ur5e.urdf "$@"
}
run examples/servo.c flange
run examples/pick.c
run tests/c/results.c "$built/tetrahedron.obj"
