//! Compressed parts of files, unpacked to a length that is known or bounded.

use std::io::Read;

use ruzstd::decoding::StreamingDecoder;

/// How a part is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Codec {
    None,
    Snappy,
    Gzip,
    /// A block without a frame.
    Lz4Block,
    Lz4Frame,
    Zstd,
}

/// Unpacks `packed`, which makes `size` bytes. The caller has checked that size.
pub(crate) fn unpack(codec: Codec, packed: &[u8], size: usize) -> Result<Vec<u8>, String> {
    let unpacked = match codec {
        Codec::None => packed.to_vec(),
        Codec::Snappy => {
            let length = snap::raw::decompress_len(packed).map_err(|error| error.to_string())?;
            if length != size {
                return Err(format!("{length} bytes, expected {size}"));
            }
            let mut decoder = snap::raw::Decoder::new();
            decoder.decompress_vec(packed).map_err(|error| error.to_string())?
        }
        Codec::Lz4Block => {
            lz4_flex::block::decompress(packed, size).map_err(|error| error.to_string())?
        }
        Codec::Gzip => read(flate2::bufread::MultiGzDecoder::new(packed), size)?,
        Codec::Lz4Frame => read(lz4_flex::frame::FrameDecoder::new(packed), size)?,
        Codec::Zstd => {
            let decoder = StreamingDecoder::new(packed).map_err(|error| error.to_string())?;
            read(decoder, size)?
        }
    };
    match unpacked.len() == size {
        true => Ok(unpacked),
        false => Err(format!("{} bytes, expected {size}", unpacked.len())),
    }
}

/// Reads one byte more than there may be, at most.
fn read(stream: impl Read, size: usize) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let mut stream = stream.take(size as u64 + 1);
    stream.read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    Ok(bytes)
}
