//! The sync input, the rate of the line, and the entry into the ROM's bootloader.

use shared_proto::{Answer, Command};
use system_tests::flashed::{Model, ROM_STACK};

use super::host::{Host, Modelled, Random, boards};

/// The error stated in docs/alignment.md.
const LATEST_US: f64 = 20.0;

#[test]
#[ignore = "needs the flashed image"]
fn the_times_of_edges_are_right_to_twenty_microseconds() {
    for Modelled { model, .. } in &boards() {
        let mut host = Host::new(model);
        host.order(Command::Start);
        let mut random = Random(5);
        // From 2 ms to 18 ms apart, at any point in a frame.
        let mut at_s = 0.0;
        let delays_s: Vec<f64> = (0..300)
            .map(|_| {
                at_s += 2e-3 + (random.next() % 16_000) as f64 * 1e-6;
                at_s
            })
            .collect();
        let zero = host.board.drive_edges(&delays_s);
        host.run(at_s + 0.1);
        assert_eq!(host.edges.len(), delays_s.len());
        let late_us = host.edges.iter().zip(&delays_s).enumerate().map(|(i, (edge, delay_s))| {
            assert_eq!(usize::from(edge.number), i);
            let driven_us = (zero.time_s + delay_s - zero.clock_zero_s) * 1e6;
            f64::from(edge.clock_us) - driven_us
        });
        let late_us: Vec<f64> = late_us.collect();
        let (least, most) = late_us
            .iter()
            .fold((f64::MAX, f64::MIN), |(least, most), &late| (least.min(late), most.max(late)));
        println!("edges are {least:.2} to {most:.2} µs late");
        // The clock counts whole µs.
        assert!(least > -1.0 && most < LATEST_US, "{least} to {most} µs");
        let status = host.status();
        assert_eq!((status.late, status.overflowed), (0, 0));
    }
}

#[test]
#[ignore = "needs the flashed image"]
fn a_signal_that_is_none_costs_no_sample() {
    let model = &Model::find();
    let mut host = Host::new(model);
    host.order(Command::Start);
    // 20 kHz for half a second.
    let delays_s: Vec<f64> = (1..10_000).map(|i| f64::from(i) * 50e-6).collect();
    host.board.drive_edges(&delays_s);
    host.run(0.8);
    host.edges.clear();
    // The number of a later edge shows that there were others.
    host.board.drive_edges(&[0.05]);
    host.run(0.2);
    let [edge] = host.edges[..] else { panic!("{:?}", host.edges) };
    assert!(edge.number > 1_000, "{edge:?}");
    let status = host.status();
    assert_eq!((status.late, status.overflowed), (0, 0));
    assert_eq!(host.resets, ["power"]);
}

#[test]
#[ignore = "needs the flashed image"]
fn the_rate_of_the_line_is_set_and_taken_back() {
    let model = &Model::find();
    let mut host = Host::new(model);
    let first = host.last.rate;
    host.order(Command::SetBaud { baud: 115_200 });
    host.run(0.01);
    // 80 MHz / 694.
    assert!((host.last.rate - 80e6 / 694.0).abs() < 1e-6, "{} baud", host.last.rate);
    host.board.set_rate(115_200.0);
    host.order(Command::Start);
    host.run(4.0);
    host.order(Command::Stop);
    assert!(host.samples.len() >= 400);
    assert_eq!(host.decoder.counters.bad_crc, 0);

    // The other end does not follow, so the board returns to the old rate.
    host.order(Command::SetBaud { baud: 921_600 });
    assert_eq!(host.ask(Command::Status), None);
    host.run(3.5);
    assert!((host.last.rate - 80e6 / 694.0).abs() < 1e-6, "{} baud", host.last.rate);
    host.status();
    host.board.jump(0x3000_0000);
    host.run(0.1);
    assert_eq!(host.last.rate, first);
}

#[test]
#[ignore = "needs the flashed image"]
fn the_bootloader_in_rom_finds_the_chip_as_after_a_reset() {
    for Modelled { model, .. } in &boards() {
        let mut host = Host::new(model);
        host.order(Command::Start);
        host.run(0.1);
        assert_eq!(host.ask(Command::Bootloader), Some(Answer::Done));
        // A running watchdog would have reset the board by now.
        host.run(2.0);
        assert_eq!(host.resets, ["power", "software"]);
        let rom = host.last.rom.clone().expect("the ROM is entered");
        assert_eq!(
            (rom.stack_pointer, rom.vectors, rom.interrupts_on),
            (ROM_STACK, 0x1FFF_0000, 0)
        );
        // System memory at 0, as BOOT0 maps it.
        assert_eq!(rom.changed.into_iter().collect::<Vec<_>>(), [("0x40010000".to_owned(), 1)]);
        host.board.restore_power();
        host.run(0.1);
        assert_eq!(host.boots.len(), 2);
        host.status();
    }
}
