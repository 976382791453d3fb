//! Figures: data in, a finished picture out, as SVG text, PDF or PNG bytes.
//!
//! Data flows in block by block into accumulators of fixed size ([`FitPlot`], [`WrenchTrace`]),
//! so a picture of ten million rows costs the memory and the file size of one of
//! ten thousand. Accumulators find their own ranges, and what they hold does not depend on how the
//! rows were split into blocks or in which order parts were merged. The drawing is deterministic
//! to the byte.
//!
//! Only what this program draws is here: no general plotting library, no files. Text in the SVG
//! stays text (DejaVu Sans where the viewer has it, another sans-serif where not); for PDF and PNG the font
//! is part of the program.

mod beam_channel;
mod bins;
mod canvas;
mod chart;
mod coverage;
mod density;
mod figure;
mod fit;
mod histogram;
mod legend;
mod lettering;
mod matching;
mod palette;
mod panel;
mod path;
mod pdf;
mod pixels;
mod plateau;
mod scale;
mod size;
mod svg;
mod trace;
pub mod trial;

use std::io::Read;

use ruzstd::decoding::StreamingDecoder;

pub use beam_channel::{ChannelCurve, channel_figure};
pub use canvas::Figure;
pub use chart::{Chart, ChartMark, Series};
pub use coverage::coverage_figure;
pub use figure::{Format, PlotError};
pub use fit::{FitPlot, fit_figure};
pub use matching::match_figure;
pub use scale::{PlotAxis, Spacing};
pub use size::Size;
pub use trace::{WrenchTrace, trace_figure};

/// The content of an asset that stands in the program compressed, by Zstandard.
pub fn decompressed(asset: &[u8]) -> Vec<u8> {
    let mut content = Vec::new();
    let read = StreamingDecoder::new(asset).ok().map(|mut asset| asset.read_to_end(&mut content));
    assert!(matches!(read, Some(Ok(_))), "an asset of the program is as it was put there");
    content
}
