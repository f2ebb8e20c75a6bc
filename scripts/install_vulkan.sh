#!/usr/bin/env bash
# Install Mesa's software Vulkan driver (lavapipe), which SAPIEN needs to draw pictures on a machine without a GPU.
#
# SAPIEN 3 needs VK_KHR_external_semaphore_fd; lavapipe has it from Mesa 24.3 on. Debian 12 carries 22.3, so its
# backports suite is added in a sources file of its own (apt never upgrades anything from it unasked).
# Never fails the set-up: everything but pictures works without a driver. Where packages may not be installed,
# it says in one line what to install and ends with status 0.
set -u

minimum=24.3
packages="mesa-vulkan-drivers libvulkan1"
sources=/etc/apt/sources.list.d/gensim2-backports.sources

say() { printf 'vulkan: %s\n' "$*" >&2; }
give_up() {
    say "$* Everything but pictures and videos works without it."
    exit 0
}

command -v apt-get >/dev/null 2>&1 ||
    give_up "no Vulkan driver works here; for pictures install Mesa's lavapipe >= $minimum (or a GPU driver)."

. /etc/os-release
suite=""
advice="apt-get install $packages"
if [ "${ID:-}" = debian ] && [ "${VERSION_ID:-}" = 12 ]; then
    suite=bookworm-backports
    advice="apt-get install -t $suite $packages (after adding the suite $suite to apt's sources)"
fi

[ -z "${GENSIM2_NO_SYSTEM_PACKAGES:-}" ] || give_up "no Vulkan driver works here; for pictures run as root: $advice."

as_root=""
if [ "$(id -u)" -ne 0 ]; then
    if sudo -n true 2>/dev/null; then
        as_root="sudo -n"
    else
        give_up "no Vulkan driver works here; for pictures run as root: $advice."
    fi
fi

apt() { DEBIAN_FRONTEND=noninteractive $as_root apt-get -q -o Dpkg::Use-Pty=0 -o DPkg::Lock::Timeout=120 "$@" </dev/null; }

log=$(mktemp)
trap 'rm -f "$log"' EXIT

if [ -n "$suite" ] && ! apt-cache policy 2>/dev/null | grep -q "n=$suite"; then
    say "adding $suite in $sources"
    printf 'Types: deb\nURIs: http://deb.debian.org/debian\nSuites: %s\nComponents: main\nSigned-By: /usr/share/keyrings/debian-archive-keyring.gpg\n' \
        "$suite" | $as_root tee "$sources" >/dev/null || give_up "cannot write $sources; for pictures run as root: $advice."
fi

# A broken third-party source makes `update` fail although the packages we need are there: the candidate decides.
apt update >"$log" 2>&1 || say "apt-get update reported problems; going on"
candidate=$(apt-cache ${suite:+-t "$suite"} policy mesa-vulkan-drivers 2>/dev/null | awk '/Candidate:/ {print $2}')
if [ -z "$candidate" ] || [ "$candidate" = "(none)" ]; then
    give_up "apt finds no mesa-vulkan-drivers; for pictures run as root: $advice."
fi
if dpkg --compare-versions "$candidate" lt "$minimum"; then
    give_up "apt offers Mesa $candidate and pictures need >= $minimum: install a newer mesa-vulkan-drivers."
fi

say "installing Mesa $candidate"
# shellcheck disable=SC2086  # both are lists of words
if ! apt install -y --no-install-recommends ${suite:+-t "$suite"} $packages >"$log" 2>&1; then
    say "$(grep -m1 '^E:' "$log")"
    give_up "installing failed; for pictures run as root: $advice."
fi
