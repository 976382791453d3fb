//! The sync input, the rate of the line, and the chip's bootloader.

use firmware::{Baud, SeenEdge, baud};
use shared_proto::{Answer, Command, Edge, Packet, Refusal};

use crate::bench::Bench;

const TRIAL_US: u64 = 3_000_000;

fn edges(bench: &mut Bench) -> Vec<Edge> {
    let packets = bench.packets().into_iter();
    packets
        .filter_map(|packet| match packet {
            Packet::Edge(edge) => Some(edge),
            _ => None,
        })
        .collect()
}

/// Adds edges at times in µs, each with the edges missed before.
fn drive(bench: &Bench, seen: impl IntoIterator<Item = (u64, u16)>) {
    let seen = seen.into_iter().map(|(at_us, missed)| SeenEdge { at_us, missed });
    bench.world.edges.borrow_mut().extend(seen);
}

#[test]
fn edges_are_sent_with_their_time_whether_the_board_streams_or_not() {
    let mut bench = Bench::new();
    drive(&bench, [(5_000, 0), (123_457, 0)]);
    bench.run_for(200_000);
    let expected = [Edge { number: 0, clock_us: 5_000 }, Edge { number: 1, clock_us: 123_457 }];
    assert_eq!(edges(&mut bench), expected);

    bench.done(Command::Start);
    let start_us = bench.now_us();
    drive(&bench, [(start_us + 33_333, 2), (start_us + 40_001, 0)]);
    bench.run_for(100_000);
    let clock_us = |us| (start_us + us) as u32;
    let expected = [
        Edge { number: 4, clock_us: clock_us(33_333) },
        Edge { number: 5, clock_us: clock_us(40_001) },
    ];
    assert_eq!(edges(&mut bench), expected);
}

#[test]
fn edges_without_end_cost_no_sample_and_are_counted() {
    let mut bench = Bench::new();
    bench.done(Command::Start);
    let start_us = bench.now_us();
    // Held up for a tenth of a second with a hundred edges: one is under way, and eight wait.
    bench.world.held_up.set(true);
    drive(&bench, (1..=100).map(|i| (start_us + 1_000 * i, 0)));
    bench.run_for(102_000);
    bench.world.held_up.set(false);
    drive(&bench, [(start_us + 150_000, 0)]);
    bench.run_for(100_000);
    let mut numbers = Vec::new();
    for packet in bench.packets() {
        if let Packet::Edge(edge) = packet {
            numbers.push(edge.number);
        }
    }
    assert_eq!(numbers, [0, 1, 2, 3, 4, 5, 6, 7, 8, 100]);
    assert_eq!(bench.status().overflowed, 0);
}

fn rate(name: u32) -> Baud {
    baud::RATES.into_iter().find(|rate| rate.name == name).expect("a rate of the table")
}

#[test]
fn a_rate_is_set_after_its_answer_and_kept_once_something_is_heard() {
    let mut bench = Bench::on_a_line();
    bench.done(Command::SetBaud { baud: 115_200 });
    assert_eq!(*bench.world.rates.borrow(), [rate(115_200)]);
    bench.status();
    bench.run_for(2 * TRIAL_US);
    assert_eq!(*bench.world.rates.borrow(), [rate(115_200)]);
    // The new rate limits the stream: 34 bytes of a sample at 95 % of 11,527 per second.
    bench.done(Command::SetSettling { settling_us: 30 });
    bench.world.settling_us.set(30);
    bench.done(Command::SetOversampling { conversions: 4 });
    let (answer, _) = bench.ask(Command::SetPeriod { period_us: 1_000 });
    assert_eq!(answer, Answer::Refused(Refusal::LineTooSlow { shortest_us: 3_105 }));
    bench.done(Command::SetBaud { baud: 921_600 });
    bench.done(Command::SetPeriod { period_us: 1_000 });
}

#[test]
fn a_rate_without_reply_is_reverted() {
    let mut bench = Bench::on_a_line();
    bench.done(Command::SetBaud { baud: 921_600 });
    bench.send(&[0x55; 40]);
    bench.run_for(TRIAL_US + 300_000);
    assert_eq!(*bench.world.rates.borrow(), [rate(921_600), baud::FIRST]);
    // The limits are restored, too: 34 bytes at 95 % of 5,818 per second.
    bench.done(Command::SetSettling { settling_us: 30 });
    bench.done(Command::SetOversampling { conversions: 4 });
    let (answer, _) = bench.ask(Command::SetPeriod { period_us: 1_000 });
    assert_eq!(answer, Answer::Refused(Refusal::LineTooSlow { shortest_us: 6_152 }));
}

#[test]
fn unknown_rates_and_rates_too_slow_for_the_stream_are_refused() {
    let mut bench = Bench::on_a_line();
    let (answer, _) = bench.ask(Command::SetBaud { baud: 12_345 });
    assert_eq!(answer, Answer::Refused(Refusal::OutOfRange));
    // 100 Hz, the rate after a reset, needs 34 bytes at 95 % of 960 per second.
    let (answer, _) = bench.ask(Command::SetBaud { baud: 9_600 });
    assert_eq!(answer, Answer::Refused(Refusal::LineTooSlow { shortest_us: 37_281 }));
    assert_eq!(*bench.world.rates.borrow(), []);
    bench.done(Command::SetPeriod { period_us: 40_000 });
    bench.done(Command::SetBaud { baud: 9_600 });
}

#[test]
fn the_bootloader_is_started_after_its_answer_and_by_its_name() {
    let mut bench = Bench::on_a_line();
    let to = bench.to.take();
    bench.tell(Command::Bootloader);
    bench.to = to;
    assert_eq!(bench.status().foreign, 1);
    assert_eq!(*bench.world.bootloader_at_us.borrow(), []);
    assert_eq!(bench.ask(Command::Bootloader).0, Answer::Done);
    assert_eq!(bench.world.bootloader_at_us.borrow().len(), 1);
}
