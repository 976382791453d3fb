//! The CMSDK UART (Arm DDI0479, chapter 4), by interrupts and a pipe each way.
//!
//! QEMU does not pace it by the baud rate. A host that does not read holds the sender up, as CTS
//! would.

use crate::orders;
use crate::registers::Block;
use core::convert::Infallible;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embedded_io_async::{ErrorType, Read, Write};

const DATA: usize = 0x00;
const STATE: usize = 0x04;
const CONTROL: usize = 0x08;
const INTERRUPT_CLEAR: usize = 0x0C;
const BAUD_DIVIDER: usize = 0x10;

const TX_FULL: u32 = 1 << 0;
const RX_FULL: u32 = 1 << 1;
const TX_INTERRUPT: u32 = 1 << 0;
const RX_INTERRUPT: u32 = 1 << 1;
/// Sender and receiver and the interrupts of both.
const ENABLE_ALL: u32 = 0b1111;

static OUT: Pipe<CriticalSectionRawMutex, 256> = Pipe::new();
static IN: Pipe<CriticalSectionRawMutex, 256> = Pipe::new();

/// Starts the device.
pub(crate) fn start(clock_hz: u32, baud: u32) -> (Sender, Receiver) {
    Block::UART0.write(BAUD_DIVIDER, clock_hz / baud);
    Block::UART0.write(CONTROL, ENABLE_ALL);
    (Sender, Receiver::default())
}

/// Serves the interrupt of the sender.
pub(crate) fn on_sent() {
    Block::UART0.write(INTERRUPT_CLEAR, TX_INTERRUPT);
    critical_section::with(|_| fill());
}

/// Serves the interrupt of the receiver. What finds the pipe full is lost, and the decoder will say so.
pub(crate) fn on_received() {
    Block::UART0.write(INTERRUPT_CLEAR, RX_INTERRUPT);
    while Block::UART0.read(STATE) & RX_FULL != 0 {
        _ = IN.try_write(&[Block::UART0.read(DATA) as u8]);
    }
}

/// Hands the device as much as it takes; within a critical section, for the interrupt does too.
fn fill() {
    let mut byte = [0];
    while Block::UART0.read(STATE) & TX_FULL == 0 && OUT.try_read(&mut byte).is_ok() {
        Block::UART0.write(DATA, u32::from(byte[0]));
    }
}

pub(crate) struct Sender;

impl ErrorType for Sender {
    type Error = Infallible;
}

impl Write for Sender {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let count = OUT.write(bytes).await;
        critical_section::with(|_| fill());
        Ok(count)
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// What was ordered before the start, then what arrives.
#[derive(Default)]
pub(crate) struct Receiver {
    ordered: usize,
}

impl ErrorType for Receiver {
    type Error = Infallible;
}

impl Read for Receiver {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        match orders::read(self.ordered, buffer) {
            0 => Ok(IN.read(buffer).await),
            count => {
                self.ordered += count;
                Ok(count)
            }
        }
    }
}
