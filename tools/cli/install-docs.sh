#!/bin/sh
# Installs man pages and shell completions of the programs that are in PATH.
# usage: tools/cli/install-docs.sh [PREFIX]     PREFIX is ~/.local by default
set -eu
share=${1:-$HOME/.local}/share
man=$share/man/man1
bash=$share/bash-completion/completions
zsh=$share/zsh/site-functions
fish=$share/fish/vendor_completions.d
mkdir -p "$man" "$bash" "$zsh" "$fish"
for program in dsm-info dsm-convert dsm-join dsm-build dsm-render; do
  if ! command -v "$program" >/dev/null; then
    echo "skipped: $program is not in PATH" >&2
    continue
  fi
  "$program" --man >"$man/$program.1"
  "$program" --completions bash >"$bash/$program"
  "$program" --completions zsh >"$zsh/_$program"
  "$program" --completions fish >"$fish/$program.fish"
done
if command -v dsm-join >/dev/null; then
  for command in stitch merge collect; do
    dsm-join "$command" --man >"$man/dsm-join-$command.1"
  done
fi
