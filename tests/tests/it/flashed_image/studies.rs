use shared_proto::{Command, Values};

use super::host::{Host, Modelled, boards, played};

/// The figures on flicker in docs/board.md.
#[test]
#[ignore = "needs the flashed image"]
fn of_300_steps_of_light_that_flickers_at_most_two_are_left() {
    for Modelled { model, .. } in &boards() {
        let mut worst = (0.0, 0.0);
        for mains in [50.0, 60.0, 100.0, 120.0] {
            for off in [0.995, 1.003, 1.005] {
                let mut host = Host::start(model, &played(1, |_, _| (100, 1_700)));
                host.board.set_flicker(300.0, mains * off);
                host.order(Command::Start);
                host.run(2.0);
                for sample in &host.samples {
                    let Values::Readings(readings) = sample.values else { panic!("{sample:?}") };
                    for counts in readings {
                        let error = (f64::from(counts) / 16.0 - 1_600.0).abs();
                        worst = if error > worst.0 { (error, mains * off) } else { worst };
                    }
                }
            }
        }
        println!("at most {:.2} steps, at {} Hz", worst.0, worst.1);
        assert!(worst.0 <= 2.0, "{worst:?}");
    }
}
