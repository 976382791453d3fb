//! The loops of the firmware: sample, send, receive.

use crate::acquisition::{acquire, illuminate};
use crate::baud::Baud;
use crate::board::{Chip, Clock, FrontEnd, Storage, SyncInput, Watchdog};
use crate::core::{Core, HealthDue, OnLine};
use crate::last_words::LastWords;
use crate::limits::{Limits, Line};
use crate::line::Change;
use crate::link::Link;
use core::cell::RefCell;
use embassy_futures::join::join4;
use embassy_futures::select::select;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embedded_io_async::{Read, Write};
use shared_proto::{Decoder, Event, Identity, ResetCause, Vitals};

/// Longest time between two feedings of the watchdog, in µs.
const FEED_US: u64 = 250_000;

/// Pause after an error of the receiver, so that a line that is stuck does not take all the time.
const RETRY_US: u64 = 10_000;

/// Everything that [`run`] needs.
#[derive(Debug)]
pub struct Parts<F, C, R, W, S, D, I, H> {
    /// Emitters and converter.
    pub front_end: F,
    /// Time.
    pub clock: C,
    /// From the host.
    pub receiver: R,
    /// To the host.
    pub sender: W,
    /// For the calibration.
    pub storage: S,
    /// Resets the board if frames stop being taken.
    pub watchdog: D,
    /// For the edges of a signal that another recorder has, too.
    pub sync_input: I,
    /// The rate of the line, and the bootloader.
    pub chip: H,
    /// How the XBee is set.
    pub link: Link,
    /// What the board says it is.
    pub identity: Identity,
    /// Why it has started.
    pub reset_cause: ResetCause,
    /// What it said before, if that is why.
    pub last_words: LastWords,
    /// Random bytes, new at every start, that signatures are made with; without them a board that has a
    /// key takes no signed command.
    pub nonce: Option<[u8; 8]>,
    /// The rate of the serial line; `None` if it has none and is never the bottleneck.
    pub rate: Option<Baud>,
}

type Wake = Signal<NoopRawMutex, ()>;

/// Runs the board. Never comes back.
///
/// The core is borrowed only between two waits, so the loops never meet in it.
pub async fn run<F, C, R, W, S, D, I, H>(parts: Parts<F, C, R, W, S, D, I, H>)
where
    F: FrontEnd,
    C: Clock,
    R: Read,
    W: Write,
    S: Storage,
    D: Watchdog,
    I: SyncInput,
    H: Chip,
{
    let Parts {
        front_end, clock, receiver, sender, mut storage, watchdog, sync_input, chip, ..
    } = parts;
    let limits = Limits {
        min_period_us: parts.identity.min_period_us,
        conversion_ns: F::CONVERSION_NS,
        tolerance_us: C::TOLERANCE_US,
        line: Line { bytes_per_s: parts.rate.map(Baud::bytes_per_s), link: parts.link },
        rates: H::RATES,
        has_bootloader: H::HAS_BOOTLOADER,
    };
    let Parts { identity, reset_cause, last_words, nonce, .. } = parts;
    let core =
        Core::new(identity, reset_cause, last_words, limits, parts.rate, nonce, &mut storage);
    let core = RefCell::new(core);
    let (changed, outgoing) = (Wake::new(), Wake::new());
    join4(
        sample(front_end, watchdog, &clock, &core, &changed, &outgoing),
        send(sender, chip, parts.link, &clock, &core, &outgoing),
        receive(receiver, storage, parts.link, &clock, &core, (&changed, &outgoing)),
        listen(sync_input, &core, &outgoing),
    )
    .await;
}

