//! Silences of a board, from one frame to a day: losses and duration.

use std::time::Duration;

use board_link::recording::{BoardFrame, Losses, Reception};
use proptest::prelude::*;
use shared_proto::{Boot, CHANNELS, Packet, PacketOrigin, ReceivedPacket, Sample, Values};

/// A board that sends frames at a steady rate, and a link that is silent for a while.
#[derive(Clone, Copy, Debug)]
struct Outage {
    period_us: u64,
    sequence: u16,
    clock_us: u32,
    before: u64,
    lost: u64,
    dropped: u8,
    /// Relative rate of the board's clock minus that of the host, in 10⁻⁶.
    drift: i64,
    /// Delay of the bytes at the end of the silence.
    delay_us: u64,
    live: bool,
    /// Frame of the silence in which the board restarts.
    restart: Option<u64>,
}

struct Board {
    outage: Outage,
    reception: Reception,
    frames: Vec<BoardFrame>,
}

impl Board {
    fn send(&mut self, time_us: u64, [sequence, clock_us]: [u64; 2], dropped: u8, start: u16) {
        let sample = Sample {
            sequence: sequence as u16,
            clock_us: clock_us as u32,
            values: Values::Readings([16_000; CHANNELS]),
            saturated: 0,
            dropped,
        };
        if self.outage.live {
            let host_us = time_us as i64 + time_us as i64 * self.outage.drift / 1_000_000;
            self.reception.arrived_at(Duration::from_micros(host_us as u64 + 1));
        }
        let packet = Packet::Sample(sample);
        self.reception.take(from(start, packet), None, &mut self.frames);
    }
}

fn from(start: u16, packet: Packet) -> ReceivedPacket {
    ReceivedPacket { origin: Some(PacketOrigin { board: 1, start }), packet }
}

/// Returns the losses, the time in µs between the frames before and after the silence, and the number of frames.
fn told(outage: Outage) -> (Losses, u64, usize) {
    let mut board = Board { outage, reception: Reception::default(), frames: Vec::new() };
    let at = |frame: u64| frame * outage.period_us;
    let (sequence, clock) = (u64::from(outage.sequence), u64::from(outage.clock_us));
    for frame in 0..outage.before {
        board.send(at(frame), [sequence + frame, clock + at(frame)], 7, 1);
    }
    let dropped = u64::from(outage.dropped);
    let after = outage.before + outage.lost;
    for frame in after..after + 20 {
        let time_us = at(frame + dropped) + outage.delay_us;
        let now = match outage.restart {
            None => [sequence + frame, clock + at(frame + dropped)],
            Some(restart) => {
                let since = frame - outage.before - restart;
                [since, 1_500_000 + at(since)]
            }
        };
        board.send(
            time_us,
            now,
            7_u8.wrapping_add(outage.dropped),
            1 + u16::from(outage.restart.is_some()),
        );
    }
    let last = board.frames[outage.before as usize - 1].time_us;
    let silence_us = board.frames[outage.before as usize].time_us - last;
    (board.reception.losses(), silence_us as u64, board.frames.len())
}

fn outages() -> impl Strategy<Value = Outage> {
    let lengths =
        prop_oneof![1..=1_000_000_u64, 1..=100_000_u64, 30_000..=140_000_u64, 1..=300_u64];
    let link = (0..=40_u8, -100..=100_i64, 0..200_000_u64, any::<bool>());
    (1_000..=100_000_u64, any::<u16>(), any::<u32>(), 200..=400_u64, lengths, link).prop_map(
        |(period_us, sequence, clock_us, before, lost, (dropped, drift, delay_us, live))| Outage {
            period_us,
            sequence,
            clock_us,
            before,
            lost,
            dropped,
            drift,
            delay_us,
            live,
            restart: None,
        },
    )
}

const TURN_US: u64 = 1 << 32;

