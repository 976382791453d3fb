//! The tasks of the firmware, and their shared state.
//!
//! ```text
//! acquire ── samples, health ──▶ ┌──────┐ ── outgoing ──▶ send
//! listen ─── edges ────────────▶ │ Core │
//! receive ── commands ─────────▶ └──────┘ ── changed ───▶ acquire ── alive ──▶ watch
//! ```
//!
//! On a board, each is a task. They share the core, which is never borrowed across an await, and
//! wake each other by signals.

use crate::acquisition::{acquire, illuminate};
use crate::board::{Chip, Clock, FrontEnd, SeenEdge, Storage};
use crate::core::{Core, OnLine};
use crate::line::Change;
use crate::setup::BoardSetup;
use crate::upload::Record;
use core::cell::RefCell;
use embassy_futures::join::join5;
use embassy_futures::select::select;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embedded_io_async::{Read, Write};
use shared_proto::{Answer, Decoder, Event, Framing, Packet, ReceivedPacket, Refusal, Vitals};

const ALIVE_US: u64 = 250_000;

/// Longest wait for the last bytes to leave, µs: two bytes of a driver at 9,600 baud. The receiver
/// of embassy-stm32 0.6 clears the flag that its `flush` waits for, so `flush` may never return.
const DRAIN_US: u64 = 2_500;

/// Pause after a receiver error, so that a stuck line does not use up all the time.
const RETRY_US: u64 = 10_000;

type Wake = Signal<NoopRawMutex, ()>;

pub struct Station<'a, C> {
    core: RefCell<Core<'a>>,
    clock: C,
    changed: Wake,
    outgoing: Wake,
    alive: Wake,
}

impl<'a, C: Clock> Station<'a, C> {
    pub fn new(setup: BoardSetup, clock: C, record: &'a mut Record) -> Self {
        let core = RefCell::new(Core::new(setup, record));
        Self { core, clock, changed: Wake::new(), outgoing: Wake::new(), alive: Wake::new() }
    }

    /// Takes frames at their slots while streaming. Only this task gives signs of life: a stalled
    /// link is no reason for a reset, but a stuck converter is.
    pub async fn acquire<F: FrontEnd>(&self, mut front_end: F) {
        front_end.light(None);
        loop {
            self.alive.signal(());
            let test = self.core.borrow_mut().take_self_test();
            if let Some(test) = test {
                let settings = self.core.borrow().settings;
                let emitter = usize::from(test.emitter);
                let rise = illuminate(&mut front_end, &settings, emitter).await;
                self.core.borrow_mut().finish_self_test(&test, rise);
                self.outgoing.signal(());
            } else if self.next_slot().await {
                self.take_frame(&mut front_end).await;
            }
        }
    }

    /// Waits for the next slot or sign of life; returns true if a frame is due.
    async fn next_slot(&self) -> bool {
        let now_us = self.clock.now_us();
        if self.core.borrow_mut().gives_up_rate(now_us) {
            self.outgoing.signal(());
        }
        let slot_us = self.core.borrow_mut().next_slot(now_us);
        let until_us = slot_us.unwrap_or(u64::MAX).min(now_us + ALIVE_US);
        if until_us > now_us {
            // Changes come before the clock is read again, so that a first frame is at its slot.
            select(self.changed.wait(), self.clock.wait_until_us(until_us)).await;
        }
        // The slot may have moved during the wait, or be late by now.
        let now_us = self.clock.now_us();
        let is_same = self.core.borrow_mut().next_slot(now_us) == slot_us;
        is_same && slot_us.is_some_and(|slot_us| now_us >= slot_us)
    }

    async fn take_frame<F: FrontEnd>(&self, front_end: &mut F) {
        let start_us = self.clock.now_us();
        let (settings, conversion_ns) = self.core.borrow_mut().begin_frame();
        let frame = acquire(front_end, &self.clock, &settings, conversion_ns).await;
        let end_us = self.clock.now_us();
        let health = self.core.borrow_mut().health_due(end_us);
        let vitals = match health {
            Some(true) => Some(front_end.vitals().await),
            Some(false) => Some(Vitals::default()),
            None => None,
        };
        self.core.borrow_mut().finish_frame(&frame, start_us, end_us, vitals);
        self.outgoing.signal(());
    }

    /// Sends the outbox. A line error loses the frame, and the host sees the gap.
    pub async fn send<W: Write, H: Chip<W>>(&self, mut sender: W, mut chip: H) {
        loop {
            let next = self.core.borrow_mut().next_on_line();
            match next {
                Some(OnLine::Frame(frame)) => _ = sender.write_all(&frame).await,
                Some(OnLine::Change(change)) => {
                    let end_us = self.clock.now_us() + DRAIN_US;
                    select(sender.flush(), self.clock.wait_until_us(end_us)).await;
                    match change {
                        Change::Rate(rate) => chip.set_baud(&mut sender, rate).await,
                        Change::Bootloader => chip.start_bootloader().await,
                    }
                    self.core.borrow_mut().line.done(self.clock.now_us());
                }
                None => self.outgoing.wait().await,
            }
        }
    }

    /// Executes incoming commands, after loading the calibration.
    pub async fn receive<R: Read, S: Storage>(&self, mut receiver: R, mut storage: S) {
        self.core.borrow_mut().load(&mut storage);
        let mut decoder = Decoder::new(Framing::Cobs);
        let mut bytes = [0; 64];
        loop {
            let received = match receiver.read(&mut bytes).await {
                Ok(count) if count > 0 => bytes.get(..count).unwrap_or_default(),
                _ => {
                    self.clock.wait_until_us(self.clock.now_us() + RETRY_US).await;
                    continue;
                }
            };
            let mut core = self.core.borrow_mut();
            decoder.feed(received, |event| match event {
                Event::Packet(ReceivedPacket {
                    packet: Packet::Command { number, to, command },
                    ..
                }) => {
                    core.line.heard();
                    core.command(number, to, &command, self.clock.now_us(), &mut storage);
                }
                Event::OtherVersion { command: true, .. } => {
                    // The command's number is unknown.
                    core.outbox.answer(0, Answer::Refused(Refusal::OtherVersion));
                }
                _ => {}
            });
            let counters = decoder.counters;
            core.counts.damaged = (counters.bad_crc + counters.malformed) as u16;
            self.changed.signal(());
            self.outgoing.signal(());
        }
    }

    pub async fn listen(&self, mut next_edge: impl AsyncFnMut() -> SeenEdge) {
        loop {
            let edge = next_edge().await;
            self.core.borrow_mut().outbox.push_edge(edge);
            self.outgoing.signal(());
        }
    }

    /// Feeds the watchdog at every sign of life; the watchdog needs one a second.
    pub async fn watch(&self, mut feed: impl FnMut()) {
        loop {
            feed();
            self.alive.wait().await;
        }
    }

    /// Runs all tasks as one future, for a board without an executor.
    pub async fn run<F: FrontEnd, W: Write, H: Chip<W>, R: Read, S: Storage>(
        &self,
        front_end: F,
        (sender, chip): (W, H),
        (receiver, storage): (R, S),
        next_edge: impl AsyncFnMut() -> SeenEdge,
        feed_watchdog: impl FnMut(),
    ) {
        join5(
            self.acquire(front_end),
            self.send(sender, chip),
            self.receive(receiver, storage),
            self.listen(next_edge),
            self.watch(feed_watchdog),
        )
        .await;
    }
}
