#!/bin/sh
# Run targets of the Makefile on several Pythons: release_check.sh "python3.12 python3.13" "wheel test"
#
# Each Python gets a clone of what is committed, with an environment from the lock, and no compiled code of earlier runs.
# `wheel` builds the wheel, installs it into another new environment, and there plans and tracks a task.
set -eu
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
for python in $1; do
  echo "== $python: $("$python" --version)"
  git clone --quiet . "$work/clone"
  for part in $2; do
    NUMBA_CACHE_DIR="$work/compiled" make --no-print-directory -C "$work/clone" "$part" PYTHON="$python"
  done
  rm -rf "$work/clone" "$work/compiled"
done
