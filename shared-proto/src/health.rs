//! What a board says of itself while it streams: when its readings are taken, and how it is.

use crate::CHANNELS;
use crate::bytes::Bytes;
use crate::field::{Field, Reader, fields};

/// When the readings of a frame are taken, after the time that its sample says.
///
/// A board has one converter, so its channels are read one after the other. A reading is the light at
/// the middle of its lit conversions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timing {
    /// From the start of the frame to the reading of the first channel, in µs.
    pub first_us: u16,
    /// From the reading of one channel to that of the next, in µs.
    pub step_us: u16,
}

/// Temperature and supply of a board, as far as it can measure them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Vitals {
    /// Temperature of the chip in hundredths of a degree Celsius.
    pub temperature_cdeg: Option<i16>,
    /// Supply of the converter in mV.
    pub supply_mv: Option<u16>,
    /// Reading of the chip's voltage reference, in counts.
    pub reference: Option<u16>,
}

/// Sent before the first sample of a stream, before the first with other settings, and once a second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Health {
    /// Number of the sample that follows.
    pub sequence: u16,
    /// The board's clock, as in samples.
    pub clock_us: u32,
    /// When readings are taken, from the sample that follows on.
    pub timing: Timing,
    /// Temperature and supply.
    pub vitals: Vitals,
    /// What the channels read with their emitters off, in counts.
    pub dark: [u16; CHANNELS],
}

fields!(Timing { first_us, step_us });

/// For a temperature that is not known.
const NO_TEMPERATURE: i16 = i16::MIN;

impl Field for Vitals {
    fn write<const N: usize>(&self, out: &mut Bytes<N>) {
        self.temperature_cdeg.unwrap_or(NO_TEMPERATURE).write(out);
        [self.supply_mv, self.reference].map(Option::unwrap_or_default).write(out);
    }

    fn read(body: &mut Reader<'_>) -> Option<Self> {
        let temperature = body.get()?;
        let [supply, reference] = body.get()?;
        Some(Self {
            temperature_cdeg: (temperature != NO_TEMPERATURE).then_some(temperature),
            supply_mv: (supply != 0).then_some(supply),
            reference: (reference != 0).then_some(reference),
        })
    }
}

impl Health {
    pub(crate) fn write<const N: usize>(&self, out: &mut Bytes<N>) {
        self.clock_us.write(out);
        self.timing.write(out);
        self.vitals.write(out);
        self.dark.write(out);
    }

    /// What a newer board adds is not looked at.
    pub(crate) fn read(sequence: u16, mut body: Reader<'_>) -> Option<Self> {
        let (clock_us, timing) = (body.get()?, body.get()?);
        Some(Self { sequence, clock_us, timing, vitals: body.get()?, dark: body.get()? })
    }
}