/// Takes frames at their slots while streaming. Only this loop feeds the watchdog: with a link that is
/// held up the board is well, but not with a converter that does not answer.
async fn sample<F: FrontEnd, C: Clock, D: Watchdog>(
    mut front_end: F,
    mut watchdog: D,
    clock: &C,
    core: &RefCell<Core>,
    changed: &Wake,
    outgoing: &Wake,
) {
    front_end.light(None);
    loop {
        watchdog.feed();
        let test = core.borrow_mut().take_self_test();
        if let Some(test) = test {
            let settings = core.borrow_mut().settings();
            let emitter = usize::from(test.emitter);
            let rise = illuminate(&mut front_end, clock, &settings, emitter).await;
            core.borrow_mut().finish_self_test(&test, rise);
            outgoing.signal(());
            continue;
        }
        let now_us = clock.now_us();
        if core.borrow_mut().gives_up_rate(now_us) {
            outgoing.signal(());
        }
        let slot_us = core.borrow_mut().next_slot(now_us);
        let until_us = slot_us.unwrap_or(u64::MAX).min(now_us + FEED_US);
        if until_us > now_us {
            select(clock.wait_until_us(until_us), changed.wait()).await;
            // Whatever woke us, the slot may have moved, or be late by now.
            if core.borrow_mut().next_slot(clock.now_us()) != slot_us {
                continue;
            }
        }
        let start_us = clock.now_us();
        if slot_us.is_none_or(|slot_us| start_us < slot_us) {
            continue;
        }
        let settings = core.borrow_mut().begin_frame();
        let frame = acquire(&mut front_end, clock, &settings).await;
        let end_us = clock.now_us();
        let health = core.borrow_mut().health_due(end_us);
        let vitals = match health {
            Some(HealthDue::Measured) => Some(front_end.vitals().await),
            Some(HealthDue::InHaste) => Some(Vitals::default()),
            None => None,
        };
        core.borrow_mut().finish_frame(&frame, start_us, end_us, vitals);
        outgoing.signal(());
    }
}

/// Sends what is in the outbox. An error of the line costs the frame, and the host sees the gap.
async fn send<W: Write, C: Clock, H: Chip>(
    mut sender: W,
    mut chip: H,
    link: Link,
    clock: &C,
    core: &RefCell<Core>,
    outgoing: &Wake,
) {
    loop {
        let next = core.borrow_mut().next_on_line();
        match next {
            Some(OnLine::Frame(frame)) => _ = link.send(&frame, &mut sender).await,
            Some(OnLine::Change(change)) => {
                _ = sender.flush().await;
                match change {
                    Change::Rate(rate) => chip.set_baud(rate).await,
                    Change::Bootloader => chip.start_bootloader().await,
                }
                core.borrow_mut().line_changed(clock.now_us());
            }
            None => outgoing.wait().await,
        }
    }
}

/// Hands on the edges at the sync input.
async fn listen<I: SyncInput>(mut sync_input: I, core: &RefCell<Core>, outgoing: &Wake) {
    loop {
        let edge = sync_input.next_edge().await;
        core.borrow_mut().take_edge(edge);
        outgoing.signal(());
    }
}

/// Does what arrives.
async fn receive<R: Read, C: Clock, S: Storage>(
    mut receiver: R,
    mut storage: S,
    link: Link,
    clock: &C,
    core: &RefCell<Core>,
    (changed, outgoing): (&Wake, &Wake),
) {
    let mut decoder = Decoder::new(link.framing());
    let mut bytes = [0; 64];
    loop {
        let received = match receiver.read(&mut bytes).await {
            Ok(count) if count > 0 => bytes.get(..count).unwrap_or_default(),
            _ => {
                clock.wait_until_us(clock.now_us() + RETRY_US).await;
                continue;
            }
        };
        decoder.feed(received, |event| match event {
            Event::Command { number, to, command, signature } => {
                let (now_us, signature) = (clock.now_us(), signature.as_ref());
                let mut core = core.borrow_mut();
                core.heard();
                core.command(number, to, &command, signature, now_us, &mut storage);
            }
            Event::OtherVersion { command: true, .. } => core.borrow_mut().refuse_other_version(),
            _ => {}
        });
        let counters = decoder.counters();
        let damaged = counters.bad_crc + counters.malformed + counters.bad_api_frames;
        core.borrow_mut().set_damaged(damaged);
        changed.signal(());
        outgoing.signal(());
    }
}
