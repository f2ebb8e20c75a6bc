#!/usr/bin/env bash
# Install system packages with apt-get: scripts/system_packages.sh vulkan|tests
#
#   vulkan  Mesa's software Vulkan driver (lavapipe), with which SAPIEN draws pictures on a machine without a GPU
#   tests   what some tests skip without: Chromium, the libusb that RealSense's library loads, and EGL
#
# SAPIEN 3 needs VK_KHR_external_semaphore_fd; lavapipe has it from Mesa 24.3 on. Debian 12 carries 22.3, so its
# backports suite is added in a sources file of its own (apt never upgrades anything from it unasked).
# Where the packages cannot be installed, it says in one line what to install and ends with status 1.
# GENSIM2_NO_SYSTEM_PACKAGES=1: install nothing.
set -u

case ${1:-} in
    vulkan) packages="mesa-vulkan-drivers libvulkan1" ;;
    tests) packages="chromium fonts-liberation libusb-1.0-0 libegl1 libgl1-mesa-dri" ;;
    *) echo "usage: $0 vulkan|tests" >&2 && exit 2 ;;
esac
minimum_mesa=24.3
sources=/etc/apt/sources.list.d/gensim2-backports.sources
suite=""
advice="run as root: apt-get install $packages"
if [ "$1" = vulkan ] && grep -qs '^VERSION_CODENAME=bookworm$' /etc/os-release; then
    suite=bookworm-backports
    advice="run as root: apt-get install -t $suite $packages (with the suite $suite among the sources of apt)"
fi

say() { printf 'system packages: %s\n' "$*" >&2; }
fail() {
    say "$*"
    exit 1
}

command -v apt-get >/dev/null 2>&1 || fail "there is no apt-get; install the equivalent of the Debian packages $packages"
[ -z "${GENSIM2_NO_SYSTEM_PACKAGES:-}" ] || fail "$advice"
as_root=""
if [ "$(id -u)" -ne 0 ]; then
    sudo -n true 2>/dev/null || fail "$advice"
    as_root="sudo -n"
fi

log=$(mktemp)
trap 'rm -f "$log"' EXIT
apt() { DEBIAN_FRONTEND=noninteractive $as_root apt-get -q -o Dpkg::Use-Pty=0 -o DPkg::Lock::Timeout=120 "$@" </dev/null >"$log" 2>&1; }
# shellcheck disable=SC2086  # a list of words
install() { apt install -y --no-install-recommends ${suite:+-t "$suite"} $packages; }

say "installing $packages"
if [ "$1" = vulkan ]; then
    if [ -n "$suite" ] && ! apt-cache policy 2>/dev/null | grep -q "n=$suite"; then
        say "adding $suite in $sources"
        printf 'Types: deb\nURIs: http://deb.debian.org/debian\nSuites: %s\nComponents: main\nSigned-By: /usr/share/keyrings/debian-archive-keyring.gpg\n' \
            "$suite" | $as_root tee "$sources" >/dev/null || fail "cannot write $sources; $advice"
    fi
    # A broken third-party source makes `update` fail although the packages we need are there: the candidate decides.
    apt update || say "apt-get update reported problems; going on"
    mesa=$(apt-cache ${suite:+-t "$suite"} policy mesa-vulkan-drivers 2>/dev/null | awk '/Candidate:/ {print $2}')
    { [ -n "$mesa" ] && [ "$mesa" != "(none)" ]; } || fail "apt finds no mesa-vulkan-drivers; $advice"
    dpkg --compare-versions "$mesa" ge "$minimum_mesa" || fail "pictures need Mesa $minimum_mesa or newer; apt offers $mesa"
    install
else
    # Package lists may be missing or old; fetch them if the packages are not found.
    install || { apt update; install; }
fi || fail "installing failed: $(grep -m1 '^E:' "$log"); $advice"
