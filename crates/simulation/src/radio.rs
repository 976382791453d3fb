//! A radio link with known failures, which it counts.
//!
//! Packets are delayed, lost (singly or in bursts), duplicated, reordered or corrupted, as a seed
//! determines. Times are arguments; there is no clock here.

use std::collections::BTreeMap;

use crate::SimulationError;
use shell_data::random::{Purpose, RandomStream};

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    pub loss: f64,
    /// Share of packets that begin a burst, in which all packets are lost.
    pub bursts: f64,
    pub burst_packets: f64,
    pub duplication: f64,
    /// Share of packets held back, which arrive after later ones.
    pub reordering: f64,
    pub hold_us: u64,
    pub corruption: f64,
    pub delay_us: u64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Books {
    pub sent: u64,
    pub lost: u64,
    pub lost_in_bursts: u64,
    pub duplicated: u64,
    pub held_back: u64,
    pub corrupted: u64,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Delivery {
    pub bytes: Vec<u8>,
    pub number: u64,
    pub intact: bool,
}

#[derive(Clone, Debug)]
pub struct Radio {
    faults: Faults,
    random: RandomStream,
    /// Packets under way, by time of arrival, then by order of queueing.
    on_the_way: BTreeMap<(u64, u64), Delivery>,
    queued: u64,
    in_burst: bool,
    books: Books,
}

impl Faults {
    /// Fails if a share is outside 0 to 1, or bursts have no length.
    fn check(&self) -> Result<(), SimulationError> {
        let shares = [
            ("loss", self.loss),
            ("a share of bursts", self.bursts),
            ("duplication", self.duplication),
            ("reordering", self.reordering),
            ("corruption", self.corruption),
        ];
        for (what, share) in shares {
            let is_share = (0.0..=1.0).contains(&share);
            ensure!(is_share, "{what} of {share}, where a share from 0 to 1 is wanted");
        }
        let burst = self.burst_packets;
        let has_length = self.bursts == 0.0 || (burst.is_finite() && burst >= 1.0);
        ensure!(has_length, "a burst of {burst}, where a mean of 1 packet or more is wanted");
        Ok(())
    }
}

impl Radio {
    pub fn new(faults: Faults, seed: u64) -> Result<Self, SimulationError> {
        faults.check()?;
        Ok(Self {
            faults,
            random: RandomStream::new(seed, Purpose::Radio, 0),
            on_the_way: BTreeMap::new(),
            queued: 0,
            in_burst: false,
            books: Books::default(),
        })
    }

    pub fn books(&self) -> Books {
        self.books
    }

    pub fn send(&mut self, now_us: u64, packet: &[u8]) {
        let number = self.books.sent;
        self.books.sent += 1;
        if self.is_in_burst() {
            self.books.lost_in_bursts += 1;
            return;
        }
        if self.happens(self.faults.loss) {
            self.books.lost += 1;
            return;
        }
        let due_us = now_us + self.faults.delay_us;
        let mut first_us = due_us;
        if self.happens(self.faults.reordering) {
            self.books.held_back += 1;
            first_us += 1 + (self.random.uniform() * self.faults.hold_us as f64) as u64;
        }
        self.queue(first_us, number, packet);
        if self.happens(self.faults.duplication) {
            self.books.duplicated += 1;
            self.queue(due_us, number, packet);
        }
    }

    pub(crate) fn next_arrival_us(&self) -> Option<u64> {
        self.on_the_way.first_key_value().map(|(&(due_us, _), _)| due_us)
    }

    pub fn receive(&mut self, now_us: u64) -> Option<Delivery> {
        match self.next_arrival_us()? <= now_us {
            true => self.on_the_way.pop_first().map(|(_, delivery)| delivery),
            false => None,
        }
    }

    /// Bursts begin and end at random, with geometric lengths (E. N. Gilbert, Bell Syst. Tech. J. 39, 1253, 1960; here
    /// no packet passes in the bad state).
    fn is_in_burst(&mut self) -> bool {
        self.in_burst = match self.in_burst {
            true => !self.happens(1.0 / self.faults.burst_packets),
            false => self.happens(self.faults.bursts),
        };
        self.in_burst
    }

    fn queue(&mut self, due_us: u64, number: u64, packet: &[u8]) {
        let mut bytes = packet.to_vec();
        if self.faults.corruption > 0.0 {
            for byte in &mut bytes {
                if self.happens(self.faults.corruption) {
                    *byte ^= 1 + (self.random.uniform() * 255.0) as u8;
                }
            }
        }
        let intact = bytes == packet;
        self.books.corrupted += u64::from(!intact);
        self.on_the_way.insert((due_us, self.queued), Delivery { bytes, number, intact });
        self.queued += 1;
    }

    /// Draws no random number for a share of zero, so that one fault does not shift the others.
    fn happens(&mut self, share: f64) -> bool {
        share > 0.0 && self.random.uniform() < share
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACKETS: u64 = 100_000;

    /// Sends a packet every ms; returns the numbers of those that arrive.
    fn arrivals(faults: Faults, seed: u64) -> (Vec<u64>, Books) {
        let mut radio = Radio::new(faults, seed).unwrap();
        let mut numbers = Vec::new();
        for i in 0..PACKETS {
            radio.send(i * 1_000, &i.to_le_bytes());
            while let Some(delivery) = radio.receive(i * 1_000) {
                assert_eq!(delivery.intact, delivery.bytes == delivery.number.to_le_bytes());
                numbers.push(delivery.number);
            }
        }
        while let Some(delivery) = radio.receive(u64::MAX) {
            numbers.push(delivery.number);
        }
        (numbers, radio.books())
    }

    fn assert_share(count: u64, share: f64) {
        let expected = share * PACKETS as f64;
        let deviation = (expected * (1.0 - share)).sqrt();
        assert!((count as f64 - expected).abs() < 5.0 * deviation, "{count} {expected}");
    }

    #[test]
    fn a_perfect_link_delivers_everything_in_order() {
        let (numbers, books) = arrivals(Faults { delay_us: 7_300, ..Faults::default() }, 1);
        assert!(numbers.into_iter().eq(0..PACKETS));
        assert_eq!(books, Books { sent: PACKETS, ..Books::default() });
    }

    #[test]
    fn faults_occur_at_the_requested_rate_and_are_counted() {
        let faults = Faults {
            loss: 0.05,
            duplication: 0.01,
            reordering: 0.02,
            hold_us: 8_000,
            corruption: 0.001,
            ..Faults::default()
        };
        let (numbers, books) = arrivals(faults, 2);
        assert_share(books.lost, 0.05);
        assert_share(books.duplicated, 0.95 * 0.01);
        assert_share(books.held_back, 0.95 * 0.02);
        assert_share(books.corrupted, 0.95 * 1.01 * (1.0 - 0.999_f64.powi(8)));
        assert_eq!(numbers.len() as u64, PACKETS - books.lost + books.duplicated);
        // One held packet in eight still arrives before the next, sent 1 ms later. With losses, some 83 % are late.
        let mut newest = 0;
        let late = numbers.iter().filter(|&&number| {
            newest = newest.max(number);
            number < newest
        });
        assert!(late.count() as u64 >= books.held_back * 3 / 4);
    }

    #[test]
    fn bursts_have_their_length_and_lose_all_in_them() {
        let faults = Faults { bursts: 0.01, burst_packets: 5.0, ..Faults::default() };
        let (numbers, books) = arrivals(faults, 3);
        assert_eq!(numbers.len() as u64, PACKETS - books.lost_in_bursts);
        let gaps = numbers.windows(2).filter(|pair| pair[1] != pair[0] + 1).count();
        let mean = books.lost_in_bursts as f64 / gaps as f64;
        // Geometric lengths of mean 5 have an sd of 4.5; five standard errors over 950 bursts.
        assert!((mean - 5.0).abs() < 5.0 * 4.5 / 950.0_f64.sqrt(), "{mean}");
    }

    #[test]
    fn a_seed_places_the_faults() {
        let faults = Faults { loss: 0.5, ..Faults::default() };
        assert_eq!(arrivals(faults, 4), arrivals(faults, 4));
        assert_ne!(arrivals(faults, 4), arrivals(faults, 5));
    }

    #[test]
    fn invalid_shares_are_refused() {
        for faults in [
            Faults { loss: -0.1, ..Faults::default() },
            Faults { corruption: 1.1, ..Faults::default() },
            Faults { duplication: f64::NAN, ..Faults::default() },
            Faults { bursts: 0.1, burst_packets: 0.5, ..Faults::default() },
        ] {
            assert!(Radio::new(faults, 1).is_err(), "{faults:?}");
        }
    }
}
