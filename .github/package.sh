#!/usr/bin/env bash
# What a release consists of, in target/package: an archive with the program, its manual, completions and the
# licences of all that it is made of; and, where dpkg-deb is, a package of Debian.
#
#   .github/package.sh [TARGET]
#
# SHELLCAL_PROGRAM names a program that is packed in place of one built for release.
set -euo pipefail
cd "$(dirname "$0")/.."

host=$(rustc -vV | sed -n 's/^host: //p')
system=${1:-$host}
target=${CARGO_TARGET_DIR:-target}
suffix=$([[ $system == *windows* ]] && echo .exe || true)
program=${SHELLCAL_PROGRAM:-}
if [[ -z $program ]]; then
    cargo build --release --locked --package shellcal ${1:+--target "$1"}
    program=$target/${1:+$1/}release/shellcal$suffix
fi
version=$("$program" --version | cut -d' ' -f2 | tr -d '\r')
name=shellcal-$version-$system
staged=$target/package/$name

rm -rf "$staged" && mkdir -p "$staged/linux"
cp "$program" "$staged/shellcal$suffix"
cp README.md CHANGELOG.md LICENSE-APACHE LICENSE-MIT "$staged"
cp host-cli/assets/linux/60-shellcal.rules "$staged/linux"
cargo xtask manual "$staged"

# The packages of the program, with the licences that lie in their folders; those of other systems may not be here.
{
    printf '%s\n\n' "shellcal is made of these packages:"
    cat host-cli/assets/licences.tsv
    registry=${CARGO_HOME:-$HOME/.cargo}/registry/src
    cut -f 1,2 host-cli/assets/licences.tsv | while read -r crate version; do
        for folder in "$registry"/*/"$crate-$version"; do
            [[ -d $folder ]] || continue
            find "$folder" -maxdepth 1 -type f \
                \( -iname 'licen[cs]e*' -o -iname 'copying*' -o -iname 'notice*' -o -iname 'unlicense*' \) |
                sort | while read -r text; do
                printf '\n%.80s\n%s %s\n\n' "$(printf -- '-%.0s' {1..80})" "$crate" "$version"
                cat "$text"
            done
        done
    done
    printf '\n%s\n' "The plotting library of reports is plotly.js, the font of pictures DejaVu Sans:"
    cat crates/report/assets/plotly-LICENSE.txt crates/figures/assets/DejaVu-LICENSE.txt
} > "$staged/THIRD-PARTY.txt"

if [[ $system == *windows* ]]; then
    (cd "$target/package" && rm -f "$name.zip" && 7z a -bso0 "$name.zip" "$name")
else
    tar -czf "$staged.tar.gz" -C "$target/package" "$name"
fi

[[ $system == *linux* ]] && command -v dpkg-deb > /dev/null || exit 0
architecture=$([[ $system == aarch64* ]] && echo arm64 || echo amd64)
tree=$target/package/deb
rm -rf "$tree" && mkdir -p "$tree/DEBIAN"
put() { install -D --mode 644 "$staged/$1" "$tree/$2"; }
put shellcal usr/bin/shellcal && chmod 755 "$tree/usr/bin/shellcal"
put linux/60-shellcal.rules usr/lib/udev/rules.d/60-shellcal.rules
put completions/shellcal.bash usr/share/bash-completion/completions/shellcal
put completions/_shellcal usr/share/zsh/vendor-completions/_shellcal
put completions/shellcal.fish usr/share/fish/vendor_completions.d/shellcal.fish
for page in "$staged"/man/*; do put "man/${page##*/}" "usr/share/man/man1/${page##*/}"; done
for text in THIRD-PARTY.txt LICENSE-APACHE; do put "$text" "usr/share/doc/shellcal/$text"; done
put LICENSE-MIT usr/share/doc/shellcal/copyright
cat > "$tree/DEBIAN/control" <<END
Package: shellcal
Version: $version
Architecture: $architecture
Section: science
Priority: optional
Maintainer: shellcal <https://github.com/shellcal/shellcal>
Homepage: https://github.com/shellcal/shellcal
Depends: libc6 (>= 2.35), libgcc-s1
Description: calibration and trial processing for an optical force/torque shell
 Fits calibrations of an optical six-axis force/torque sensor, records from its board,
 converts logs to forces and moments, and evaluates trials of robots that carry it.
END
dpkg-deb --root-owner-group --build "$tree" "$target/package/shellcal_${version}_$architecture.deb"
