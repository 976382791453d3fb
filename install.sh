#!/bin/sh
# Installs shellcal for this user: fetches the archive of a release, verifies its checksum and installs the
# program, its manual and completions below ~/.local. Needs curl, tar, gzip, sha256sum or shasum.
#
#   curl -fsSL https://github.com/shellcal/shellcal/releases/latest/download/install.sh | sh
#
# SHELLCAL_RELEASE is another address of the files, SHELLCAL_PREFIX another folder than ~/.local.
set -eu

release=${SHELLCAL_RELEASE:-https://github.com/shellcal/shellcal/releases/latest/download}
prefix=${SHELLCAL_PREFIX:-$HOME/.local}

fail() {
    echo "install.sh: $1" >&2
    exit 1
}

case "$(uname -s) $(uname -m)" in
    "Linux x86_64") system=x86_64-unknown-linux-gnu ;;
    "Linux aarch64" | "Linux arm64") system=aarch64-unknown-linux-gnu ;;
    "Darwin arm64") system=aarch64-apple-darwin ;;
    *) fail "there is no release for $(uname -s) on $(uname -m): build it with \`cargo install --path host-cli\`" ;;
esac

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
trap 'exit 1' HUP INT TERM

fetch() {
    curl --fail --silent --show-error --location --output "$work/$1" "$release/$1" ||
        fail "cannot fetch $release/$1"
}

fetch SHA256SUMS
archive=$(sed -n "s/^[0-9a-f]*  *\*\{0,1\}\(shellcal-[^ /]*-$system\.tar\.gz\)\$/\1/p" "$work/SHA256SUMS")
[ -n "$archive" ] || fail "the release has no archive for $system"
[ "$(printf '%s\n' "$archive" | wc -l)" -eq 1 ] || fail "the release has several archives for $system"
fetch "$archive"

wanted=$(sed -n "s/^\([0-9a-f]*\)  *\*\{0,1\}$archive\$/\1/p" "$work/SHA256SUMS")
if command -v sha256sum >/dev/null; then
    found=$(sha256sum "$work/$archive")
else
    found=$(shasum -a 256 "$work/$archive")
fi
[ "${found%% *}" = "$wanted" ] || fail "$archive is damaged: its checksum is ${found%% *}, expected $wanted"

tar -xzf "$work/$archive" -C "$work"
from=$work/${archive%.tar.gz}
"$from/shellcal" --version >/dev/null || fail "the program does not run on this system"

put() {
    mkdir -p "$prefix/$2"
    cp "$1" "$prefix/$2/$3.new"
    mv -f "$prefix/$2/$3.new" "$prefix/$2/$3"
}

put "$from/shellcal" bin shellcal
put "$from/completions/shellcal.bash" share/bash-completion/completions shellcal
put "$from/completions/_shellcal" share/zsh/site-functions _shellcal
put "$from/completions/shellcal.fish" share/fish/vendor_completions.d shellcal.fish
for page in "$from"/man/*.1; do
    put "$page" share/man/man1 "${page##*/}"
done
put "$from/THIRD-PARTY.txt" share/doc/shellcal THIRD-PARTY.txt

"$prefix/bin/shellcal" --version
echo "installed as $prefix/bin/shellcal" >&2
case ":$PATH:" in
    *":$prefix/bin:"*) ;;
    *) echo "put $prefix/bin on the path: export PATH=\"$prefix/bin:\$PATH\"" >&2 ;;
esac
