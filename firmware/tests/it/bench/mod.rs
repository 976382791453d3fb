//! A board on the bench: virtual time, a front end that plays codes, and a link that can block.

#![allow(unreachable_pub, reason = "a module of a test has no outside")]

use firmware::{
    Baud, BoardSetup, Chip, Clock, FrontEnd, LastWords, RECORD, Record, SeenEdge, Station, Storage,
    StorageError, baud,
};
use shared_proto::{
    Answer, Board, BoardId, Calibration, Command, Decoder, Event, Framing, Health, Identity,
    MAX_PIECE, Packet, PacketOrigin, Piece, ResetCause, Sample, Values, Vitals, crc32,
};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::future::poll_fn;
use std::pin::Pin;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

#[derive(Default)]
pub struct World {
    now_us: Cell<u64>,
    earliest_us: Cell<u64>,
    /// Dark and lit codes of a channel at a time in µs.
    codes: RefCell<Option<Codes>>,
    pub stall_us: Cell<u64>,
    pub to_board: RefCell<VecDeque<u8>>,
    pub from_board: RefCell<Vec<u8>>,
    /// Edges at the sync input, not yet taken.
    pub edges: RefCell<VecDeque<SeenEdge>>,
    pub rates: RefCell<Vec<Baud>>,
    pub bootloader_at_us: RefCell<Vec<u64>>,
    /// True if clear to send is off.
    pub held_up: Cell<bool>,
    pub record: RefCell<Option<Record>>,
    last_fed_us: Cell<u64>,
    pub longest_unfed_us: Cell<u64>,
    lit: Cell<(Option<usize>, u64)>,
    pub settling_us: Cell<u64>,
    /// Channels are read with other channels' emitters lit.
    pub tests_itself: Cell<bool>,
    pub is_bridged: Cell<bool>,
    pub faults: RefCell<Vec<String>>,
}

type Codes = Box<dyn Fn(usize, u64) -> (u16, u16)>;

impl World {
    async fn wait(&self, at_us: u64) {
        poll_fn(|_| {
            if self.now_us.get() >= at_us {
                return Poll::Ready(());
            }
            self.earliest_us.set(self.earliest_us.get().min(at_us));
            Poll::Pending
        })
        .await;
    }

    fn fault(&self, fault: String) {
        self.faults.borrow_mut().push(fault);
    }
}

struct Shared(Rc<World>);

impl Clock for Shared {
    fn now_us(&self) -> u64 {
        self.0.now_us.get()
    }

    async fn wait_until_us(&self, at_us: u64) {
        self.0.wait(at_us).await;
    }
}

const CONVERSION_NS: u32 = 1_500;

impl FrontEnd for Shared {
    fn light(&mut self, channel: Option<usize>) {
        self.0.lit.set((channel, self.0.now_us.get()));
    }

    async fn sum(&mut self, settling_us: u16, channel: usize, conversions: u8) -> u32 {
        let world = &self.0;
        world.wait(world.now_us.get() + u64::from(settling_us)).await;
        let (lit, since_us) = world.lit.get();
        let now_us = world.now_us.get();
        if lit.is_some_and(|lit| lit != channel) && !world.tests_itself.get() {
            world.fault(format!("channel {channel} converted under emitter {lit:?}"));
        }
        let settled = now_us - since_us >= world.settling_us.get() || (lit, channel) == (None, 0);
        if !settled {
            world.fault(format!("channel {channel} converted {} µs early", now_us - since_us));
        }
        let (dark, bright) = match &*world.codes.borrow() {
            Some(codes) => codes(channel, now_us),
            None => (100, 100 + 100 * (channel as u16 + 1)),
        };
        // The emitter of channel 6 reaches channel 7 if the bridge is closed.
        let is_bridged = world.is_bridged.get() && (lit, channel) == (Some(5), 6);
        let is_lit = lit == Some(channel) || is_bridged;
        let burst_us = (u64::from(conversions) * u64::from(CONVERSION_NS)).div_ceil(1_000);
        world.wait(now_us + burst_us + world.stall_us.take()).await;
        u32::from(if is_lit { bright } else { dark }) * u32::from(conversions)
    }

    /// Reports the seconds since the start as degrees.
    async fn vitals(&mut self) -> Vitals {
        let now_us = self.0.now_us.get();
        self.0.wait(now_us + 100).await;
        let temperature_cdeg = Some((now_us / 10_000) as i16);
        Vitals { temperature_cdeg, supply_mv: Some(3_300), reference: Some(24_080) }
    }
}

