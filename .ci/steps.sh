# What .ci/run and .ci/full do, each step a function; to be sourced in the project's folder.
work=$(mktemp -d)
trap 'kill $(jobs -p) 2> /dev/null || true; rm -rf "$work"' EXIT
bin="$work/venv/bin"

# The README's test command, with a Python and with the environment in a folder of its own.
test_command() {
  local command
  command=$(awk '/^## Test it/{found=1} found && /^python3 -m venv/{print; exit}' README.md)
  [ -n "$command" ] || { echo "no test command in README.md"; exit 1; }
  command="${command//python3 -m venv/$1 -m venv}"
  echo "+ $command"
  eval "${command//.venv/$work/venv}"
}

need_chromium() {
  for name in chromium chromium-browser google-chrome; do
    if command -v "$name" > /dev/null; then return; fi
  done
  { apt-get -qq update && apt-get -qq install -y chromium; } > /dev/null \
    || { echo "The tests of pages need Chromium, and it cannot be installed here."; exit 1; }
}

static_checks() {
  local mypy PYTHONPATH
  PYTHONPATH=core:$(printf "%s:" plugins/*/)
  export PYTHONPATH
  "$bin/mypy" &
  mypy=$!
  "$bin/ruff" format --check .
  "$bin/ruff" check .
  "$bin/lint-imports"
  wait "$mypy"
}

# The documentation site; `site force` executes its tutorials, `site off` does not. What it needs beside is no second
# build of palpate.
site() {
  "$bin/pip" install -q 'palpate[docs,notebook]'
  "$bin/sphinx-build" -q -W --keep-going -j auto -D "nb_execution_mode=$1" docs "$work/site"
}
