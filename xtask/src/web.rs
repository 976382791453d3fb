//! The page that fits and converts in a browser. It is one file, and works from any folder. It
//! contains the module and the example data, compressed, and its Content-Security-Policy lists the
//! hashes of its scripts and styles.

use std::fs;
use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use flate2::Compression;
use flate2::write::GzEncoder;
use sha2::{Digest, Sha256};
use zopfli::Options;

use crate::compiler::PAGE_TARGET;
use crate::need;
use crate::steps::{self, scratch, target, workspace};

/// Largest page, compressed, bytes.
const LIMIT: usize = 1_900_000;

pub(crate) fn build() -> Result<PathBuf> {
    let compiler = need::compiler(PAGE_TARGET)?;
    let arguments = ["build", "--profile", "web", "--package", "shellcal-web", "--lib"];
    let mut cargo = compiler.cargo(&arguments);
    cargo.env("RUSTFLAGS", "-C target-feature=+simd128");
    steps::run("module of the page", &mut cargo)?;
    let module = target().join(PAGE_TARGET).join("web/shellcal_web.wasm");
    let read = |path: &str| {
        let path = workspace().join(path);
        fs::read_to_string(&path).with_context(|| format!("cannot read `{}`", path.display()))
    };
    let data = |bytes: &[u8]| Ok::<_, anyhow::Error>(base64(&pack(bytes)?));
    let example =
        |name: &str| data(read(&format!("calibration-data/synthetic-{name}.csv"))?.as_bytes());
    let style = read("crates/report/assets/report.css")? + &read("web/page/page.css")?;
    let script = ["host-cli/assets/live/live.js", "web/page/page.js", "web/page/board.js"];
    let script = script.map(read).into_iter().collect::<Result<String>>()?;
    let mut page = read("web/page/index.html")?;
    for (place, content) in [
        ("{script-hash}", hash(&script)),
        ("{style-hash}", hash(&style)),
        ("{module}", data(&fs::read(&module)?)?),
        ("{train}", example("train")?),
        ("{test}", example("test")?),
        ("{worker}", read("web/page/worker.js")?),
        ("{view}", read("host-cli/assets/live/view.html")?),
        ("{live-style}", read("host-cli/assets/live/live.css")?),
        ("{script}", script),
        ("{style}", style),
    ] {
        ensure!(page.contains(place), "the page has no place for `{place}`");
        page = page.replacen(place, &content, 1);
    }
    let file = scratch("web")?.join("shellcal.html");
    fs::write(&file, &page)?;
    let sent = gzip(page.as_bytes())?.len();
    println!("{}: {} bytes, {sent} compressed", file.display(), page.len());
    ensure!(sent <= LIMIT, "the page takes {sent} bytes compressed, more than {LIMIT}");
    Ok(file)
}

/// Returns the policy source that allows exactly this text.
fn hash(text: &str) -> String {
    format!("'sha256-{}'", base64(&Sha256::digest(text)))
}

/// Compresses as far as gzip can, which takes seconds.
fn pack(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut packed = Vec::new();
    zopfli::compress(Options::default(), zopfli::Format::Gzip, bytes, &mut packed)?;
    Ok(packed)
}

fn gzip(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(bytes)?;
    Ok(packed.finish()?)
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let bits = three.iter().fold(0, |bits, &byte| bits << 8 | u32::from(byte))
            << (24 - 8 * three.len());
        for position in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * position) & 63) as usize];
            text.push(if position <= three.len() { digit.into() } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::base64;

    /// RFC 4648, section 10.
    #[test]
    fn texts_equal_those_of_the_standard() {
        let texts = ["", "f", "fo", "foo", "foob", "fooba", "foobar"];
        let encoded = ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy"];
        assert_eq!(texts.map(|text| base64(text.as_bytes())), encoded);
    }
}
