//! Decompression of parts of files to a known or bounded length.

use std::error::Error;
use std::io::{self, Read};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Codec {
    None,
    Snappy,
    Gzip,
    Bzip2,
    Lz4Block,
    Lz4Frame,
    Zstd,
}

/// Unpacks `packed` to `size` bytes. The caller must check that size.
pub(crate) fn unpack(codec: Codec, packed: &[u8], size: usize) -> Result<Vec<u8>, Box<dyn Error>> {
    let unpacked = match codec {
        Codec::None => packed.to_vec(),
        Codec::Snappy => {
            let length = snap::raw::decompress_len(packed)?;
            if length != size {
                return Err(format!("{length} bytes, expected {size}").into());
            }
            snap::raw::Decoder::new().decompress_vec(packed)?
        }
        Codec::Lz4Block => lz4_flex::block::decompress(packed, size)?,
        Codec::Gzip => read(flate2::bufread::MultiGzDecoder::new(packed), size)?,
        Codec::Bzip2 => read(bzip2::bufread::BzDecoder::new(packed), size)?,
        Codec::Lz4Frame => read(lz4_flex::frame::FrameDecoder::new(packed), size)?,
        Codec::Zstd => zrip::decompress_with_limit(packed, size)?,
    };
    match unpacked.len() == size {
        true => Ok(unpacked),
        false => Err(format!("{} bytes, expected {size}", unpacked.len()).into()),
    }
}

/// Reads at most one byte more than `size`, so that the caller can detect an excess.
fn read(stream: impl Read, size: usize) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    stream.take(size as u64 + 1).read_to_end(&mut bytes)?;
    Ok(bytes)
}
