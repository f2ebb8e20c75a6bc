#!/usr/bin/env bash
# Audit the dependencies: of Rust with cargo-deny (deny.toml), of Python with pip-audit (both locks). Ends with 1 on a finding.
#
# Licences, bans and sources of crates need no network. Advisories do: if a database cannot be reached, one line says so and
# the rest decides.
set -uo pipefail
cd "$(dirname "$0")/.."
PATH=$PATH:$HOME/.cargo/bin:$PWD/.tools/bin

failed=0
say() { printf 'audit: %s\n' "$*"; }
finding() {
    printf '%s\n' "$2"
    say "$1: FAILED"
    failed=1
}

if ! cargo deny --version >/dev/null 2>&1; then
    say "needs cargo-deny: cargo install --locked cargo-deny"
    exit 1
fi
if output=$(cargo deny --workspace --log-level error check licenses bans sources 2>&1); then
    say "licences, bans and sources of crates: passed"
else
    finding "licences, bans and sources of crates" "$output"
fi
if ! cargo deny --log-level error fetch db >/dev/null 2>&1; then
    say "advisories for crates: SKIPPED, the RustSec database cannot be fetched"
elif output=$(cargo deny --workspace --log-level error check advisories 2>&1); then
    say "advisories for crates: passed"
else
    finding "advisories for crates" "$output"
fi

# --strict ends at the first package about which the service cannot say anything.
output=$(uvx --quiet pip-audit@2.10.1 --strict --disable-pip --require-hashes --progress-spinner off \
    -r requirements.lock -r requirements-docs.lock 2>&1)
case $?:$output in
    0:*) say "advisories for Python packages: passed" ;;
    *:*"known vulnerabilit"*) finding "advisories for Python packages" "$output" ;;
    *) say "advisories for Python packages: SKIPPED, $(printf '%s\n' "$output" | tail -n 1)" ;;
esac
exit "$failed"
