# bash completion of submapctl. Commands, options and their values come from --help, so that they are those of the
# installed program.

_submapctl_help() { submapctl "$@" --help 2>/dev/null; }

_submapctl() {
  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]}
  COMPREPLY=()
  if ((COMP_CWORD == 1)); then
    local commands
    commands=$(_submapctl_help | sed -n '/^Subcommands:/,$s/^  \([a-z][a-z-]*\).*/\1/p')
    mapfile -t COMPREPLY < <(compgen -W "$commands --help" -- "$current")
    return
  fi
  local help values
  help=$(_submapctl_help "${COMP_WORDS[1]}") || return
  if [[ $previous == --* ]]; then
    # "  --filter TEXT:{adaptive,rbpf,fastslam}" names its values; "  --out TEXT" takes anything, so offer files.
    local line
    line=$(grep -E -- "^  $previous [A-Z]" <<<"$help")
    values=$(sed -n 's/.*{\([^}]*\)}.*/\1/p' <<<"$line")
    if [[ -n $values ]]; then
      mapfile -t COMPREPLY < <(compgen -W "${values//,/ }" -- "$current")
      return
    fi
    if [[ $line == *" TEXT"* ]]; then
      compopt -o filenames 2>/dev/null
      mapfile -t COMPREPLY < <(compgen -f -- "$current")
      return
    fi
    [[ -z $line ]] || return  # a number
  fi
  if [[ $current == -* ]]; then
    values=$(sed -n 's/^  \(-h,\)\{0,1\}\(--[a-z-]*\).*/\2/p' <<<"$help")
    mapfile -t COMPREPLY < <(compgen -W "$values" -- "$current")
  elif [[ $help == *$'\nPositionals:'* ]]; then
    compopt -o filenames 2>/dev/null
    mapfile -t COMPREPLY < <(compgen -f -- "$current")
  fi
}
complete -F _submapctl submapctl
