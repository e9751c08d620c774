#!/usr/bin/env bash
# Fuzzes the project's inputs: installs what is missing, builds with clang, AddressSanitizer and UndefinedBehaviorSanitizer, runs.
source "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
targets=(datagram session dtls toml gsf gwy curve thermal bundle steps snapshot hdf5 path)
usage() {
  cat <<H
usage: deploy/fuzz.sh [--no-install] [--runs N | --seconds S] [TARGET ...]
  TARGET        one or more of: ${targets[*]} (default: all)
  --runs N      executions of each target
  --seconds S   time for each target (default 60)
  --no-install  do not call apt; fail if something is missing

What is learned stays in build/fuzz/corpus/TARGET; an input that fails is left as build/fuzz/found/TARGET-*, to be replayed with
build/fuzz/bin/fuzz_TARGET FILE and to be kept in tests/fuzz/seeds/TARGET once it is mended. Prints CSV: target, executions,
executions a second, findings.
H
}
parse_common_flags "$@"
runs= seconds=60 chosen=()
whole() { [[ $2 =~ ^[1-9][0-9]{0,11}$ ]] || die "$1 is '$2', expected a whole number from 1" 2; }
set -- "${rest[@]}"
while [ $# -gt 0 ]; do
  case $1 in
    --runs|--seconds)
      [ $# -ge 2 ] || die "$1 needs a number; see --help" 2
      whole "$1" "$2"
      if [ "$1" = --runs ]; then runs=$2 seconds=; else seconds=$2 runs=; fi
      shift 2 ;;
    -*) die "there is no option $1; see --help" 2 ;;
    *)
      [[ " ${targets[*]} " == *" $1 "* ]] || die "there is no target '$1', expected one of: ${targets[*]}" 2
      chosen+=("$1")
      shift ;;
  esac
done
[ ${#chosen[@]} -gt 0 ] || chosen=("${targets[@]}")

if [ "$install" = yes ]; then
  install_missing "${build_packages[@]}"
  newest_clang clang++ >/dev/null || install_missing clang
  version=$("$(newest_clang clang++)" -dumpversion)
  install_missing "libclang-rt-${version%%.*}-dev"
fi
clang=$(newest_clang clang++) || die "there is no clang++ of version 14 or later; run without --no-install, or: apt-get install clang libclang-rt-dev" 2
cd "$project"
say 'Configuring (CMake preset fuzz)'
mkdir -p build/fuzz
cmake --preset fuzz "-DCMAKE_C_COMPILER=${clang/clang++/clang}" "-DCMAKE_CXX_COMPILER=$clang" >build/fuzz/configure.log 2>&1 || { tail -n 30 build/fuzz/configure.log >&2; die 'CMake failed'; }
say "Building with $jobs jobs"
cmake --build --preset fuzz --parallel "$jobs" --target "${chosen[@]/#/fuzz_}" >&2

seeds_of() { # what the project has of this kind already, and what was made for it
  case $1 in
    datagram) echo proto/golden ;;
    toml) mkdir -p build/fuzz/toml_files; cp deploy/scenes/*.toml deploy/station.toml build/fuzz/toml_files/; echo build/fuzz/toml_files ;;
    path) mkdir -p build/fuzz/path_files; cp deploy/scenes/*.csv build/fuzz/path_files/; echo build/fuzz/path_files ;;
  esac
  echo "tests/fuzz/seeds/$1"
}
longest_of() { # bytes of an input: longer ones only cost time
  case $1 in
    datagram) echo 600 ;; session|hdf5) echo 120 ;; dtls) echo 200 ;; steps) echo 300 ;; snapshot) echo 200 ;; gsf) echo 512 ;; gwy) echo 800 ;; toml) echo 2200 ;; bundle) echo 1500 ;; curve) echo 16000 ;; thermal) echo 12000 ;; *) echo 4096 ;;
  esac
}

failed=0
echo 'target,executions,executions_per_s,findings'
for target in "${chosen[@]}"; do
  say "Fuzzing $target"
  mkdir -p "build/fuzz/corpus/$target" build/fuzz/found
  log=build/fuzz/$target.log
  dictionary=()
  [ ! -e "tests/fuzz/dict/$target.dict" ] || dictionary=("-dict=tests/fuzz/dict/$target.dict")
  mapfile -t seeds < <(seeds_of "$target")
  status=0
  # Without the entropic choice of inputs: its accounts take eight times as long as the session target itself.
  "build/fuzz/bin/fuzz_$target" ${runs:+-runs=$runs} ${seconds:+-max_total_time=$seconds} "-max_len=$(longest_of "$target")" -timeout=60 \
    -rss_limit_mb=4096 -entropic=0 -reduce_inputs=0 -print_final_stats=1 "-artifact_prefix=build/fuzz/found/$target-" "${dictionary[@]}" \
    "build/fuzz/corpus/$target" "${seeds[@]}" >"$log" 2>&1 || status=$?
  executions=$(awk '/^stat::number_of_executed_units/ {print $2}' "$log")
  rate=$(awk '/^stat::average_exec_per_sec/ {print $2}' "$log")
  echo "$target,${executions:-0},${rate:-0},$([ $status = 0 ] && echo 0 || echo 1)"
  if [ $status != 0 ]; then
    failed=1
    grep -E 'does not hold|ERROR|runtime error|SUMMARY|Test unit written' "$log" | head -5 >&2 || true
    say "$target failed; the whole output is in $project/$log"
  fi
done
exit $failed
