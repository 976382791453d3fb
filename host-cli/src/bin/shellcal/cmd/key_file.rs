//! A key in a file: 32 hexadecimal digits in a line.

use std::fs;
use std::io::Write;
use std::path::Path;

use anyhow::{Context, bail};
use output_file::Outputs;
use shared_proto::Key;

/// Makes a key of random bytes and writes it, for nobody but the user to read.
pub(super) fn make(path: &Path, outputs: &Outputs) -> anyhow::Result<Key> {
    if path.exists() {
        bail!("`{}` is there: a key that is lost locks a board", path.display());
    }
    let mut bytes = [0; Key::LEN];
    getrandom::fill(&mut bytes).context("the system gives no random bytes")?;
    let key = Key::new(bytes).context("the system gives no random bytes")?;
    let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    let mut file = outputs.create(path)?;
    file.write_all(format!("{digits}\n").as_bytes())?;
    file.commit()?;
    hide(path).with_context(|| format!("cannot keep `{}` from others", path.display()))?;
    Ok(key)
}

/// Reads a key.
pub(super) fn read(path: &Path) -> anyhow::Result<Key> {
    let text =
        fs::read_to_string(path).with_context(|| format!("cannot read `{}`", path.display()))?;
    parse(text.trim()).with_context(|| {
        format!("`{}` is no key, which is {} hexadecimal digits", path.display(), 2 * Key::LEN)
    })
}

fn parse(text: &str) -> Option<Key> {
    let digits = text.bytes().map(|digit| char::from(digit).to_digit(16).map(|it| it as u8));
    let digits: Vec<u8> = digits.collect::<Option<_>>()?;
    let (pairs, []) = digits.as_chunks::<2>() else { return None };
    let bytes: Vec<u8> = pairs.iter().map(|[high, low]| high << 4 | low).collect();
    Key::new(bytes.try_into().ok()?)
}

#[cfg(unix)]
fn hide(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    fs::set_permissions(path, fs::Permissions::from_mode(0o600))
}

/// Elsewhere files are those of the user's folder.
#[cfg(not(unix))]
fn hide(_: &Path) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_thirty_two_digits_that_are_not_all_zero() {
        let key = parse("000102030405060708090a0B0c0D0e0F").unwrap();
        assert_eq!(key.bytes()[10..], [10, 11, 12, 13, 14, 15]);
        let long = "1".repeat(33);
        for bad in ["", "12", &long, "g00102030405060708090a0b0c0d0e0f", &"0".repeat(32)] {
            assert!(parse(bad).is_none(), "{bad}");
        }
    }
}
