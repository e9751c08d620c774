#!/usr/bin/env bash
# Takes a fresh Debian 12 or 13 all the way to a tested build: installs what is missing, configures, builds, runs the tests.
source "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
usage() {
  cat <<'H'
usage: deploy/test.sh [--no-install] [--full] [CTEST ARGUMENT ...]
  --no-install   do not call apt; fail if something is missing
  --full         also what takes minutes each: an AFM under a real systemd, long sessions, big statistics (an hour on two cores)
  other words go to CTest, for example:  deploy/test.sh -L unit      deploy/test.sh -R MaugisDugdale
H
}
parse_common_flags "$@"
words=("${rest[@]}") rest=()
for word in "${words[@]}"; do
  if [ "$word" = --full ]; then rest=(-C full "${rest[@]}"); else rest+=("$word"); fi
done
if [ "$install" = yes ]; then
  install_missing "${build_packages[@]}" "${test_packages[@]}" "${layout_packages[@]}"
  say 'Preparing the virtual machine of the network tests'
  bash "$project/tests/system/vm.sh" --prepare || say 'There will be none: tests that need it are skipped'
fi
configure_and_build
say "Running the tests"
cd "$project/build/release"
log=Testing/Temporary/LastTest.log said=Testing/said.txt
mkdir -p Testing
rm -f "$log"
status=0
# Half as many again as processors: most tests of real programs wait for most of their time.
ctest --output-on-failure --no-tests=error -j $((jobs + jobs / 2)) "${rest[@]}" | tee "$said" || status=$?
# What was not looked at is said at the end, and after it what CTest's own end says. Words that only list tests write no log.
if [ -e "$log" ]; then
  bash "$project/deploy/skipped.sh" Testing
  grep -E '^[0-9]+% tests passed, ' "$said" | tail -n 1 || true
fi
exit "$status"
