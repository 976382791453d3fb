//! Eight emitters, and the inputs of the converter that look at them.
#![expect(unsafe_code, reason = "two codes are read from the system memory")]

use super::converter::{Converter, light};
use embassy_stm32::adc::AdcChannel;
use embassy_stm32::pac;
use embassy_stm32::peripherals::ADC1;
use firmware::{Factory, FrontEnd};
use shared_proto::{CHANNELS, Vitals};

/// Conversions of reference and of thermometer, which together take less than [`firmware::VITALS_US`].
const VITAL_CONVERSIONS: u8 = 4;

/// Inputs of the converter, by their numbers.
pub(crate) struct Inputs {
    pub(crate) channels: [u8; CHANNELS],
    pub(crate) reference: u8,
    pub(crate) thermometer: u8,
}

/// The number of an input that is ready to be converted.
pub(crate) fn input_number(input: impl AdcChannel<ADC1>) -> u8 {
    input.degrade_adc().get_hw_channel()
}

/// Photointerrupters on ADC1.
pub(crate) struct Photointerrupters {
    converter: Converter,
    inputs: Inputs,
    factory: Factory,
}

impl Photointerrupters {
    /// With emitters that are off.
    pub(crate) fn new(converter: Converter, inputs: Inputs) -> Self {
        Self { converter, inputs, factory: factory_codes() }
    }
}

impl FrontEnd for Photointerrupters {
    fn light(&mut self, channel: Option<usize>) {
        (0..CHANNELS).for_each(|emitter| light(emitter as u8, channel == Some(emitter)));
    }

    async fn sum(&mut self, settling_us: u16, channel: usize, conversions: u8) -> u32 {
        match self.inputs.channels.get(channel) {
            Some(&input) => self.converter.sum(input, conversions, settling_us).await,
            None => 0,
        }
    }

    async fn expose(&mut self, settling_us: u16, channel: usize, conversions: u8) -> [u32; 3] {
        let input = self.inputs.channels.get(channel).copied().zip(u8::try_from(channel).ok());
        let Some((input, emitter)) = input else { return [0; 3] };
        self.converter.expose(input, emitter, conversions, settling_us).await
    }

    /// The first conversion comes right after those of a frame, so that none is thrown away.
    async fn vitals(&mut self) -> Vitals {
        let Inputs { reference, thermometer, .. } = self.inputs;
        let reference = self.converter.sum(reference, VITAL_CONVERSIONS, 0).await;
        let thermometer = self.converter.sum(thermometer, VITAL_CONVERSIONS, 0).await;
        self.factory.vitals(reference, thermometer, VITAL_CONVERSIONS)
    }
}

/// Codes of the thermometer at 30 °C and at 130 °C (DS11451, table "Temperature sensor calibration
/// values").
const COLD: *const u16 = 0x1FFF_75A8 as *const u16;
const HOT: *const u16 = 0x1FFF_75CA as *const u16;

/// What the factory has written into the chip about its thermometer and its reference.
fn factory_codes() -> Factory {
    // SAFETY: both addresses are in the system memory of this chip, which can always be read.
    let (cold, hot) = unsafe { (COLD.read_volatile(), HOT.read_volatile()) };
    Factory { reference: pac::VREFINTCAL.data().read(), cold, hot }
}
