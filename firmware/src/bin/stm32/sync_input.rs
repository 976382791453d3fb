//! Edges at the sync input, with the time at which they are seen.
//!
//! A task of its own waits for them, on an executor whose interrupt goes before all other tasks: an edge is stamped
//! while frames are taken and converted. It is late by two interrupts and, where a critical section is under
//! way, by that: some µs, and 25 ms while a page of the flash is erased. A test on the model holds it to 20 µs.

use embassy_stm32::exti::ExtiInput;
use embassy_stm32::mode::Async;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::{Duration, Instant, Timer};
use firmware::{SeenEdge, SyncInput};

/// Edges that can wait to be taken.
const WAITING: usize = 8;

/// Edges without room that are counted before the input is deaf for a time: what is at it then is no signal, and
/// the core has other things to do.
const MOST_MISSED: u16 = 256;

/// How long it is deaf.
const REST: Duration = Duration::from_millis(10);

static SEEN: Channel<CriticalSectionRawMutex, SeenEdge, WAITING> = Channel::new();

/// Stamps edges.
#[embassy_executor::task]
pub(crate) async fn stamp(mut input: ExtiInput<'static, Async>) {
    let mut missed = 0;
    loop {
        input.wait_for_rising_edge().await;
        let at_us = Instant::now().as_micros();
        if SEEN.try_send(SeenEdge { at_us, missed }).is_ok() {
            missed = 0;
            continue;
        }
        missed = missed.saturating_add(1);
        if missed.is_multiple_of(MOST_MISSED) {
            Timer::after(REST).await;
        }
    }
}

/// The edges that have been stamped.
pub(crate) struct StampedEdges;

impl SyncInput for StampedEdges {
    async fn next_edge(&mut self) -> SeenEdge {
        SEEN.receive().await
    }
}
