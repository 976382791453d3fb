//! Streaming: from a file to chunks of whole lines, and from chunks to results on several threads.

pub(crate) mod bytes;
pub(crate) mod chunk;
pub(crate) mod clock_turns;
pub(crate) mod companion;
pub(crate) mod piece;
pub mod pipeline;
pub(crate) mod source;
pub(crate) mod table_rows;
mod text_rows;
mod text_stream;
mod utf16;
