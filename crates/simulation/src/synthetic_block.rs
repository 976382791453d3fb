//! Rows of the sensor model in memory, as a log reader would hand them over.

use crate::sensor_model::{RecordingKind, RecordingSettings, SensorRecording};
use shell_data::block::Block;
use shell_data::wrench::Axis;

/// About what the log reader hands over at once.
const BLOCK_ROWS: usize = 6_000;

/// The first `rows` rows that `shellcal synth train` makes by default.
///
/// # Panics
/// Never: these settings are valid.
pub fn training(rows: usize) -> Vec<Block> {
    let recording = SensorRecording::new(RecordingSettings::new(RecordingKind::Training));
    blocks(recording.expect("valid settings"), rows)
}

/// The first `rows` rows of a recording.
pub fn blocks(recording: SensorRecording, rows: usize) -> Vec<Block> {
    let mut samples = recording.take(rows);
    let mut blocks = Vec::new();
    for start in (0..rows).step_by(BLOCK_ROWS) {
        let mut block = Block {
            readings: vec![Vec::new(); 8],
            wrench: vec![Vec::new(); Axis::ALL.len()],
            ..Block::default()
        };
        for sample in samples.by_ref().take(BLOCK_ROWS.min(rows - start)) {
            block.rows += 1;
            for (column, reading) in block.readings.iter_mut().zip(sample.frame.readings) {
                column.push(f64::from(reading));
            }
            for (column, component) in block.wrench.iter_mut().zip(sample.wrench) {
                column.push(component);
            }
        }
        blocks.push(block);
    }
    blocks
}