proptest! {
    #![proptest_config(ProptestConfig { cases: 10_000,
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(1), ..ProptestConfig::default() })]

    // Losses are exact if the silence is live or shorter than a turn of the board's clock; otherwise a minimum.
    #[test]
    fn the_length_of_a_silence_is_reported(outage in outages()) {
        let (losses, silence_us, frames) = told(outage);
        let elapsed_us = (outage.lost + 1 + u64::from(outage.dropped)) * outage.period_us;
        prop_assert_eq!(frames as u64, outage.before + 20);
        prop_assert_eq!(losses.duplicates + losses.reordered, 0);
        prop_assert!(losses.missing <= outage.lost, "{:?}", losses);
        if outage.live || elapsed_us < TURN_US {
            prop_assert_eq!(losses.missing, outage.lost, "{:?}", losses);
            prop_assert_eq!((losses.restarts, losses.uncertain), (0, 0));
            prop_assert_eq!(silence_us, elapsed_us);
            prop_assert_eq!(losses.dropped_on_board, u64::from(outage.dropped));
        }
    }

    // If the data are live, the time for which the board was off counts as missing frames.
    #[test]
    fn a_restart_in_a_silence_is_reported(outage in outages(), position in 0.0..1.0_f64) {
        let restart = (position * outage.lost as f64) as u64;
        let (losses, silence_us, frames) =
            told(Outage { restart: Some(restart), dropped: 0, ..outage });
        prop_assert_eq!(frames as u64, outage.before + 20);
        prop_assert_eq!(losses.restarts, 1);
        prop_assert_eq!(losses.uncertain, u64::from(!outage.live));
        if outage.live {
            // The board's new clock begins at 1.5 s or later, the host's clock drifts, and the first frame is late.
            let elapsed_us = (outage.lost + 1) * outage.period_us;
            let since_us = 1_500_000 + (outage.lost - restart) * outage.period_us;
            let drift_us = elapsed_us.max(since_us) / 5_000 + 10;
            prop_assert!(silence_us + drift_us >= elapsed_us.max(since_us), "{silence_us}");
            let most_us = elapsed_us.max(since_us) + outage.delay_us + drift_us;
            prop_assert!(silence_us <= most_us, "{silence_us} {most_us}");
            prop_assert_eq!(losses.missing.abs_diff(silence_us / outage.period_us) <= 1, true);
        }
    }
}

#[test]
fn a_paused_board_has_lost_nothing() {
    let outage = Outage {
        period_us: 10_000,
        sequence: 0,
        clock_us: 0,
        before: 300,
        lost: 0,
        dropped: 0,
        drift: 0,
        delay_us: 0,
        live: true,
        restart: None,
    };
    for live in [true, false] {
        let mut board = Board {
            outage: Outage { live, ..outage },
            reception: Reception::default(),
            frames: vec![],
        };
        for frame in 0..600_u64 {
            let time_us = frame * 10_000 + if frame < 300 { 0 } else { 1_800_000_000 };
            board.send(time_us, [frame, time_us], 0, 1);
        }
        let losses = board.reception.losses();
        assert_eq!((losses.missing, losses.restarts, losses.uncertain), (0, 0, 0), "{losses:?}");
    }
}

#[test]
fn an_announced_restart_is_certain() {
    let mut reception = Reception::default();
    let mut frames = Vec::new();
    let boot = Boot {
        board: shared_proto::Board::from_code(1).unwrap(),
        firmware: [0, 1, 0],
        cause: shared_proto::ResetCause::from_code(0).unwrap(),
    };
    for start in 0..3 {
        reception.take(from(start, Packet::Boot(boot)), None, &mut frames);
        for (sequence, clock_us) in [(0, 0), (1, 10_000)] {
            let values = Values::Readings([1; CHANNELS]);
            let sample = Sample { sequence, clock_us, values, saturated: 0, dropped: 0 };
            reception.take(from(start, Packet::Sample(sample)), None, &mut frames);
        }
    }
    assert_eq!((reception.losses().restarts, reception.losses().uncertain), (2, 0));
    let restarted: Vec<bool> = frames.iter().map(|frame| frame.restarted).collect();
    assert_eq!(restarted, [false, false, true, false, true, false]);
}
