# Help and refusals of the bash scripts. Each sources this file before it changes the folder:
#
#   source "$(dirname "${BASH_SOURCE[0]}")/usage.sh"
#
# The help of a script is its head comment. With --help or -h among the arguments, it is printed and the script ends
# with 0.

# Ends the script with exit code 2 and one line on stderr.
refuse() {
  printf '%s: %s; --help shows the usage\n' "${0##*/}" "$*" >&2
  exit 2
}

# Refuses arguments beyond the first $1; the others are those of the script.
at_most() {
  local most=$1
  shift
  [ $# -le "$most" ] || refuse "unknown argument ${*:most + 1:1}"
}

for word; do
  case $word in
    -h | --help)
      awk 'NR > 1 { if (!/^#/) exit; sub(/^# ?/, ""); print }' "$0"
      exit
      ;;
  esac
done
unset word
