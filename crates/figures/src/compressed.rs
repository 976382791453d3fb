//! Assets that stand in the program compressed, by Zstandard.

use std::io::Read;

use ruzstd::decoding::StreamingDecoder;

/// The content of an asset.
pub fn content(asset: &[u8]) -> Vec<u8> {
    let mut content = Vec::new();
    let read = StreamingDecoder::new(asset).ok().map(|mut asset| asset.read_to_end(&mut content));
    assert!(matches!(read, Some(Ok(_))), "an asset of the program is as it was put there");
    content
}
