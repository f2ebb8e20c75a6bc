#!/usr/bin/env bash
# Install bubblewrap, the outer wall of the sandbox in which generated task code runs (docs/sandbox.md).
#
# Never fails the set-up: without it the inner wall, a seccomp filter, does alone. Where packages may not be installed,
# it says in one line what to install and ends with status 0.
set -u

say() { printf 'sandbox: %s\n' "$*" >&2; }
give_up() {
    say "$* Generated task code then runs behind one wall (seccomp) instead of two."
    exit 0
}

command -v apt-get >/dev/null 2>&1 || give_up "bubblewrap is not installed: install the package bubblewrap (bwrap)."
advice="bubblewrap is not installed: run as root: apt-get install bubblewrap."
[ -z "${GENSIM2_NO_SYSTEM_PACKAGES:-}" ] || give_up "$advice"

as_root=""
if [ "$(id -u)" -ne 0 ]; then
    sudo -n true 2>/dev/null || give_up "$advice"
    as_root="sudo -n"
fi

apt() { DEBIAN_FRONTEND=noninteractive $as_root apt-get -q -o Dpkg::Use-Pty=0 -o DPkg::Lock::Timeout=120 "$@" </dev/null >/dev/null 2>&1; }

say "installing bubblewrap"
# The lists may be old, or there may be none: they are fetched where the package is not found.
apt install -y --no-install-recommends bubblewrap || { apt update && apt install -y --no-install-recommends bubblewrap; } ||
    give_up "installing failed; $advice"
