#!/bin/sh
# Make or update the environment in .venv: the locked packages, then cableway itself, editable.
#
# uv, put into .venv by pip, installs several times faster than pip; where uv cannot be had or cannot reach the
# packages, pip installs the same lock. Neither needs a compiler. Bytecode is made now: where
# PYTHONDONTWRITEBYTECODE is set, every start would make it anew, and take seconds.
set -eu
cd "$(dirname "$0")/.."
python=.venv/bin/python
host=${PYTHON:-python3}

"$host" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' || {
  echo "cableway needs Python 3.11, 3.12 or 3.13, but $host is $("$host" --version 2>&1); try: make env PYTHON=python3.11" >&2
  exit 2
}

if ! "$python" -m pip --version >/dev/null 2>&1; then
  echo "Making the environment .venv: 2.8 GB, once."
  # Some distributions split ensurepip off; then the pip outside fills the environment.
  "$host" -m venv --clear .venv >/dev/null 2>&1 || {
    "$host" -m venv --clear --without-pip .venv
    "$host" -m pip --python "$python" install --quiet pip
  }
fi

with_pip() {
  "$python" -m pip install --quiet --only-binary :all: --require-hashes -r requirements.lock
  "$python" -m pip install --quiet --no-build-isolation --no-deps -e .
}

with_uv() {
  # uv reads no pip settings, so where pip is told to use another package index, uv is told the same.
  index=$("$python" -m pip config list | sed -n "s/^[^=]*\.index.url='\(.*\)'\$/\1/p" | head -n 1)
  if [ -n "$index" ] && [ -z "${UV_DEFAULT_INDEX:-}" ]; then export UV_DEFAULT_INDEX="$index"; fi
  export VIRTUAL_ENV="$PWD/.venv"
  .venv/bin/uv pip install --quiet --only-binary :all: --compile-bytecode --require-hashes -r requirements.lock &&
    .venv/bin/uv pip install --quiet --no-build-isolation --no-deps -e .
}

echo "Installing the packages of requirements.lock, in a minute or a few."
[ -x .venv/bin/uv ] || "$python" -m pip install --quiet --only-binary :all: uv || echo "uv cannot be had; pip takes longer."
{ [ -x .venv/bin/uv ] && with_uv; } || with_pip
"$python" -m compileall -q src/cableway