impl embedded_io_async::ErrorType for Shared {
    type Error = Infallible;
}

impl embedded_io_async::Read for Shared {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|_| {
            let mut bytes = self.0.to_board.borrow_mut();
            let count = bytes.len().min(buffer.len());
            if count == 0 {
                return Poll::Pending;
            }
            buffer.iter_mut().zip(bytes.drain(..count)).for_each(|(to, from)| *to = from);
            Poll::Ready(Ok(count))
        })
        .await
    }
}

impl embedded_io_async::Write for Shared {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        poll_fn(|_| if self.0.held_up.get() { Poll::Pending } else { Poll::Ready(()) }).await;
        self.0.from_board.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl Shared {
    async fn next_edge(&mut self) -> SeenEdge {
        poll_fn(|_| {
            let now_us = self.0.now_us.get();
            let mut edges = self.0.edges.borrow_mut();
            match edges.front() {
                Some(edge) if edge.at_us <= now_us => {
                    Poll::Ready(edges.pop_front().expect("there is one"))
                }
                Some(edge) => {
                    self.0.earliest_us.set(self.0.earliest_us.get().min(edge.at_us));
                    Poll::Pending
                }
                None => Poll::Pending,
            }
        })
        .await
    }
}

impl Chip<Shared> for Shared {
    async fn set_baud(&mut self, _sender: &mut Shared, rate: Baud) {
        self.0.rates.borrow_mut().push(rate);
    }

    async fn start_bootloader(&mut self) {
        self.0.bootloader_at_us.borrow_mut().push(self.0.now_us.get());
        std::future::pending().await
    }
}

impl Storage for Shared {
    fn load(&mut self, record: &mut Record) {
        *record = self.0.record.borrow().unwrap_or([0xFF; RECORD]);
    }

    fn store(&mut self, record: &Record) -> Result<(), StorageError> {
        *self.0.record.borrow_mut() = Some(*record);
        Ok(())
    }
}

impl Shared {
    fn feed_watchdog(&self) {
        let now_us = self.0.now_us.get();
        let unfed_us = now_us - self.0.last_fed_us.replace(now_us);
        self.0.longest_unfed_us.set(self.0.longest_unfed_us.get().max(unfed_us));
    }
}

pub const LAST_WORDS: &[u8] = b"panicked at a line that has a bug";

pub const SERIAL: [u8; 12] = *b"bench-serial";

pub const START: u16 = 77;

pub struct Bench {
    pub world: Rc<World>,
    board: Pin<Box<dyn Future<Output = ()>>>,
    pub decoder: Decoder,
    /// The addressee of commands.
    pub to: Option<BoardId>,
    number: u16,
}

impl Bench {
    pub fn new() -> Self {
        Self::with(ResetCause::Power, None)
    }

    /// Creates a board on a line with the baud rate after a reset.
    pub fn on_a_line() -> Self {
        Self::build(ResetCause::Power, None, Some(baud::FIRST))
    }

    pub fn with(reset_cause: ResetCause, record: Option<Record>) -> Self {
        Self::build(reset_cause, record, None)
    }

    fn build(reset_cause: ResetCause, record: Option<Record>, rate: Option<Baud>) -> Self {
        let world = Rc::new(World { record: RefCell::new(record), ..World::default() });
        world.settling_us.set(100);
        let shared = {
            let world = Rc::clone(&world);
            move || Shared(Rc::clone(&world))
        };
        let identity = Identity {
            board: Board::Simulated,
            firmware: firmware::VERSION,
            serial: SERIAL,
            min_period_us: 1_000,
        };
        let setup = BoardSetup {
            identity,
            start: START,
            reset_cause,
            last_words: LastWords::from_bytes(LAST_WORDS),
            conversion_ns: CONVERSION_NS,
            rate,
            rates: &baud::RATES,
            has_bootloader: true,
        };
        let board = Box::pin(async move {
            let mut record = [0; RECORD];
            let station = Station::new(setup, shared(), &mut record);
            let watched = shared();
            let feed_watchdog = || watched.feed_watchdog();
            let mut edges = shared();
            let next_edge = async || edges.next_edge().await;
            let (to_host, from_host) = ((shared(), shared()), (shared(), shared()));
            station.run(shared(), to_host, from_host, next_edge, feed_watchdog).await;
        });
        let decoder = Decoder::new(Framing::Cobs);
        let to = Some(BoardId::from_serial(&SERIAL));
        Self { world, board, decoder, to, number: 0 }
    }

