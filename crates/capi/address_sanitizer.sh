#!/bin/sh
# Runs the tests of the C interface, and the C program of its examples, under AddressSanitizer. Needs a nightly toolchain
# and a C compiler with that sanitizer; takes some minutes, and builds into a folder of its own.
set -eu
cd "$(dirname "$0")/../.."
target=x86_64-unknown-linux-gnu
folder="${CARGO_TARGET_DIR:-target}/asan"
export RUSTFLAGS="-Zsanitizer=address" CARGO_TARGET_DIR="$folder"
cargo +nightly test -p gensim2-capi --target "$target" --test attack
cargo +nightly build -p gensim2-capi --target "$target"
built="$folder/$target/debug"
"${CC:-cc}" -fsanitize=address -g -Icrates/capi/include crates/capi/examples/servo.c "$built/libgensim2_capi.a" \
    -lm -lpthread -ldl -o "$built/servo"
"$built/servo" examples/robots/ur5.urdf flange