    pub fn play(&self, codes: impl Fn(usize, u64) -> (u16, u16) + 'static) {
        *self.world.codes.borrow_mut() = Some(Box::new(codes));
    }

    pub fn now_us(&self) -> u64 {
        self.world.now_us.get()
    }

    pub fn run_for(&mut self, us: u64) {
        let end_us = self.now_us() + us;
        let mut context = Context::from_waker(Waker::noop());
        loop {
            self.world.earliest_us.set(end_us);
            // One task may wake another that was polled before it.
            for _ in 0..2 {
                assert!(self.board.as_mut().poll(&mut context).is_pending());
            }
            if self.now_us() == end_us {
                return;
            }
            self.world.now_us.set(self.world.earliest_us.get());
        }
    }

    /// Returns the health reports, each with the sample that follows it.
    pub fn healths(&mut self) -> Vec<(Health, Option<Sample>)> {
        let mut healths: Vec<(Health, Option<Sample>)> = Vec::new();
        for packet in self.packets() {
            match (packet, healths.last_mut()) {
                (Packet::Health(health), _) => healths.push((health, None)),
                (Packet::Sample(sample), Some((_, after @ None))) => *after = Some(sample),
                _ => {}
            }
        }
        healths
    }

    pub fn packets(&mut self) -> Vec<Packet> {
        let bytes = std::mem::take(&mut *self.world.from_board.borrow_mut());
        let mut packets = Vec::new();
        self.decoder.feed(&bytes, |event| match event {
            Event::Packet(received) => {
                let board = BoardId::from_serial(&SERIAL).short();
                assert_eq!(received.origin, Some(PacketOrigin { board, start: START }));
                packets.push(received.packet);
            }
            other => panic!("{other:?}"),
        });
        packets
    }

    pub fn samples(&mut self) -> Vec<Sample> {
        let packets = self.packets().into_iter();
        packets
            .filter_map(|packet| match packet {
                Packet::Sample(sample) => Some(sample),
                _ => None,
            })
            .collect()
    }

    pub fn send(&mut self, bytes: &[u8]) {
        self.world.to_board.borrow_mut().extend(bytes);
    }

    pub fn tell(&mut self, command: Command) {
        self.number += 1;
        self.send(&Packet::Command { number: self.number, to: self.to, command }.encode());
        self.run_for(4_000);
    }

    pub fn ask(&mut self, command: Command) -> (Answer, Vec<Sample>) {
        self.tell(command);
        let (mut answer, mut samples) = (None, Vec::new());
        for packet in self.packets() {
            match packet {
                Packet::Answer { number, answer: got } if number == self.number => {
                    assert_eq!(answer.replace(got), None);
                }
                Packet::Sample(sample) => samples.push(sample),
                Packet::Boot(_) | Packet::Health(_) => {}
                other => panic!("{other:?}"),
            }
        }
        (answer.expect("every command is answered"), samples)
    }

    pub fn done(&mut self, command: Command) -> Vec<Sample> {
        let (answer, samples) = self.ask(command);
        assert_eq!(answer, Answer::Done, "{command:?}");
        samples
    }

    pub fn status(&mut self) -> shared_proto::Status {
        match self.ask(Command::Status).0 {
            Answer::Status(status) => status,
            other => panic!("{other:?}"),
        }
    }

    pub fn upload(&mut self, calibration: &Calibration) {
        let bytes = calibration.to_bytes();
        let size = bytes.len() as u32;
        self.done(Command::BeginCalibration { size, crc32: crc32(&bytes) });
        for (i, piece) in bytes.chunks(MAX_PIECE).enumerate() {
            let data = Piece::copy_of(piece).expect("pieces fit");
            self.done(Command::CalibrationPiece { offset: (i * MAX_PIECE) as u16, data });
        }
        self.done(Command::CommitCalibration);
    }
}

pub fn readings(sample: &Sample) -> [u16; 8] {
    match sample.values {
        Values::Readings(readings) => readings,
        Values::Wrench(_) => panic!("a wrench"),
    }
}

pub fn wrench(sample: &Sample) -> [f32; 6] {
    match sample.values {
        Values::Wrench(wrench) => wrench,
        Values::Readings(_) => panic!("readings"),
    }
}
